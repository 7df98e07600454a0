"""No-go zones of a vessel from a chart of S-57 cells, in a folder or below it: a source of land.

Cells are read by GDAL (IHO S-57 3.1, appendix B.1, ENC product specification). Its driver applies
the updates `.001`, `.002`, … itself, but stops silently where one is missing. So the number of the
last update that it applied is compared with the files, and a cell that is not up to date is
refused.

Depth areas and dredged areas cover the sea without a gap (appendix A, object catalogue). So the
safe water of a vessel is those areas whose shallow limit (DRVAL1) is at least its safety depth.
Everything else is no-go: land, drying and shoal water, unsurveyed areas and those of unknown depth.
Objects that stand in the safe water are taken out of it; so are objects on its bed, unless they are
known to lie deep enough. Where cells overlap, the larger scale takes precedence.
"""

import glob
import math
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
import shapely

from pipeline._types import FloatArray, Geometries
from pipeline.errors import RequestError, refuse_any
from pipeline.geo.coast import cut_to
from pipeline.geo.projection import DepthCover
from pipeline.machine.paths import require_readable
from pipeline.model import Credit, Land, Note, Zone
from pipeline.model.inputs import DepthArea, DepthRule, TidalWater
from pipeline.sources.land import shapes
from pipeline.texts import clean, table_beside

# Attributes that are read: depths of areas (DRVAL1, DRVAL2) and of objects (VALSOU), coverage,
# zones of confidence, restrictions, names.
_COLUMNS = ("DRVAL1", "DRVAL2", "VALSOU", "CATCOV", "CATZOC", "RESTRN", "OBJNAM", "ORIENT")
# Options of GDAL's driver: lists as text, no primitives, no references between objects.
_OPTIONS = {"LIST_AS_STRING": "ON", "RETURN_PRIMITIVES": "OFF", "LNAM_REFS": "OFF"}
# Fields that identify a cell: edition, update and its date, scale, datum and unit of depths.
_IDENTIFICATION = (
    *("DSID_EDTN", "DSID_UPDN", "DSID_ISDT"),
    *("DSPM_CSCL", "DSPM_HDAT", "DSPM_DUNI", "DSPM_SDAT"),
)
# Code in DSPM of the only horizontal datum that the product specification allows, WGS 84.
_WGS84 = 2
# Code in DSPM of the only unit of depths that it allows, the metre.
_METRES = 1
_TABLE = table_beside(__file__, "s57.toml")
DATUMS: dict[str, str] = _TABLE["datums"]
# Number of files in a folder of charts above which it is not searched: all cells of the world and
# their updates are some 100,000.
_MAX_FILES = 200_000
# Name of a cell's base file or update.
_UPDATE = re.compile(r"[A-Z0-9]{8}\.\d{3}", re.ASCII)
# Value of CATCOV for the area in which the cell has data.
_COVERED = 1


@dataclass(frozen=True, slots=True)
class Objects:
    """Objects of one class: geometries (n,) in lon/lat degrees, and attributes (n,) by name.

    A number that the chart does not give is NaN, a text is empty. `columns` has only the attributes
    of the class.
    """

    geometry: Geometries
    columns: Mapping[str, Geometries]

    def numbers(self, name: str) -> FloatArray:
        """Return a numeric attribute (n,), NaN where unknown."""
        if name not in self.columns:
            return np.full(len(self.geometry), math.nan)
        return self.columns[name].astype(np.float64)

    def texts(self, name: str) -> list[str]:
        """Return a textual attribute, empty where there is none."""
        values = self.columns.get(name)
        if values is None:
            return [""] * len(self.geometry)
        return ["" if value is None else clean(str(value), shapes.MAX_NAME) for value in values]


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell: its identification (DSID, DSPM), the area with data, and its objects by class.

    `scale` is the denominator of the compilation scale, `datum` the chart datum of its depths,
    `repaired` counts its invalid areas, and `warnings` come from GDAL.
    """

    name: str
    edition: str
    update: str
    issued: str
    scale: int
    covered: shapely.Geometry
    objects: Mapping[str, Objects]
    datum: str = ""
    repaired: int = 0
    warnings: tuple[str, ...] = ()


# Largest number of cells that a message names.
_MAX_NAMES = 8


def _listed(names: Sequence[str]) -> str:
    """Name the first of many cells."""
    return ", ".join(names[:_MAX_NAMES]) + " and others" * (len(names) > _MAX_NAMES)


def base_files(path: Path) -> tuple[Path, ...]:
    """Find the base files (.000) of all cells in a folder and below it, or that of the file given.

    Raises RequestError if the folder holds too many files to be one of charts, or updates of a cell
    that is not beside them, which would not be applied.
    """
    if not path.is_dir():
        return (path.with_suffix(".000"),)
    bases, lone = list[Path](), set[str]()
    count = 0
    for folder, _, names in os.walk(path):
        count += len(names)
        if count > _MAX_FILES:
            raise RequestError(
                f"{path} holds more than {_MAX_FILES:,} files: name the folder of the cells"
            )
        own = {name[:-4] for name in names if name.endswith(".000")}
        bases += [Path(folder, f"{name}.000") for name in own]
        lone |= {name[:-4] for name in names if _UPDATE.fullmatch(name)} - own
    if lone:
        raise RequestError(
            f"{path} has updates whose cells are not beside them, of {_listed(sorted(lone))}: put "
            "each cell's .000 and its updates into one folder"
        )
    return tuple(sorted(bases))


def cell_files(base: Path) -> tuple[Path, ...]:
    """Return a cell's base file and all updates beside it, in their order."""
    return tuple(sorted(base.parent.glob(f"{glob.escape(base.stem)}.[0-9][0-9][0-9]")))


