"""From S-57 cells to what a vessel must not enter.

IHO S-57 3.1, appendix A (object catalogue). Depth areas and dredged areas cover the sea without a
gap, so the sea that a vessel may use is just those whose shallow limit (DRVAL1) is not below its
safety depth; everything else is no-go: land, drying and shoal water, areas that nobody has sounded
and those without a figure. Out of that sea are taken the objects that stand in it, and those on its
bed that are not known to lie deep enough. Where cells overlap, that of the larger scale holds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.model import Credit, Land, Zone
from pipeline.sources.land.polygons import less, mended_note, merged, off_edge, polygonal, widened

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    import numpy.typing as npt
    from shapely.geometry import Polygon
    from shapely.geometry.base import BaseGeometry

    from pipeline.sources.land.s57_cells import Cell

    Geometries = npt.NDArray[np.object_]

_DEPTHS = ("DEPARE", "DRGARE")
# On the bed, with a depth (VALSOU) or an unknown one.
_SUNKEN = ("OBSTRN", "WRECKS", "UWTROC", "MARCUL")
# Hard whatever the depth is. As areas most of them are land to the vessel already; as points and
# lines (islets, piles, breakwaters) they stand in water.
_FIXED = (
    *("LNDARE", "COALNE", "SLCONS", "DAMCON", "DYKCON", "CAUSWY", "GATCON", "OILBAR", "LOGPON"),
    *("BCNCAR", "BCNISD", "BCNLAT", "BCNSAW", "BCNSPP", "LIGHTS", "PILPNT", "PYLONS", "OFSPLF"),
    *("CRANES", "FSHFAC", "PONTON", "FLODOC", "HULKES"),
)
# They swing on their chains.
_FLOATING = (
    *("BOYCAR", "BOYINB", "BOYISD", "BOYLAT", "BOYSAW", "BOYSPP"),
    *("LITFLT", "LITVES", "MORFAC"),
)
_TRAFFIC = {
    "TSSLPT": "traffic lane",
    "TSEZNE": "traffic separation zone",
    "TSSRON": "traffic roundabout",
    "TSSCRS": "traffic crossing",
    "ISTZNE": "inshore traffic zone",
    "PRCARE": "precautionary area",
    "DWRTPT": "deep water route",
}
CLASSES = (*_DEPTHS, *_SUNKEN, *_FIXED, *_FLOATING, *_TRAFFIC, "RESARE", "M_QUAL")
# RESTRN: those of its values that concern a vessel which only passes.
_RULES = {
    "7": "entry prohibited",
    "8": "entry restricted",
    "13": "no wake",
    "14": "area to be avoided",
    "27": "speed restricted",
}
_NO_ENTRY = {"entry prohibited", "area to be avoided"}

# A chart is drawn to half a millimetre; what it shows as a point is no larger than one.
_DRAWN_M = 0.5e-3
# Half the size of a point or the width of a line, at the least: a pile with its fender, a mark; and
# how far a buoy may lie off its place.
_FIXED_M, _FLOATING_M = 10.0, 25.0
# Zones of confidence (CATZOC) in which positions may be off by 500 m, or by an unknown distance.
_POOR_ZOC = 4
# Shares of the region below this are no news.
_LEAST_SHARE = 0.005
# What two areas share by rounding (1 m along a coast of 1 cm), in square degrees.
_TOUCH_DEG2 = 1e-12

_NOAA_TERMS = "NOAA ENC user agreement: free use and redistribution; no official chart any more"


@dataclass(frozen=True, slots=True)
class _Part:
    """A cell's share of the chart: its area where no cell of a larger scale covers it."""

    cell: Cell
    area: BaseGeometry


