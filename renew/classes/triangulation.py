"""Constrained Delaunay triangulation of the water.

Every vertex lies on the no-go zone or the extent (no Steiner points), so each simple path in the
dual graph is exactly one homotopy class (RENEW, AAAI 2026). GEOS makes the triangulation, through
shapely, or Shewchuk's Triangle if it is asked for: an extra, because its licence bars commercial
distribution. Where no four vertices lie on one circle the constrained Delaunay triangulation is
unique, and both give the same triangles, in another order.

Water can be closed as if it were land, such as water whose current is as strong as the vessel.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import Literal, TypeAlias, get_args
from weakref import WeakKeyDictionary

import numpy as np
import shapely
from contourpy import FillType, contour_generator

from renew._types import BoolArray, FloatArray, IntArray
from renew.errors import GeometryError, ParameterError, UnreachableError
from renew.inputs.chart_and_vessel import Chart
from renew.kernels.capsules import distances_within
from renew.kernels.current_table import weakest_and_strongest
from renew.voyage.voyage import Voyage

# A point outside all triangles by at most this share of the chart's size lies on the water's edge.
_ON_EDGE = 1e-7

Backend: TypeAlias = Literal["shapely", "triangle"]
# Tolerance, as a share of a cell, by which the outline of overpowered water is simplified.
_TOLERANCE = 0.1
# Greatest threshold from which a current in a table counts as overpowering, as a share of the
# vessel's speed. It is below 1, so that the simplified outline doesn't cut into overpowered water.
_AT_MOST = 0.99
# Least such threshold, however coarse the table is.
_AT_LEAST = 0.5
# Radius, in cells, of the water around start and goal that stays open: there the path itself finds
# out how strong the current is.
_OPEN_RADIUS = 2.0


@dataclass(frozen=True)
class Triangulation:
    """Triangles of the water, anticlockwise, with their neighbours.

    Attributes
    ----------
    vertices : (v, 2) metres.
    triangles : (t, 3) indices of vertices, anticlockwise.
    neighbours : (t, 3) the triangle across the edge opposite each corner, -1 where there is none.
    hazardous : (t, 3) True where that edge lies on the no-go zone (a constrained edge), False on
        passing edges and on the end of the chart.
    """

    vertices: FloatArray
    triangles: IntArray
    neighbours: IntArray
    hazardous: BoolArray

    @cached_property
    def corners(self) -> FloatArray:
        """Coordinates (t, 3, 2) of every triangle's corners."""
        return self.vertices[self.triangles]

    @cached_property
    def constrained_edges(self) -> FloatArray:
        """The constrained edges as segments (e, 2, 2), water on their left."""
        triangle, corner = np.nonzero(self.hazardous)
        return self.vertices[self.edge_vertices(triangle, corner)]

    @cached_property
    def constrained_edge_tree(self) -> shapely.STRtree:
        """The constrained edges as lines, for queries by place."""
        edges = self.constrained_edges
        lines = shapely.linestrings(edges) if len(edges) else np.array([], dtype=object)
        return shapely.STRtree(lines)

    def room_at(self, points: FloatArray, reach: float) -> FloatArray:
        """Return the distances (...,), m, of points (..., 2) from land; inf beyond the reach, m.

        Points that follow each other should be near each other.
        """
        start, end = np.ascontiguousarray(self.constrained_edges.swapaxes(0, 1))
        found = distances_within(points.reshape(-1, 2), reach, start, end)
        return np.asarray(found.reshape(points.shape[:-1]))

    @cached_property
    def on_land(self) -> BoolArray:
        """Which vertices (v,) are ends of a constrained edge."""
        ends = np.zeros(len(self.vertices), dtype=bool)
        ends[self.edge_vertices(*np.nonzero(self.hazardous))] = True
        return ends

    def free_widths(self, clearance: float) -> FloatArray:
        """Return lengths (p,), m, of passing edges less `clearance` m at each end on land."""
        triangle, corner = np.nonzero(self.neighbours >= 0)
        vertices = self.edge_vertices(triangle, corner)
        a, b = self.vertices[vertices[:, 0]], self.vertices[vertices[:, 1]]
        taken = clearance * self.on_land[vertices].sum(axis=1)
        return np.asarray(np.linalg.norm(b - a, axis=1) - taken)

    def open_outline(self, triangles: IntArray) -> FloatArray:
        """Return outer edges (w, 2, 2) of some triangles, except constrained ones, in metres."""
        inside = np.zeros(len(self.triangles) + 1, dtype=bool)  # the last is for -1: no neighbour
        inside[triangles] = True
        outer = ~inside[self.neighbours[triangles]] & ~self.hazardous[triangles]
        row, corner = np.nonzero(outer)
        return self.vertices[self.edge_vertices(triangles[row], corner)]

    def edge_vertices(self, triangle: IntArray | int, corner: IntArray | int) -> IntArray:
        """Return vertices (..., 2) of the edge opposite a corner, in the triangle's own sense."""
        corner = np.asarray(corner)
        return np.stack(
            [
                self.triangles[triangle, (corner + 1) % 3],
                self.triangles[triangle, (corner + 2) % 3],
            ],
            axis=-1,
        )

    def locate(self, point: FloatArray) -> int:
        """Return index of the triangle that holds a point, or -1 for a point outside the water."""
        corners = self.corners - point
        edges = np.roll(corners, -1, axis=1) - corners
        # Signed distances to the three edges, positive inside; 0 to an edge that is a point.
        apart = _cross(edges, -corners) / np.maximum(np.linalg.norm(edges, axis=2), 1e-300)
        inside = apart.min(axis=1)
        best = int(np.argmax(inside))
        return best if inside[best] >= -_ON_EDGE * float(np.ptp(self.vertices)) else -1