def read_cell(base: Path, box: shapely.Polygon, classes: Iterable[str]) -> Cell | None:
    """Read a cell's objects of some classes near a box (lon/lat degrees).

    None where the cell has no data near it. Raises RequestError if it can't be read, an update is
    missing, or it violates the product specification.
    """
    pyogrio = shapes.vector_library()
    remedy = "fetch the cell and its updates again"
    with shapes.reading(str(base), remedy) as issued:
        shapes.require_self_contained(base)
        try:
            layers = {str(name) for name, _ in pyogrio.list_layers(base)}
        except pyogrio.errors.DataSourceError:
            _refuse_other_editions(base)
            raise
        identification = _identification(base)
        coverage, _ = _objects(base, "M_COVR", box)
        covered = coverage.geometry[coverage.numbers("CATCOV") == _COVERED]
        _check(base, identification)
        if not len(covered):
            return None
        read = {name: _objects(base, name, box) for name in sorted(layers.intersection(classes))}
    day = clean(str(identification["DSID_ISDT"]))
    if len(day) == 8:  # as 20260108
        day = f"{day[:4]}-{day[4:6]}-{day[6:]}"
    return Cell(
        name=base.stem,
        edition=clean(str(identification["DSID_EDTN"])),
        update=clean(str(identification["DSID_UPDN"])),
        issued=day,
        scale=int(str(identification["DSPM_CSCL"])),
        covered=shapely.union_all(covered),
        datum=DATUMS.get(sdat := str(identification["DSPM_SDAT"]), f"datum {sdat} of S-57"),
        objects={name: objects for name, (objects, _) in read.items() if len(objects.geometry)},
        repaired=sum(count for _, count in read.values()),
        warnings=tuple(issued),
    )


def _identification(base: Path) -> dict[str, object]:
    """Read the cell's identification and parameters: the fields of DSID and DSPM."""
    pyogrio = shapes.vector_library()
    meta, _, _, columns = pyogrio.raw.read(base, layer="DSID", **_OPTIONS)
    fields = {
        str(name): column[0]
        for name, column in zip(meta["fields"], columns, strict=True)
        if len(column)
    }
    if lacking := [name for name in _IDENTIFICATION if name not in fields]:
        raise ValueError(f"its identification lacks {', '.join(lacking)}")
    return fields


def _refuse_other_editions(base: Path) -> None:
    """Refuse updates of another edition than their cell, with which it can't be opened."""
    pyogrio = shapes.vector_library()
    editions = dict[str, str]()
    for file in cell_files(base):
        meta, _, _, columns = pyogrio.raw.read(file, layer="DSID", UPDATES="IGNORE")
        at = list(meta["fields"]).index("DSID_EDTN")
        editions[file.suffix] = clean(str(columns[at][0])).strip()
    own = editions.pop(base.suffix)
    if others := [suffix for suffix, edition in editions.items() if edition != own]:
        raise RequestError(
            f"{base.name}: it is of edition {own}, and the updates {', '.join(others)} beside it "
            f"are of edition {editions[others[0]]}; remove these, and fetch those of edition {own}"
        )


