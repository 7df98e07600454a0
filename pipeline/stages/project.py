"""Third stage: everything into the planner's plane, in metres divided by the scenario's scale.

Speeds are not scaled. Current vectors turn with the meridian convergence; gaps in a current are
filled from the water around them, for land says nothing about the water beside it.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
import shapely

import renew
from pipeline.errors import RequestError
from pipeline.geo.projection import Projection
from pipeline.model import Scene
from pipeline.stages import planar as plane
from pipeline.stages.endpoints import check_ends

if TYPE_CHECKING:
    import numpy.typing as npt
    from shapely.geometry import Polygon

    from pipeline.model import CurrentGrid, Fetched, Simplified
    from pipeline.scenario.model import Scenario

    FloatArray = npt.NDArray[np.float64]

# The region's straight edges in degrees are bent in the plane. Their corners become vertices of the
# triangulation, so an edge is cut only where it departs by more than this share of the diagonal,
# and into 8 parts at most.
_LARGEST_SAG = 2e-3
_MOST_HALVINGS = 3
# Nodes of the planner's current a cell of the source: linear between them either way.
_NODES_PER_CELL = 2
# Nodes stand no closer than cells of this share of their height would want them.
_NARROWEST = 4
_METRES_PER_DEGREE = 111_195.0


def project(scenario: Scenario, fetched: Fetched, simplified: Simplified) -> Scene:
    """Build the planner's world.

    Raises
    ------
    RequestError
        Start or goal on land, or in different basins; all such faults at once.
    renew.GeometryError
        The no-go zone leaves no water.
    """
    if scenario.region is None:
        return plane.scene(scenario)
    region = scenario.region.shape
    projection = Projection.for_region(region, scenario.scale, scenario.region.crs)
    chart = renew.Chart(
        extent_polygon(region, projection),
        [projection.geometry_to_plane(polygon) for polygon in simplified.polygons],
    )
    check_ends(scenario, chart, projection)
    return Scene(
        chart=chart,
        land=tuple(projection.geometry_to_plane(np.array(fetched.land.polygons, dtype=object))),
        currents={
            grid.season: gridded(grid, projection, chart.bounds) for grid in fetched.currents
        },
        start=projection.to_plane(scenario.start),
        goal=projection.to_plane(scenario.goal),
        projection=projection,
        vessel=scenario.vessel.vessel(),
    )


def extent_polygon(region: Polygon, projection: Projection) -> Polygon:
    """Project a region, its edges cut where they bend: few vertices, each one needed."""
    corners = shapely.get_coordinates(region.exterior)
    planar = projection.to_plane(corners)
    allowed = _LARGEST_SAG * float(np.hypot(*(planar.max(axis=0) - planar.min(axis=0))))
    ring: list[FloatArray] = []
    for begin, end in itertools.pairwise(corners):
        parts = 1
        while parts < 2**_MOST_HALVINGS and _sag(begin, end, parts, projection) > allowed:
            parts *= 2
        ring.append(projection.to_plane(_between(begin, end, parts)[:-1]))
    return shapely.Polygon(np.concatenate(ring))


def _between(begin: FloatArray, end: FloatArray, parts: int) -> FloatArray:
    """Points (parts + 1, 2) evenly from begin to end."""
    return begin + np.linspace(0, 1, parts + 1)[:, None] * (end - begin)


def _sag(begin: FloatArray, end: FloatArray, parts: int, projection: Projection) -> float:
    """Largest distance in the plane between an edge's parts' middles and their chords."""
    points = projection.to_plane(_between(begin, end, 2 * parts))
    return float(np.linalg.norm(points[1::2] - (points[:-1:2] + points[2::2]) / 2, axis=1).max())


def gridded(
    grid: CurrentGrid, projection: Projection, bounds: tuple[float, float, float, float]
) -> renew.GriddedCurrent:
    """Put a lon/lat current on a planar grid over bounds (xmin, ymin, xmax, ymax), planar metres.

    Vectors (m/s) are turned into the plane's axes. Nodes stand at half the source's cell: so a
    triangle's spread is that of the source's cells in it, within a tenth on real fields.
    """
    xmin, ymin, xmax, ymax = bounds
    step = _cell_m(grid) / _NODES_PER_CELL / projection.scale
    x = np.linspace(xmin, xmax, max(2, int(np.ceil((xmax - xmin) / step)) + 1))
    y = np.linspace(ymin, ymax, max(2, int(np.ceil((ymax - ymin) / step)) + 1))
    lonlat = projection.to_lonlat(np.stack(np.meshgrid(x, y), axis=-1))
    uv = projection.rotate_to_plane(lonlat, bilinear(grid, lonlat))
    return renew.GriddedCurrent(x, y, uv[..., 0], uv[..., 1])


def bilinear(grid: CurrentGrid, lonlat: FloatArray) -> FloatArray:
    """East and north velocity (..., 2) in m/s at lon/lat (..., 2): the source's own at its nodes.

    Gaps are filled first; beyond the grid's ends its figures are held constant.
    """
    from scipy.interpolate import RegularGridInterpolator

    field = filled(np.stack([grid.u, grid.v], axis=-1))
    at = [np.clip(lonlat[..., i], axis[0], axis[-1]) for i, axis in ((1, grid.lat), (0, grid.lon))]
    return np.asarray(RegularGridInterpolator((grid.lat, grid.lon), field)(np.stack(at, axis=-1)))


def _cell_m(grid: CurrentGrid) -> float:
    """The shorter side of a source's cell, in true metres; near a pole cells grow too narrow."""
    up = float(np.diff(grid.lat).min())
    across = float(np.diff(grid.lon).min() * np.cos(np.radians(grid.lat.mean())))
    return max(min(up, across), up / _NARROWEST) * _METRES_PER_DEGREE


def filled(field: FloatArray) -> FloatArray:
    """Fill NaN of a field (ny, nx, 2) outward from its figures, ring by ring.

    Each ring is the mean of what is known among its eight neighbours; known figures stay.
    """
    field = np.array(field, dtype=float)
    known = np.isfinite(field).all(axis=-1)
    if not known.any():
        raise RequestError(["the current has no figures at all; name another source in 'currents'"])
    field[~known] = 0.0
    while not known.all():
        padded = np.pad(field, ((1, 1), (1, 1), (0, 0)))
        counted = np.pad(known.astype(float), 1)
        total, count = np.zeros_like(field), np.zeros(known.shape)
        ny, nx = known.shape
        for down in range(3):
            for right in range(3):
                total += padded[down : down + ny, right : right + nx]
                count += counted[down : down + ny, right : right + nx]
        ring = ~known & (count > 0)
        field[ring] = total[ring] / count[ring][:, None]
        known |= ring
    return field
