"""Reading S-57 cells: the objects of each class, with all updates applied.

IHO S-57 3.1, appendix B.1 (ENC product specification). GDAL's driver applies the updates `.001`,
`.002`, … itself, but stops silently where one is missing. So the number of the last update that it
applied is compared with the files, and a cell that is not up to date is refused.
"""

import glob
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

from pipeline._types import FloatArray, Geometries
from pipeline.errors import RequestError
from pipeline.sources.land.shapes import (
    MAX_LONLAT,
    MAX_NAME,
    near_box,
    reading,
    repaired,
    require_self_contained,
    vector_library,
)
from pipeline.texts import clean

# Attributes that are read: depths of areas (DRVAL1, DRVAL2) and of objects (VALSOU), coverage,
# zones of confidence, restrictions, names.
_COLUMNS = ("DRVAL1", "DRVAL2", "VALSOU", "CATCOV", "CATZOC", "RESTRN", "OBJNAM")
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
# Names of the datums of depths (VERDAT, the codes of DSPM_SDAT) for which tides are published.
_DATUMS = {
    "1": "MLWS", "2": "MLLWS", "3": "MSL", "4": "LLW", "5": "MLW", "6": "LLWS", "8": "ISLW",
    "9": "LWS", "12": "MLLW", "13": "LW", "23": "LAT",
}  # fmt: skip
# Number of files in a folder of charts above which it is not searched: all cells of the world and
# their updates are some 100,000.
_MAX_FILES = 200_000
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
        return ["" if value is None else clean(str(value), MAX_NAME) for value in values]


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

    @property
    def producer(self) -> str:
        """Code of the producing agency, such as US: the first two letters of the name."""
        return self.name[:2]


def base_files(path: Path) -> tuple[Path, ...]:
    """Find the base files (.000) of all cells in a folder and below it, or the one given.

    Raises
    ------
    RequestError
        The folder holds too many files to be one of charts.
    """
    if not path.is_dir():
        return (path,) if path.suffix == ".000" else ()
    bases: list[Path] = []
    count = 0
    for folder, _, names in os.walk(path):
        count += len(names)
        if count > _MAX_FILES:
            raise RequestError(
                f"{path} holds more than {_MAX_FILES:,} files: name the folder of the cells"
            )
        bases += [Path(folder, name) for name in names if name.endswith(".000")]
    return tuple(sorted(bases))


def cell_files(base: Path) -> tuple[Path, ...]:
    """Return a cell's base file and all updates beside it, in their order."""
    return tuple(sorted(base.parent.glob(f"{glob.escape(base.stem)}.[0-9][0-9][0-9]")))


def read_cell(base: Path, box: shapely.Polygon, classes: Iterable[str]) -> Cell | None:
    """Read a cell's objects of some classes near a box (lon/lat degrees).

    None where the cell has no data near it.

    Raises
    ------
    RequestError
        It can't be read, an update is missing, or it violates the product specification.
    """
    pyogrio = vector_library()

    remedy = "fetch the cell and its updates again"
    with reading(str(base), remedy) as issued:
        require_self_contained(base)
        layers = {str(name) for name, _ in pyogrio.list_layers(base)}
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
        datum=_DATUMS.get(sdat := str(identification["DSPM_SDAT"]), f"datum {sdat} of S-57"),
        objects={name: objects for name, (objects, _) in read.items() if len(objects.geometry)},
        repaired=sum(count for _, count in read.values()),
        warnings=tuple(issued),
    )


def _identification(base: Path) -> dict[str, object]:
    """Read the cell's identification and parameters: the fields of DSID and DSPM."""
    pyogrio = vector_library()

    meta, _, _, columns = pyogrio.raw.read(base, layer="DSID", **_OPTIONS)
    fields = {
        str(name): column[0]
        for name, column in zip(meta["fields"], columns, strict=True)
        if len(column)
    }
    if lacking := [name for name in _IDENTIFICATION if name not in fields]:
        raise ValueError(f"its identification lacks {', '.join(lacking)}")
    return fields


def _check(base: Path, identification: Mapping[str, object]) -> None:
    """Refuse a cell that is cancelled, not up to date, or violates the product specification."""
    faults = []
    # B.1, 5.7: an update that cancels a cell has the edition 0.
    if str(identification["DSID_EDTN"]).strip() == "0":
        faults.append(
            f"{base.name}: the cell is cancelled (edition 0); remove it, and fetch the cells that "
            "replace it"
        )
    applied = int(str(identification["DSID_UPDN"]))
    last = int(cell_files(base)[-1].suffix[1:])
    if applied < last:
        faults.append(
            f"{base.name}: update .{last:03d} is there, but only those up to .{applied:03d} could "
            f"be applied: .{applied + 1:03d} is missing or damaged; fetch it"
        )
    if identification["DSPM_HDAT"] != _WGS84:
        faults.append(f"{base.name}: its horizontal datum is not WGS 84; fetch another edition")
    if identification["DSPM_DUNI"] != _METRES:
        faults.append(f"{base.name}: its depths are not in metres; fetch another edition")
    if int(str(identification["DSPM_CSCL"])) <= 0:
        faults.append(f"{base.name}: its scale is not above 0; fetch it again")
    if faults:
        raise RequestError(faults)


def _objects(base: Path, layer: str, box: shapely.Polygon) -> tuple[Objects, int]:
    """Read a class's objects that meet a box, valid and in its longitudes; count the repairs."""
    pyogrio = vector_library()

    meta, _, wkb, columns = pyogrio.raw.read(base, layer=layer, columns=list(_COLUMNS), **_OPTIONS)
    geometry = shapely.force_2d(shapely.from_wkb(wkb))
    present = np.flatnonzero(~shapely.is_missing(geometry) & ~shapely.is_empty(geometry))
    if (np.abs(shapely.get_coordinates(geometry[present])) > MAX_LONLAT).any():
        raise ValueError(f"an object of class {layer} has coordinates that are no lon/lat")
    near, index = near_box(geometry[present], box)
    index = present[index]
    valid, count = repaired(near)
    values = {
        str(name): column[index].astype(object)
        for name, column in zip(meta["fields"], columns, strict=True)
    }
    return Objects(valid, values), count