def _check(base: Path, identification: Mapping[str, object]) -> None:
    """Refuse a cell that is cancelled, not up to date, or violates the product specification."""
    applied = int(str(identification["DSID_UPDN"]))
    last = int(cell_files(base)[-1].suffix[1:])
    said = {
        # B.1, 5.7: an update that cancels a cell has the edition 0.
        "the cell is cancelled (edition 0); remove it, and fetch the cells that replace it": (
            str(identification["DSID_EDTN"]).strip() == "0"
        ),
        f"update .{last:03d} is there, but only those up to .{applied:03d} could be applied: "
        f".{applied + 1:03d} is missing or damaged; fetch it": applied < last,
        "its horizontal datum is not WGS 84; fetch another edition": (
            identification["DSPM_HDAT"] != _WGS84
        ),
        "its depths are not in metres; fetch another edition": (
            identification["DSPM_DUNI"] != _METRES
        ),
        "its scale is not above 0; fetch it again": int(str(identification["DSPM_CSCL"])) <= 0,
    }
    refuse_any([f"{base.name}: {fault}" for fault, is_one in said.items() if is_one])


def _objects(base: Path, layer: str, box: shapely.Polygon) -> tuple[Objects, int]:
    """Read a class's objects that meet a box, valid and in its longitudes; count the repairs."""
    pyogrio = shapes.vector_library()
    meta, _, wkb, columns = pyogrio.raw.read(base, layer=layer, columns=list(_COLUMNS), **_OPTIONS)
    geometry = shapely.force_2d(shapely.from_wkb(wkb))
    present = np.flatnonzero(~shapely.is_missing(geometry) & ~shapely.is_empty(geometry))
    if (np.abs(shapely.get_coordinates(geometry[present])) > shapes.MAX_LONLAT).any():
        raise ValueError(f"an object of class {layer} has coordinates that are no lon/lat")
    near, index = shapes.near_box(geometry[present], box)
    index = present[index]
    valid, count = shapes.repaired(near)
    values = {
        str(name): column[index].astype(object)
        for name, column in zip(meta["fields"], columns, strict=True)
    }
    return Objects(valid, values), count


_DEPTH_CLASSES: dict[str, Literal["natural", "dredged"]] = _TABLE["depth_classes"]
_SUNKEN, _FIXED, _FLOATING = (_TABLE[group] for group in ("sunken", "fixed", "floating"))
_HAZARDS, _TRAFFIC, _RESTRICTED, _RULES = (
    _TABLE[names] for names in ("hazards", "traffic", "restricted", "rules")
)
_OVERHEAD = _TABLE["overhead"]
_ALL = (*_DEPTH_CLASSES, *_SUNKEN, *_FIXED, *_FLOATING, *_TRAFFIC, *_RESTRICTED, *_OVERHEAD)
CLASSES = (*_ALL, "M_QUAL")
_NO_ENTRY = {"entry prohibited", "area to be avoided"}

# Drawing accuracy of a chart on paper, m; an object shown as a point is no larger.
_DRAWING_ACCURACY_M = 0.5e-3
# Least radius around fixed points and lines, m: that of a pile with its fender or of a mark.
_MIN_FIXED_RADIUS_M = 10.0
# Least radius around a buoy, m, which may lie off its position.
_MIN_FLOATING_RADIUS_M = 25.0
# Zone of confidence (CATZOC) from which on positions may be off by 500 m or more, or unknown.
_POOR_CATZOC = 4
# Least share of the region, or of its water, that a note mentions.
_MIN_NOTED_SHARE = 0.005
# Overlap below which two areas only touch, square degrees: 1 cm along 1 m of coast.
_TOUCH_DEG2 = 1e-12

_NOAA_TERMS = "NOAA ENC user agreement: free use and redistribution; no longer an official chart"