def land(cells: Iterable[Cell], box: Polygon, region: Polygon, depth_m: float) -> Land:
    """Make no-go of all that is not known to be water deep enough.

    Parameters
    ----------
    cells
        In the box's longitudes.
    box
        Lon/lat degrees; the chart is cut along it.
    region
        What the notes speak of.
    depth_m
        Safety depth: draught and under-keel clearance.
    """
    parts = _parts(cells, box)
    covered = merged(np.array([part.area for part in parts], dtype=object))
    depths = [_depths(part) for part in parts]
    sea = merged(np.concatenate([area[depth >= depth_m] for area, depth in depths]))
    shoals = [merged(area[~(depth >= depth_m)]) for area, depth in depths]
    # Where a cell's areas overlap against the rules, the shallower one holds.
    sea = less(sea, merged(np.array(shoals, dtype=object)))
    dangers = np.concatenate([_dangers(part, sea, depth_m) for part in parts])
    dry = polygonal(np.array([less(covered, sea)], dtype=object))
    uncharted = less(box, covered)
    zones = [
        Zone("shoal", part.cell.name, f"shallower than {depth_m:g} m", shoal)
        for part, shoal in zip(parts, shoals, strict=True)
        if not shoal.is_empty
    ]
    zones += [zone for part in parts for zone in _zones(part)]
    if not uncharted.is_empty:
        zones.append(Zone("uncharted", "", "no S-57 cell covers it", uncharted))
    used = [part for part in parts if part.area.intersects(region)]
    told = (
        f"no-go: what is not charted as {depth_m:g} m deep or more (draught and under-keel "
        "clearance at chart datum; tides are not counted on)"
    )
    return Land(
        polygons=(*dry.tolist(), *polygonal(dangers).tolist()),
        credits=tuple(_credits([part.cell for part in parts])),
        accuracy_m=_DRAWN_M * max(part.cell.scale for part in used),
        notes=(told, *_notes(parts, sea, region)),
        zones=tuple(zones),
    )


def _parts(cells: Iterable[Cell], box: Polygon) -> tuple[_Part, ...]:
    """Share the box out among the cells: the larger scale first, then the later issue."""
    parts, taken = [], shapely.Polygon()
    newest = sorted(cells, key=lambda cell: (cell.issued, cell.name), reverse=True)
    for cell in sorted(newest, key=lambda cell: cell.scale):
        area = less(shapely.intersection(cell.covered, box), taken)
        if area.area > 0:
            parts.append(_Part(cell, area))
            taken = shapely.union(taken, area)
    return tuple(parts)


def _depths(part: _Part) -> tuple[Geometries, npt.NDArray[np.float64]]:
    """Return the areas of a part with a depth, and their shallow limits (NaN: unknown)."""
    areas: list[Geometries] = [np.empty(0, dtype=object)]
    depths: list[npt.NDArray[np.float64]] = [np.empty(0)]
    for name in _DEPTHS:
        objects = part.cell.objects.get(name)
        if objects is None:
            continue
        # Clipping leaves lines where an area only touches the part.
        inside = _within(objects.geometry, part.area)
        is_area = shapely.area(inside) > 0
        areas.append(inside[is_area])
        depths.append(objects.numbers("DRVAL1")[is_area])
    return np.concatenate(areas), np.concatenate(depths)


def _within(geometries: Geometries, area: BaseGeometry) -> Geometries:
    """Cut geometries along an area; those inside stay as they are, to the last digit."""
    shapely.prepare(area)
    inside = shapely.covers(area, geometries)
    cut = geometries.copy()
    cut[~inside] = shapely.intersection(geometries[~inside], area)
    return cut


def _dangers(part: _Part, sea: BaseGeometry, depth_m: float) -> Geometries:
    """Return the objects of a part that stand in the sea, as areas."""
    small = _DRAWN_M * part.cell.scale
    kinds = (
        (_SUNKEN, max(_FIXED_M, small)),
        (_FIXED, max(_FIXED_M, small)),
        (_FLOATING, max(_FLOATING_M, small)),
    )
    found: list[Geometries] = [np.empty(0, dtype=object)]
    for names, radius_m in kinds:
        for name in names:
            objects = part.cell.objects.get(name)
            if objects is None:
                continue
            there = shapely.intersects(objects.geometry, part.area)
            if names is _SUNKEN:
                # An unknown depth compares as not deep enough.
                there &= ~(objects.numbers("VALSOU") >= depth_m)
            found.append(_in_sea(objects.geometry[there], sea, radius_m))
    return np.concatenate(found)