_KEPT: WeakKeyDictionary[Chart, Triangulation] = WeakKeyDictionary()


def triangulation_of(chart: Chart) -> Triangulation:
    """Return the triangulation of a chart's whole water, made once for all plans on the chart."""
    if (kept := _KEPT.get(chart)) is None:
        kept = _KEPT[chart] = triangulate(chart)
    return kept


def triangulate(
    chart: Chart,
    backend: Backend = "shapely",
    closed: shapely.Geometry | None = None,
    beside: float = 0.0,
) -> Triangulation:
    """Triangulate the chart's water, constrained to its edges, without Steiner points.

    `closed` is water that is left out as if it were land; its edges are no hazard, unless land lies
    `beside` them, within so many metres. Raises ParameterError for an unknown backend, or Triangle
    where it is not installed; GeometryError for triangles that don't add up to the water (a chart
    beyond repair).
    """
    if backend not in get_args(Backend):
        raise ParameterError(f"backend = {backend!r} is not one of {', '.join(get_args(Backend))}")
    if backend == "triangle" and find_spec("triangle") is None:
        raise ParameterError(
            "backend = 'triangle' needs the package triangle, which is not installed; "
            "pip install triangle, or choose 'shapely'"
        )
    water = chart.water
    if closed is not None and not closed.is_empty:
        water = chart.less(water, closed)
    if water.is_empty:
        raise UnreachableError("the current is as strong as the vessel on all of the water")
    corners = (
        _by_triangle(water, chart.precision)
        if backend == "triangle"
        else _by_shapely(shapely.get_parts(water))
    )
    shapely.prepare(water)
    corners = corners[shapely.contains_xy(water, corners.mean(axis=1))]
    missing = water.area - np.abs(_area(*corners.swapaxes(0, 1))).sum() / 2
    if abs(missing) > 1e-6 * chart.extent.area:
        raise GeometryError(
            f"chart: its triangles miss {missing:g} m² of {water.area:g} m² of water; "
            "simplify or buffer the no-go zone so that no vertices nearly coincide"
        )
    vertices, triangles, neighbours = _joined(corners)
    hazardous = _hazardous(chart, closed, vertices, triangles, neighbours, beside)
    return Triangulation(vertices, triangles, neighbours, hazardous)


def triangulate_tiles(tiles: Sequence[shapely.Polygon]) -> Triangulation:
    """Triangulate water in tiles that meet along whole edges; no edge is a hazard.

    Their common edges are edges of triangles. GEOS's time grows with the square of the vertices: a
    long coast in tiles takes seconds, not minutes.
    """
    vertices, triangles, neighbours = _joined(_by_shapely(tiles))
    return Triangulation(vertices, triangles, neighbours, np.zeros(triangles.shape, dtype=bool))