def land(
    cells: Iterable[Cell], box: shapely.Polygon, region: shapely.Polygon, rule: DepthRule
) -> Land:
    """Make everything no-go that is not known to be water deep enough by a rule.

    The cells are in the longitudes of the box, lon/lat degrees, along which the chart is cut. The
    region is the part of it that the notes and the accuracy refer to.
    """
    least_m = rule.least_m
    parts = _visible_cells(cells, box)
    covered = shapes.merged([part.covered for part in parts])
    depths = [tuple(_depth_areas(part)) for part in parts]
    safe = [one.area for areas in depths for one in areas if one.least_m >= least_m]
    # An unknown depth is NaN, and so not deep enough.
    shoals = [
        shapes.merged([one.area for one in areas if not one.least_m >= least_m]) for areas in depths
    ]
    # A cell's depth areas must not overlap; where they do, the shallower one counts.
    sea = shapes.subtract(shapes.merged(safe), shapes.merged(shoals))
    hazards = [zone for part in parts for zone in _hazards(part, sea, least_m)]
    unsafe = shapes.extract_polygons(shapes.subtract(covered, sea))
    uncharted = shapes.subtract(box, covered)
    zones = [
        Zone("shoal", part.name, f"shallower than {least_m:.3g} m", shoal)
        for part, shoal in zip(parts, shoals, strict=True)
        if not shoal.is_empty
    ]
    zones += [*hazards, *(zone for part in parts for zone in _zones(part))]
    if not uncharted.is_empty:
        zones.append(Zone("uncharted", "", "no S-57 cell covers it", uncharted))
    used = [part for part in parts if part.covered.intersects(region)]
    depth_note = Note.of("chart-no-go", safety_depth_m=rule.safety_depth_m)
    return Land(
        polygons=(
            *unsafe.tolist(),
            *shapes.extract_polygons(
                np.array([zone.area for zone in hazards], dtype=object)
            ).tolist(),
        ),
        credits=tuple(_credits(parts)),
        accuracy_m=_DRAWING_ACCURACY_M * max(part.scale for part in used),
        notes=(depth_note, *_notes(parts, sea, region)),
        zones=tuple(zones),
        depths=DepthCover(areas=tuple(shapes.extract_polygons(covered))),
        places=tuple(
            place
            for part in parts
            if (named := part.objects.get("LNDARE")) is not None
            for place in shapes.named_places(
                named.texts("OBJNAM"), shapely.intersection(named.geometry, part.covered)
            )
        ),
        depth_areas=tuple(area for areas in depths for area in areas),
        tidal_water=tuple(_tidal_water(parts, depths, sea, rule)),
        # If the cells have several datums, all are named, and no tide's datum equals that text.
        datum=" and ".join(sorted({part.datum for part in used})),
    )


def _tidal_water(
    parts: Sequence[Cell],
    depths: Sequence[Sequence[DepthArea]],
    sea: shapely.Geometry,
    rule: DepthRule,
) -> Iterator[TidalWater]:
    """Yield the depth areas, and the objects on the bed, that need a tide to be deep enough."""
    for areas in depths:
        for depth_area in areas:
            if rule.is_tidal(depth_area.least_m):
                kind = "dredged" if depth_area.kind == "dredged" else "depth"
                text = f"{kind} {depth_area.least_m:g} to {depth_area.greatest_m:g} m"
                yield TidalWater(text, rule.need_m(depth_area.least_m), depth_area.area)
    for part in parts:
        radius_m = _fixed_radius_m(part)
        for name in filter(part.objects.__contains__, _SUNKEN):
            objects = part.objects[name]
            for depth_m in np.unique(objects.numbers("VALSOU")).tolist():
                if rule.is_tidal(depth_m):
                    is_here = objects.numbers("VALSOU") == depth_m
                    is_here &= shapely.intersects(objects.geometry, part.covered)
                    text = f"{_HAZARDS[name]} at {depth_m:g} m"
                    for area in _areas_in(sea, objects.geometry[is_here], radius_m):
                        yield TidalWater(text, rule.need_m(depth_m), area)


def _visible_cells(cells: Iterable[Cell], box: shapely.Polygon) -> tuple[Cell, ...]:
    """Divide the box among the cells: the larger scale first, then the later issue.

    Each cell keeps the part that no cell before it covers.
    """
    parts, taken = [], shapely.Polygon()
    newest = sorted(cells, key=lambda cell: (cell.issued, cell.name), reverse=True)
    for cell in sorted(newest, key=lambda cell: cell.scale):
        area = shapes.subtract(shapely.intersection(cell.covered, box), taken)
        if area.area > 0:
            parts.append(replace(cell, covered=area))
            taken = shapely.union(taken, area)
    return tuple(parts)


