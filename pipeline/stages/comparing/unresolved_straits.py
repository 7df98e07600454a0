"""Find straits on the best routes that are too narrow for the grid of a changing current."""

import itertools
from collections.abc import Iterator

import numpy as np
import shapely

import renew
from pipeline.formats.shared.result import RunResult
from pipeline.geo.earth import METRES_PER_DEGREE
from pipeline.model import CurrentGrid, Note, Place, Scene

# Minimum number of cells across a strait for which the grid can resolve its tide.
_MIN_CELLS = 2.0
# A point this near to a coast lies on it, planar metres.
_ON_COAST = 1e-6


def unresolved_strait_notes(result: RunResult) -> Iterator[Note]:
    """Yield a note for each season's best route on the worst strait with an unresolved tide."""
    for grid in result.fetched.currents:
        if not grid.changes:
            continue
        for best in result.season_routes(grid.season)[:1]:
            straits = [
                (width_m * _MIN_CELLS / cell, width_m, cell, middle)
                for width_m, middle in straits_of(best.route, result.scene)
                if (cell := _cell_m(grid, middle[1])) * _MIN_CELLS > width_m
            ]
            if straits:
                _, width_m, cell, middle = min(straits, key=lambda one: one[0])
                yield Note.of(
                    "strait-unresolved", place=Place(*middle), width_m=width_m, cell_m=cell
                ).about(grid.season)


def straits_of(route: renew.Route, scene: Scene) -> Iterator[tuple[float, tuple[float, float]]]:
    """Yield the straits on a route: true width (m), and the middle (lon, lat), degrees.

    A strait is a triangle's side that the route crosses and that joins two islands.
    """
    if not scene.chart.no_go:
        return
    coasts = shapely.STRtree(scene.chart.no_go)
    channel = route.channel
    for here, ahead in itertools.pairwise(channel):
        side = here[(here[:, None] == ahead[None]).all(axis=-1).any(axis=1)]
        if len(side) != 2:
            continue
        end, coast = coasts.query(shapely.points(side), predicate="dwithin", distance=_ON_COAST)
        one, other = (set(coast[end == i].tolist()) for i in (0, 1))
        if one and other and not one & other:
            lon, lat = scene.projection.to_lonlat(side.mean(axis=0)).tolist()
            yield scene.projection.geodesic_length_m(side), (lon, lat)


def _cell_m(grid: CurrentGrid, lat: float) -> float:
    """Return the longer side of a cell at a latitude, true metres."""
    across = float(np.median(np.diff(grid.lon)) * np.cos(np.radians(lat)))
    return max(across, float(np.median(np.diff(grid.lat)))) * METRES_PER_DEGREE
