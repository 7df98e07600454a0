"""Points that lie on no two axes, the cells between them, and the table that they become.

The planner needs a current on axes of longitude and latitude. Curved lines of points and cells of
triangles are both triangles here: each node of the table gets the linear interpolation in the
triangle that holds it. Of values at the middles of cells, the nearest neighbours across the cell's
edges give the slope, as in FVCOM's own scheme (Chen et al. 2003). Nothing is interpolated outside
the triangles, nor from a point without data: so nothing leaks across land.

Components of a staggered grid each have their own points, and meet on the table. Those along the
lines of a grid are turned there, by the local direction of the lines.

xugrid (0.15.3) was tried and is not used. It would replace `_located`, 30 lines: both find half a
million nodes in 0.3 s, but it takes 1.2 s to import, and its tree 16 s to compile at the first use.
Gaps that change, staggered points and the turning would remain here.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline._types import BoolArray, FloatArray, IndexArray, Variable
from pipeline.geo.projection import Bounds, widened

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# Weight of points with data from which a node has a value: half, so that land reaches as far as on
# a regular grid. A little less, as a node midway between a wet and a dry point should have one.
_LEAST_WET = 0.49
# A grid's cell with an edge of this multiple of the median edge is none: it joins both sides of a
# seam, or has a corner with the position 0, 0 that some models give to land.
_TORN = 10.0
# Longest edge of a triangle, degrees: a longer one joins both ends of the globe.
_MAX_EDGE_DEG = 90.0
# Share of a triangle by which rounding may put a node on its edge outside.
_ROUNDING = 1e-9
# Quantile of the cells' sizes that counts as the finest: the least alone may be degenerate.
_FINEST = 0.05
# Largest number of nodes of a table in a region: as many as a model of 500 x 500 cells has, twice.
_MAX_NODES = 500_000
# Longest half of a table's axes, in their steps beyond the region.
_STEPS_BEYOND = 300


# Difference below which coordinates are equal, as a share of a cell: rounding to float32.
SAME_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class Axes:
    """Points on axes, degrees: `lat` (ny,) and `lon` (nx,) along `dims`, in the file's order."""

    dims: tuple[str, str]
    lon: FloatArray
    lat: FloatArray

    def is_same(self, other: "Axes | SourceMesh") -> bool:
        """Whether another grid has the same points, except for rounding."""
        return isinstance(other, Axes) and all(
            own.shape == axis.shape
            and np.abs(own - axis).max() <= SAME_SHARE * np.abs(np.diff(axis)).min()
            for own, axis in ((self.lon, other.lon), (self.lat, other.lat))
        )

    def as_mesh(self) -> "SourceMesh":
        """Return the same points as a mesh."""
        return SourceMesh(self.dims, *np.meshgrid(self.lon, self.lat))