def _depth_areas(part: Cell) -> Iterator[DepthArea]:
    for name in filter(part.objects.__contains__, _DEPTH_CLASSES):
        objects, kind = part.objects[name], _DEPTH_CLASSES[name]
        limits = objects.numbers("DRVAL1"), objects.numbers("DRVAL2")
        inside = cut_to(objects.geometry, part.covered)
        for area, least, greatest in zip(inside, *map(np.ndarray.tolist, limits), strict=True):
            # Clipping leaves lines where an area only touches the part.
            if shapely.area(area) > 0:
                yield DepthArea(kind, least, greatest, area)


def _fixed_radius_m(cell: Cell) -> float:
    """Return the radius, m, around fixed and sunken objects that a cell shows as points."""
    return max(_MIN_FIXED_RADIUS_M, _DRAWING_ACCURACY_M * cell.scale)


def _hazards(part: Cell, sea: shapely.Geometry, least_m: float) -> Iterator[Zone]:
    """Yield the objects of a part that are dangers in the safe water, as areas."""
    fixed_m = _fixed_radius_m(part)
    floating_m = max(_MIN_FLOATING_RADIUS_M, _DRAWING_ACCURACY_M * part.scale)
    kinds = (
        (_SUNKEN, "sunken object", fixed_m),
        (_FIXED, "fixed object", fixed_m),
        (_FLOATING, "floating object", floating_m),
    )
    for names, group, radius_m in kinds:
        for name in filter(part.objects.__contains__, names):
            objects = part.objects[name]
            is_danger = shapely.intersects(objects.geometry, part.covered)
            if names is _SUNKEN:
                is_danger &= ~(objects.numbers("VALSOU") >= least_m)
            for area in _areas_in(sea, objects.geometry[is_danger], radius_m):
                yield Zone("hazard", _HAZARDS.get(name, group), "", area)


def _areas_in(sea: shapely.Geometry, geometry: Geometries, radius_m: float) -> Geometries:
    """Return the objects that overlap the sea as areas: points and lines buffered by a radius."""
    dimension = shapely.get_dimensions(geometry)
    # Coasts and quays run along the edge of the sea: only lines inside it are dangers.
    lines = shapes.inner_lines(geometry[dimension == 1], sea)
    grown = shapes.buffered(np.concatenate([geometry[dimension == 0], lines]), radius_m)
    areas = np.concatenate([geometry[dimension == 2], grown])
    shapely.prepare(sea)
    near: Geometries = areas[shapely.intersects(areas, sea)]
    # Most areas only touch the sea along a common edge.
    overlaps = shapely.area(shapely.intersection(near, sea)) > _TOUCH_DEG2
    return np.asarray(near[overlaps])


def _zones(part: Cell) -> Iterator[Zone]:
    """Yield restricted areas and traffic schemes, which are shown but not no-go."""
    for name, objects in part.objects.items():
        if name not in _RESTRICTED and name not in _TRAFFIC:
            continue
        inside = cut_to(objects.geometry, part.covered)
        # Of a lane, ORIENT is the direction of its traffic.
        courses = objects.numbers("ORIENT") if name == "TSSLPT" else np.full(len(inside), np.nan)
        for area, title, codes, course_deg in zip(
            inside, objects.texts("OBJNAM"), objects.texts("RESTRN"), courses.tolist(), strict=True
        ):
            if area.area == 0:
                continue
            rule = ", ".join(_RULES[code] for code in codes.split(",") if code in _RULES)
            if name in _TRAFFIC:
                known = course_deg if math.isfinite(course_deg) else None
                yield Zone("traffic", title or _TRAFFIC[name], rule, area, known)
            elif rule or name == "RESARE":
                yield Zone("restricted", title or _RESTRICTED[name], rule, area)