def _in_sea(geometry: Geometries, sea: BaseGeometry, radius_m: float) -> Geometries:
    """Return as areas what objects take of the sea; areas are drawn as large as they are."""
    dimension = shapely.get_dimensions(geometry)
    # Coasts and quays run along the sea's own edge: only lines out in it take something of it.
    lines = off_edge(geometry[dimension == 1], sea)
    wide = widened(np.concatenate([geometry[dimension == 0], lines]), radius_m)
    areas = np.concatenate([geometry[dimension == 2], wide])
    shapely.prepare(sea)
    near: Geometries = areas[shapely.intersects(areas, sea)]
    # Most areas only touch the sea: their edge is its own.
    taken = shapely.area(shapely.intersection(near, sea)) > _TOUCH_DEG2
    return np.asarray(near[taken])


def _zones(part: _Part) -> Iterator[Zone]:
    """Restricted areas and traffic schemes, which a vessel may enter."""
    for name, objects in part.cell.objects.items():
        if name != "RESARE" and name not in _TRAFFIC:
            continue
        inside = _within(objects.geometry, part.area)
        for area, title, codes in zip(
            inside, objects.texts("OBJNAM"), objects.texts("RESTRN"), strict=True
        ):
            if area.area == 0:
                continue
            rule = ", ".join(_RULES[code] for code in codes.split(",") if code in _RULES)
            if name == "RESARE":
                yield Zone("restricted", title, rule, area)
            else:
                yield Zone("traffic", title or _TRAFFIC[name], rule, area)


def _notes(parts: Sequence[_Part], sea: BaseGeometry, region: Polygon) -> Iterator[str]:
    """What of the region has no chart, a poor one, or a rule that planning doesn't know."""
    covered = merged(np.array([part.area for part in parts], dtype=object))
    blank = shapely.area(shapely.difference(region, covered))
    if (share := blank / region.area) > _LEAST_SHARE:
        yield f"no S-57 cell covers {share:.1%} of the region: it is no-go"
    water = shapely.intersection(sea, region)
    poor = shapely.area(shapely.intersection(water, merged(_poor(parts))))
    if water.area and (share := poor / water.area) > _LEAST_SHARE:
        yield (
            f"{share:.0%} of the water is charted from poor or unassessed surveys (zones of "
            "confidence C, D, U): objects may lie 500 m or more off their charted place"
        )
    closed = [
        zone
        for part in parts
        for zone in _zones(part)
        if _NO_ENTRY.intersection(zone.rule.split(", ")) and zone.area.intersects(region)
    ]
    if closed:
        names = ", ".join(dict.fromkeys(zone.name or "unnamed" for zone in closed))
        yield f"areas where entry is prohibited or to be avoided are not kept clear of: {names}"
    for part in parts:
        yield from mended_note(part.cell.name, part.cell.mended)


def _poor(parts: Sequence[_Part]) -> Geometries:
    """Areas of parts whose positions are known poorly."""
    found: list[Geometries] = [np.empty(0, dtype=object)]
    for part in parts:
        quality = part.cell.objects.get("M_QUAL")
        if quality is not None:
            poor = quality.geometry[quality.numbers("CATZOC") >= _POOR_ZOC]
            found.append(shapely.intersection(poor, part.area))
    return np.concatenate(found)


def _credits(cells: Sequence[Cell]) -> Iterator[Credit]:
    """Name each producer's cells with their editions."""
    for producer in sorted({cell.producer for cell in cells}):
        own = [cell for cell in cells if cell.producer == producer]
        whose = "NOAA" if producer == "US" else f"Producer {producer}"
        editions = "; ".join(
            f"{cell.name} (1:{cell.scale:,}) edition {cell.edition}, update {cell.update}, issued "
            f"{cell.issued}"
            for cell in own
        )
        yield Credit(
            name=f"{whose} S-57 cells {', '.join(cell.name for cell in own)}",
            kind="land",
            text=f"{whose} electronic navigational chart: {editions}; not for navigation",
            licence=_NOAA_TERMS if producer == "US" else "the producer's terms of use",
            url="https://charts.noaa.gov/ENCs/ENCs.shtml" if producer == "US" else "",
        )