def _joined(corners: FloatArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Return vertices (v, 2) of triangles (t, 3, 2), and (t, 3) their indices and neighbours."""
    is_clockwise = _area(*corners.swapaxes(0, 1)) < 0
    corners[is_clockwise] = corners[is_clockwise][:, ::-1]
    vertices, triangles = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    return vertices, triangles, _neighbours(triangles)


def _by_triangle(water: shapely.Geometry, precision: float) -> FloatArray:
    """Return corners (t, 3, 2) by Triangle: of the convex hull without walled-off parts."""
    import triangle  # an extra: only where it is installed

    rings = [
        shapely.get_coordinates(ring)[:-1]
        for polygon in shapely.get_parts(water)
        for ring in (polygon.exterior, *polygon.interiors)
    ]
    segments, start = [], 0
    for ring in rings:
        index = np.arange(start, start + len(ring))
        segments.append(np.column_stack([index, np.roll(index, -1)]))
        start += len(ring)
    # Rings may share vertices (islands that touch), which Triangle must see once.
    vertices, again = np.unique(np.concatenate(rings), axis=0, return_inverse=True)
    edges = np.unique(np.sort(again.reshape(-1)[np.concatenate(segments)], axis=1), axis=0)
    # Triangle works with absolute tolerances: centre and scale to about one.
    middle, size = vertices.mean(axis=0), np.ptp(vertices, axis=0).max()
    result = triangle.triangulate({"vertices": (vertices - middle) / size, "segments": edges}, "p")
    if len(result["vertices"]) != len(vertices):
        raise GeometryError(
            "chart: the no-go zone's edges cross each other after snapping to "
            f"{precision:g} m; simplify the polygons"
        )
    return np.asarray(vertices[result["triangles"]])


def _by_shapely(water: Sequence[shapely.Polygon]) -> FloatArray:
    """Return corners (t, 3, 2) by GEOS's constrained Delaunay triangulation."""
    cells = shapely.get_parts(
        [shapely.constrained_delaunay_triangles(polygon) for polygon in water]
    )
    return np.array(shapely.get_coordinates(cells).reshape(-1, 4, 2)[:, :3])


def _neighbours(triangles: IntArray) -> IntArray:
    """Return neighbours (t, 3) by matching the sorted vertex pairs of all edges."""
    pairs = np.stack([triangles[:, [1, 2]], triangles[:, [2, 0]], triangles[:, [0, 1]]], axis=1)
    keys = np.sort(pairs.reshape(-1, 2), axis=1)
    order = np.lexsort((keys[:, 1], keys[:, 0]))
    same = (keys[order][1:] == keys[order][:-1]).all(axis=1)
    one, other = order[:-1][same], order[1:][same]
    neighbours = np.full(len(keys), -1, dtype=np.int64)
    neighbours[one], neighbours[other] = other // 3, one // 3
    return neighbours.reshape(-1, 3)


def _hazardous(
    chart: Chart,
    closed: shapely.Geometry | None,
    vertices: FloatArray,
    triangles: IntArray,
    neighbours: IntArray,
    beside: float,
) -> BoolArray:
    """Mark the edges (t, 3) with no triangle behind them that lie on land.

    The edge of the extent and the edge of closed water are not land, unless it lies beside them.
    """
    hazardous = neighbours < 0
    triangle, corner = np.nonzero(hazardous)
    ends = vertices[
        np.stack(
            [triangles[triangle, (corner + 1) % 3], triangles[triangle, (corner + 2) % 3]], axis=-1
        )
    ]
    middles = shapely.points(ends.mean(axis=1))
    # A midpoint on an edge is off by the snapping grid at most.
    edges = [chart.extent.exterior] if closed is None else [chart.extent.exterior, closed.boundary]
    shapely.prepare(edges)
    is_open = [shapely.dwithin(edge, middles, 4 * chart.precision) for edge in edges]
    if beside and closed is not None:
        shapely.prepare(chart.hard_no_go)
        is_open[1] &= ~shapely.dwithin(chart.hard_no_go, shapely.linestrings(ends), beside)
    hazardous[triangle, corner] = ~np.any(is_open, axis=0)
    return hazardous


def _area(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Return twice the signed area (...) of triangles abc, positive anticlockwise."""
    return _cross(b - a, c - a)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross product (...) of plane vectors (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def overpowered_water(voyage: Voyage) -> shapely.Geometry:
    """Return the water where the current is always at least as strong as the vessel is fast.

    It is bounded by a contour of the table's currents, lowered by the error of the table.
    """
    table, chart, speed = voyage.table, voyage.chart, voyage.vessel.speed
    weakest, _ = weakest_and_strongest(table)
    level = float(np.clip(speed - table.error, _AT_LEAST * speed, _AT_MOST * speed))
    if weakest.max() < level:
        return shapely.MultiPolygon()
    cell = float(max(np.diff(table.x).max(), np.diff(table.y).max()))
    zone = _at_least(table.x, table.y, weakest, level).simplify(_TOLERANCE * cell)
    endpoints = shapely.points(voyage.stops)
    kept_open = shapely.union_all(shapely.buffer(endpoints, _OPEN_RADIUS * cell))
    closed = shapely.difference(chart.water, kept_open)
    parts = shapely.get_parts(shapely.intersection(zone, closed, grid_size=chart.precision))
    # Where the zone only touches the shore, the grid leaves lines and points.
    return shapely.multipolygons(parts[shapely.get_type_id(parts) == shapely.GeometryType.POLYGON])


def overpowering_below(strength: float, error: float) -> float:
    """Return the vessel's speed (m/s) up to which a current counts as overpowering.

    The current's `strength` and its table's `error` are in m/s.
    """
    return min(max(strength / _AT_MOST, strength + error), strength / _AT_LEAST)


def _at_least(x: FloatArray, y: FloatArray, values: FloatArray, level: float) -> shapely.Geometry:
    """Return where values (ny, nx) at nodes, linear between them, are a level or more."""
    contours = contour_generator(x, y, values, fill_type=FillType.OuterOffset)
    polygons = [
        shapely.Polygon(outer, holes)
        for points, offsets in zip(*contours.filled(level, np.inf), strict=True)
        for outer, *holes in [np.split(points, offsets[1:-1])]
    ]
    # Two outlines may meet in a point.
    return shapely.union_all([shapely.make_valid(polygon) for polygon in polygons])