def _notes(parts: Sequence[Cell], sea: shapely.Geometry, region: shapely.Polygon) -> Iterator[Note]:
    """Yield notes on parts of the region without chart, poorly surveyed, or with entry rules."""
    covered = shapes.merged([part.covered for part in parts])
    blank = shapely.area(shapely.difference(region, covered))
    if (share := blank / region.area) > _MIN_NOTED_SHARE:
        yield Note.of("no-cell", share=share)
    water = shapely.intersection(sea, region)
    poor = shapely.area(shapely.intersection(water, shapes.merged(_poor(parts))))
    if water.area and (share := poor / water.area) > _MIN_NOTED_SHARE:
        yield Note.of("poor-survey", share=share)
    prohibited = [
        zone
        for part in parts
        for zone in _zones(part)
        if _NO_ENTRY.intersection(zone.rule.split(", ")) and zone.area.intersects(region)
    ]
    if prohibited:
        names = dict.fromkeys(zone.name or "unnamed" for zone in prohibited)
        yield Note.of("entry-prohibited", areas=tuple(names))
    over = (
        shapely.intersects(part.objects[name].geometry, shapely.intersection(water, part.covered))
        for part in parts
        for name in part.objects.keys() & {*_OVERHEAD}
    )
    if count := sum(map(int, map(np.count_nonzero, over))):
        yield Note.of("overhead", count=count)
    for part in parts:
        yield from shapes.repair_note(part.name, part.repaired)
        for text in part.warnings:
            yield Note.of("gdal-warning", source=part.name, warning=text)


def _poor(parts: Sequence[Cell]) -> Geometries:
    """Return areas in which the survey is poor or unassessed."""
    poor_parts: list[Geometries] = [np.empty(0, dtype=object)]
    for part in parts:
        quality = part.objects.get("M_QUAL")
        if quality is not None:
            poor = quality.geometry[quality.numbers("CATZOC") >= _POOR_CATZOC]
            poor_parts.append(shapely.intersection(poor, part.covered))
    return np.concatenate(poor_parts)


def _credits(cells: Sequence[Cell]) -> Iterator[Credit]:
    """Yield a credit for each producer, naming its cells with their editions."""
    for producer in sorted({cell.name[:2] for cell in cells}):  # the agency's code, such as US
        own = [cell for cell in cells if cell.name[:2] == producer]
        issuer = "NOAA" if producer == "US" else f"Producer {producer}"
        editions = "; ".join(
            f"{cell.name} (1:{cell.scale:,}) edition {cell.edition}, update {cell.update}, issued "
            f"{cell.issued}"
            for cell in own
        )
        yield Credit(
            name=f"{issuer} S-57 cells {', '.join(cell.name for cell in own)}",
            kind="land",
            text=f"{issuer} electronic navigational chart: {editions}; not for navigation",
            licence=_NOAA_TERMS if producer == "US" else "the producer's terms of use",
            url="https://charts.noaa.gov/ENCs/ENCs.shtml" if producer == "US" else "",
        )


@dataclass(frozen=True)
class S57Chart:
    """Cells (.000) with their updates in a folder or below it, or one cell.

    `rule` says which depths are deep enough.
    """

    path: Path
    rule: DepthRule

    @cached_property
    def identity(self) -> tuple[str, ...]:
        """Which depths are deep enough, and a hash of all files."""
        bases = self._bases
        with shapes.reading(str(self.path), "fetch the cells and their updates again"):
            digest = shapes.hash_of(file for base in bases for file in cell_files(base))
        return ("s57", f"{self.rule!r}", digest)

    @cached_property
    def _bases(self) -> tuple[Path, ...]:
        """Base files of the cells, each cell once."""
        return find_cells(self.path)

    def land(self, region: shapely.Polygon) -> Land:
        """Return the no-go areas near a region (lon/lat degrees), and the chart's zones."""
        box = shapes.box_around(region)
        read = (read_cell(base, box, CLASSES) for base in self._bases)
        cells = [cell for cell in read if cell is not None]
        if not any(cell.covered.intersects(region) for cell in cells):
            names = _listed([base.stem for base in self._bases])
            raise RequestError(
                f"no S-57 cell in {self.path} covers any of the region; it holds {names}: fetch "
                "the region's cells"
            )
        # Geometries that are valid one by one may fail together, where a cell is damaged.
        with shapes.reading(str(self.path), "fetch the cells and their updates again"):
            return land(cells, box, region, self.rule)


def find_cells(path: Path) -> tuple[Path, ...]:
    """Find the base files of the cells in a folder and below it, each cell once.

    Raises RequestError if there is no cell, a cell is there twice, or a file can't be read.
    """
    bases = base_files(path)
    if not bases:
        raise RequestError(f"{path} holds no S-57 cell (.000): name their folder, or a vector file")
    twice = [name for name, count in Counter(file.stem for file in bases).items() if count > 1]
    where = f"in {path}; keep the latest"
    refuse_any([f"cell {name} is there more than once {where}" for name in twice])
    files = (file for base in bases for file in (base, *cell_files(base)))
    require_readable(files, "chart.source")
    return bases
