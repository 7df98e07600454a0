"""Layers of the chart: what it has, and what the planner makes of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt
import shapely

from pipeline.formats.gis.layers.columns import Table, integer, multi, real, text
from pipeline.formats.shared.result import RunResult
from pipeline.model import Zone


def coast(result: RunResult) -> Table:
    """Land before simplification: all that is no-go, less water that is no-go for other reasons."""
    land = result.fetched.land
    water = [zone.area for zone in land.zones if zone.kind in {"shoal", "uncharted", "hazard"}]
    polygons = np.array(land.polygons, dtype=object)
    if water:
        # One overlay of all: a shoal has thousands of vertices, and the chart hundreds of islets.
        left = shapely.difference(shapely.union_all(polygons), shapely.union_all(water))
        polygons = shapely.get_parts(left)
        polygons = polygons[shapely.area(polygons) > 0]
    return Table(multi(polygons), {"vertices": _vertices(polygons)})


def hazards(result: RunResult) -> Table:
    """Rocks, wrecks and the like, with the room around them."""
    return _zones(zone for zone in result.fetched.land.zones if zone.kind == "hazard")


def chart_areas(result: RunResult) -> Table:
    """Shallow, uncharted and restricted areas, and traffic schemes."""
    return _zones(zone for zone in result.fetched.land.zones if zone.kind != "hazard")


def depth_areas(result: RunResult) -> Table:
    """Areas of equal depth."""
    found = result.fetched.land.depth_areas
    return Table(
        multi([one.area for one in found]),
        {
            "kind": text([one.kind for one in found]),
            "depth_min_m": real([one.least_m for one in found]),
            "depth_max_m": real([one.greatest_m for one in found]),
        },
    )


def islands(result: RunResult) -> Table:
    """Points on the islands by which ways are told apart."""
    islands = result.evaluation.islands
    places = np.array([[island.x, island.y] for island in islands]).reshape(-1, 2)
    return Table(
        shapely.points(result.scene.projection.to_lonlat(places)),
        {
            "number": integer([island.number for island in islands]),
            "name": text([island.name for island in islands]),
        },
    )


def no_go(result: RunResult) -> Table:
    """Hard no-go zone, the same in every season."""
    polygons = result.simplified.polygons
    return Table(
        multi(polygons),
        {"vertices": _vertices(polygons)},
    )


def _zones(zones: Iterable[Zone]) -> Table:
    """Areas of the chart, with what it says of each."""
    found = list(zones)
    return Table(
        multi([zone.area for zone in found]),
        {
            "kind": text([zone.kind for zone in found]),
            "name": text([zone.name for zone in found]),
            "rule": text([zone.rule for zone in found]),
        },
    )


def _vertices(
    polygons: Sequence[shapely.Polygon] | npt.NDArray[np.object_],
) -> npt.NDArray[np.int64]:
    """Numbers of vertices."""
    return integer(shapely.get_num_coordinates(np.array(polygons, dtype=object)))