@dataclass(frozen=True, eq=False)
class SourceMesh:
    """Points of values, in degrees, and the cells between them.

    `lon` and `lat` have the shape of the dimensions `dims`: (ny, nx) on the lines of a grid, of
    which the second are those along which a component may be, or (n,). Without lines the corners of
    `triangles` (m, 3) are points, or, for values on cells, the nodes `node_lon` and `node_lat`;
    then `cells` (m,) says in which cell a triangle lies.
    """

    dims: tuple[str, ...]
    lon: FloatArray
    lat: FloatArray
    triangles: IndexArray | None = None
    node_lon: FloatArray | None = None
    node_lat: FloatArray | None = None
    cells: IndexArray | None = None

    def as_mesh(self) -> "SourceMesh":
        """Return itself."""
        return self

    def is_same(self, other: "Axes | SourceMesh") -> bool:
        """Whether another grid has the same points."""
        return (
            isinstance(other, SourceMesh)
            and np.array_equal(self.lon, other.lon, equal_nan=True)
            and np.array_equal(self.lat, other.lat, equal_nan=True)
        )

    @cached_property
    def largest_angle_deg(self) -> float:
        """The largest angle of a grid's lines from east, degrees."""
        x, y = self.lon, self.lat
        east = (np.diff(x, axis=1) + 180.0) % 360.0 - 180.0
        north = np.diff(y, axis=1)
        angle = np.degrees(np.arctan2(north, east * np.cos(np.radians(y[:, 1:]))))
        return float(np.nanmax(np.abs(angle), initial=0.0))

    def extent(self, bounds: Bounds) -> Bounds:
        """Return the bounds of all points, with longitudes around those of some bounds."""
        lon, lat = _around(self.lon, (bounds[0] + bounds[2]) / 2), self.lat
        west, south, east, north = np.nanmin(lon), np.nanmin(lat), np.nanmax(lon), np.nanmax(lat)
        return float(west), float(south), float(east), float(north)

    def step_deg(self, bounds: Bounds) -> float:
        """Return the size of the finest cells in bounds, degrees of latitude; 0 without any."""
        x, y, triangles, _ = self._part(bounds)
        x, y = x[triangles], y[triangles]
        west, south, east, north = bounds
        inside = (x.max(1) > west) & (x.min(1) < east) & (y.max(1) > south) & (y.min(1) < north)
        double_area = np.abs(_cross(x, y)) * np.cos(np.radians(y.mean(axis=1)))
        sizes = np.sqrt(double_area[inside & (double_area > 0)])
        return float(np.quantile(sizes, _FINEST)) if sizes.size else 0.0

    def axes(self, bounds: Bounds) -> tuple[FloatArray, FloatArray, float, float]:
        """Return the axes lon and lat of a table for a region, the finest step and its own.

        The steps are degrees of latitude: that of the cells, or a longer one where the region would
        have too many nodes. The axes end where the points end. They are empty without cells.
        """
        west, south, east, north = bounds
        finest = self.step_deg(bounds)
        if not finest:
            return np.zeros(0), np.zeros(0), 0.0, 0.0
        shrink = np.cos(np.radians((south + north) / 2))
        step = max(finest, float(np.sqrt((east - west) * shrink * (north - south) / _MAX_NODES)))
        extent = self.extent(bounds)
        axes = []
        for side, size in ((0, step / shrink), (1, step)):
            beyond = _STEPS_BEYOND * size
            low = max(extent[side], bounds[side] - beyond)
            high = min(extent[side + 2], bounds[side + 2] + beyond)
            axes.append(size * np.arange(np.ceil(low / size), np.floor(high / size) + 1))
        return axes[0], axes[1], finest, step

    def table(self, lon: FloatArray, lat: FloatArray) -> "Table":
        """Return how the values at the points become those at the nodes of axes, in degrees."""
        from scipy.sparse import csr_array

        x, y, triangles, part = self._part((lon[0], lat[0], lon[-1], lat[-1]))
        node, triangle, shares = _located(x, y, triangles, lon, lat)
        size = lon.size * lat.size
        if self.cells is None:
            count = x.size
            rows, columns = np.repeat(node, 3), triangles[triangle].ravel()
            around = csr_array((shares.ravel(), (rows, columns)), shape=(size, count))
            turn = None
            if self.triangles is None:
                lines = self.lon[part].shape
                turn = _turn(x.reshape(lines), y.reshape(lines), around)
            return Table(part, (lat.size, lon.size), around, around, turn)
        cell = self.cells[triangle]
        shape = (size, self.lon.size)
        own = csr_array((np.ones(node.size), (node, cell)), shape=shape)
        middle_x, middle_y = _around(self.lon, (lon[0] + lon[-1]) / 2), self.lat
        weights = own
        for offset, slope in zip(
            (lon[node % lon.size] - middle_x[cell], lat[node // lon.size] - middle_y[cell]),
            _slopes(middle_x, middle_y, triangles, self.cells),
            strict=True,
        ):
            distance = csr_array((offset, (node, cell)), shape=shape)
            weights = weights + distance @ slope
        return Table(part, (lat.size, lon.size), csr_array(weights), own, None)

    def highest(
        self, lon: FloatArray, lat: FloatArray, read: Callable[[tuple[slice, ...]], FloatArray]
    ) -> FloatArray:
        """Return the highest value around each node (ny, nx) of axes, NaN where none is known.

        It is that of the cell that holds the node, and of all points that are nearest to the node.
        `read` returns the values of a part of the points.
        """
        table = self.table(lon, lat)
        values = read(table.part)
        x, y = (side[table.part].ravel() for side in (self.lon, self.lat))
        values = values.ravel()
        weights = table.around
        count = np.diff(weights.indptr)
        found = np.full(count.size, np.nan)
        if weights.nnz:
            corners = values[weights.indices]
            found[count > 0] = np.fmax.reduceat(corners, weights.indptr[:-1][count > 0])
        x = _around(x, (lon[0] + lon[-1]) / 2)
        column, row = (
            np.rint((side - axis[0]) / (axis[1] - axis[0])) for side, axis in ((x, lon), (y, lat))
        )
        inside = (column >= 0) & (column < lon.size) & (row >= 0) & (row < lat.size)
        node = (row[inside] * lon.size + column[inside]).astype(np.intp)
        np.fmax.at(found, node, values[inside])
        return found.reshape(lat.size, lon.size)

    def _part(self, bounds: Bounds) -> tuple[FloatArray, FloatArray, IndexArray, tuple[slice, ...]]:
        """Return corners x, y (n,), triangles of them, and the part of the points that is read.

        Of a grid of lines that is the part around some bounds. Longitudes are around the bounds'.
        """
        middle = (bounds[0] + bounds[2]) / 2
        if self.triangles is not None:
            lon = self.lon if self.node_lon is None else self.node_lon
            lat = self.lat if self.node_lat is None else self.node_lat
            x = _around(lon, middle)
            return x, lat, _cells_only(x, lat, self.triangles, np.inf), (slice(None),)
        x = _around(self.lon, middle)
        steps = [np.abs(np.diff(side, axis=axis)) for side in (x, self.lat) for axis in (0, 1)]
        reach = [
            2 * float(np.nanquantile(np.concatenate([a.ravel() for a in s]), 0.99))
            for s in (steps[:2], steps[2:])
        ]
        west, south, east, north = widened(bounds, *reach)
        inside = (x >= west) & (x <= east) & (self.lat >= south) & (self.lat <= north)
        part = tuple(_span(np.any(inside, axis=1 - axis)) for axis in (0, 1))
        x, y = x[part], self.lat[part]
        number = np.arange(x.size).reshape(x.shape)
        a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
        halves = np.concatenate(
            [np.stack(half, axis=-1).reshape(-1, 3) for half in ((a, b, c), (a, c, d))]
        )
        triangles = _cells_only(x.ravel(), y.ravel(), halves, _TORN)
        # A point of no cell may have any position, which would bend the lines beside it.
        is_alone = np.ones(x.size, dtype=bool)
        is_alone[triangles] = False
        return np.where(is_alone, np.nan, x.ravel()), y.ravel(), triangles, part


@dataclass(frozen=True, eq=False)
class Table:
    """How values at points become those at the nodes of axes.

    `part` is the part of the points that is read, `shape` that of the nodes. `weights` (nodes,
    points) are used where all points that they name have a value; elsewhere those of `around`,
    which are not negative, of the points that have. `turn` is cosine and sine (nodes,) of the angle
    from east to the lines of a grid.
    """

    part: tuple[slice, ...]
    shape: tuple[int, int]
    weights: "csr_array[Any, Any]"
    around: "csr_array[Any, Any]"
    turn: tuple[FloatArray, FloatArray] | None

    def read(self, variable: Variable, dims: tuple[str, ...]) -> FloatArray:
        """Read the part of a variable (..., points) that is needed; `dims` are the points'."""
        part = variable.isel(dict(zip(dims, self.part, strict=True)))
        return part.load().transpose(..., *dims).values.astype(float)

    @property
    def outside(self) -> BoolArray | None:
        """Nodes (ny, nx) in no cell."""
        return np.asarray((self.around.sum(axis=1) == 0).reshape(self.shape))

    def interpolated(self, values: FloatArray) -> FloatArray:
        """Return values (nt, ...) at the points as those at the nodes (nt, ny, nx), NaN outside."""
        flat = values.reshape(len(values), -1)
        found = _averaged(self.around, flat)
        if self.weights is not self.around:
            linear = (self.weights @ np.nan_to_num(flat).T).T
            lacking = (abs(self.weights) @ (~np.isfinite(flat)).astype(float).T).T > 0
            found = np.where(lacking, found, np.where(np.isfinite(found), linear, np.nan))
        return found.reshape(-1, *self.shape)

    def turned(self, along: FloatArray, across: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return components along a grid's lines and across (nt, ny, nx) as east and north."""
        assert self.turn is not None  # noqa: S101 - only grids of lines have such components
        cos, sin = (part.reshape(self.shape) for part in self.turn)
        return along * cos - across * sin, along * sin + across * cos


def _turn(
    x: FloatArray, y: FloatArray, around: "csr_array[Any, Any]"
) -> tuple[FloatArray, FloatArray]:
    """Return cosine and sine (nodes,) of the angle from east to the lines of a grid (ny, nx).

    The lines are those along the second dimension.
    """
    east, north = np.gradient(x, axis=1) * np.cos(np.radians(y)), np.gradient(y, axis=1)
    size = np.hypot(east, north)
    cos, sin = (_averaged(around, (side / size).reshape(1, -1))[0] for side in (east, north))
    size = np.hypot(cos, sin)
    return cos / size, sin / size


def _averaged(weights: "csr_array[Any, Any]", values: FloatArray) -> FloatArray:
    """Return the mean (nt, nodes) of values (nt, points) that there are; NaN where few are."""
    known = np.isfinite(values)
    filled = np.where(known, values, 0.0)
    found = np.empty((len(values), weights.shape[0]))
    share = np.zeros(0)
    for step, row in enumerate(filled):
        # Most sources have the same gaps at all times.
        if not step or not np.array_equal(known[step], known[step - 1]):
            share = weights @ known[step].astype(float)
            share[share < _LEAST_WET] = np.nan
        found[step] = (weights @ row) / share
    return found


def _around(lon: FloatArray, middle: float) -> FloatArray:
    """Return longitudes within 180 degrees of a middle."""
    return np.asarray(middle + (lon - middle + 180.0) % 360.0 - 180.0)


def _span(chosen: BoolArray) -> slice:
    """Return the slice from the first chosen place to the last."""
    places = np.flatnonzero(chosen)
    return slice(int(places[0]), int(places[-1]) + 1) if places.size else slice(0, 0)


def _cross(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return twice the signed area of triangles with corners x, y (m, 3)."""
    return np.asarray(
        (y[:, 1] - y[:, 2]) * (x[:, 0] - x[:, 2]) + (x[:, 2] - x[:, 1]) * (y[:, 0] - y[:, 2])
    )


def _cells_only(x: FloatArray, y: FloatArray, triangles: IndexArray, torn: float) -> IndexArray:
    """Return triangles without those that are no cells: without position, degenerate, torn."""
    sides_x, sides_y = (side[triangles] - side[triangles[:, [1, 2, 0]]] for side in (x, y))
    longest = np.hypot(sides_x * np.cos(np.radians(y[triangles])), sides_y).max(axis=1)
    if not np.isfinite(longest).any():
        return np.zeros_like(triangles)
    usual = float(np.nanmedian(longest))
    is_cell = (longest <= min(_MAX_EDGE_DEG, torn * usual)) & (
        _cross(x[triangles], y[triangles]) != 0
    )
    return np.where(is_cell[:, None], triangles, 0)


def _located(
    x: FloatArray, y: FloatArray, triangles: IndexArray, lon: FloatArray, lat: FloatArray
) -> tuple[IndexArray, IndexArray, FloatArray]:
    """Return the nodes of axes that lie in triangles, each with one, and its shares (n, 3).

    Each triangle is compared only with the nodes inside its bounds, which the axes give at once.
    """
    corners_x, corners_y = x[triangles], y[triangles]
    first_column, first_row, wide, high = (
        np.searchsorted(axis, corners.min(axis=1))
        if is_first
        else np.searchsorted(axis, corners.max(axis=1), "right")
        - np.searchsorted(axis, corners.min(axis=1))
        for is_first in (True, False)
        for axis, corners in ((lon, corners_x), (lat, corners_y))
    )
    count = wide * high
    triangle = np.repeat(np.arange(count.size), count)
    place = np.arange(triangle.size) - np.repeat(np.cumsum(count) - count, count)
    column = first_column[triangle] + place % wide[triangle]
    row = first_row[triangle] + place // wide[triangle]
    px, py = lon[column], lat[row]
    tx, ty = corners_x[triangle], corners_y[triangle]
    area = _cross(tx, ty)
    with np.errstate(divide="ignore", invalid="ignore"):
        first = (
            (ty[:, 1] - ty[:, 2]) * (px - tx[:, 2]) + (tx[:, 2] - tx[:, 1]) * (py - ty[:, 2])
        ) / area
        second = (
            (ty[:, 2] - ty[:, 0]) * (px - tx[:, 2]) + (tx[:, 0] - tx[:, 2]) * (py - ty[:, 2])
        ) / area
    shares = np.stack([first, second, 1 - first - second], axis=-1)
    inside = np.flatnonzero(shares.min(axis=1) >= -_ROUNDING)
    node, one = np.unique(row[inside] * lon.size + column[inside], return_index=True)
    inside = inside[one]
    return node, triangle[inside], np.clip(shares[inside], 0.0, 1.0)


def _slopes(
    x: FloatArray, y: FloatArray, triangles: IndexArray, cells: IndexArray
) -> "tuple[csr_array[Any, Any], csr_array[Any, Any]]":
    """Return what gives slopes (cells,) along x and y, per degree, of values (cells,) at x, y.

    They are the least-squares slopes to the cells across the edges, and 0 without any.
    """
    from scipy.sparse import coo_array, csr_array

    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    of_cell = np.repeat(cells, 3)
    order = np.lexsort(edges.T)
    shared = np.flatnonzero((np.diff(edges[order], axis=0) == 0).all(axis=1))
    one, other = of_cell[order[shared]], of_cell[order[shared + 1]]
    apart = one != other  # the diagonals of a cell with four corners are in it
    own, next_to = (np.concatenate(pair) for pair in ((one, other), (other, one)))
    own, next_to = own[np.tile(apart, 2)], next_to[np.tile(apart, 2)]
    shrink = np.cos(np.radians(y[own]))
    away = np.stack([(x[next_to] - x[own]) * shrink, y[next_to] - y[own]], axis=-1)
    squares = np.zeros((x.size, 2, 2))
    np.add.at(squares, own, away[:, :, None] * away[:, None, :])
    slope = (np.linalg.pinv(squares, hermitian=True)[own] @ away[:, :, None])[:, :, 0]
    slope[:, 0] *= shrink
    shape = (x.size, x.size)
    rows, columns = np.concatenate([own, own]), np.concatenate([next_to, own])
    along_x, along_y = (
        csr_array(coo_array((np.concatenate([part, -part]), (rows, columns)), shape=shape))
        for part in slope.T
    )
    return along_x, along_y


def corner_triangles(corners: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Divide cells (n, k), whose corners are -1 from the last on, into triangles (m, 3).

    Also returns the cell (m,) of each.
    """
    fans = [
        (
            np.stack([corners[:, 0], corners[:, i], corners[:, i + 1]], axis=-1),
            corners[:, i + 1] >= 0,
        )
        for i in range(1, corners.shape[1] - 1)
    ]
    numbers = np.arange(len(corners))
    return (
        np.concatenate([fan[there] for fan, there in fans]),
        np.concatenate([numbers[there] for _, there in fans]),
    )
