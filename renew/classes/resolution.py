"""How closely the nodes of a roadmap stand, and the water in which a path is looked at closer."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely

from renew._compiled import kernel
from renew._types import BoolArray, FloatArray
from renew.classes.triangulation import Triangulation
from renew.voyage.voyage import Voyage

# Number of cells in still water, in small eddies, for each triangle, and at most; and that from
# which legs lead in more directions. In between, cells for each node of a table that would just do.
_SMOOTH, _EDDIES, _PER_TRIANGLE, _MAX_CELLS, _MANY = 1_024, 22_500, 20, 40_000, 5_000
_PER_NODE = 0.1
# By what factor nodes stand closer together where a path is looked at closer, and half the width of
# the water in which it is, in cells.
_CLOSER, _TUBE = 4, 8.0


class Resolution(NamedTuple):
    """How closely nodes stand: about `cells` over the extent, each with legs to those around it.

    Legs lead to nodes at up to `reach` cells along either axis: 16 for a reach of 2, 48 for 4.
    """

    cells: int
    reach: int


def resolution_for(voyage: Voyage, triangulation: Triangulation) -> Resolution:
    """Resolution that tells the classes of a voyage apart: the finer, the more eddies and islands.

    In small eddies legs lead in more directions as well: with few, the wrong valley is taken.
    """
    islands = min(_PER_TRIANGLE * len(triangulation.triangles), _MAX_CELLS)
    if voyage.table.has_small_eddies:
        return Resolution(max(_EDDIES, islands), 4)
    smooth = max(_SMOOTH, round(_PER_NODE * voyage.table.nodes_needed**2))
    return Resolution(max(smooth, islands), 2 if islands < _MANY else 3)


class Tube(NamedTuple):
    """The water beside some paths (n, 2), a few cells of a size (m) to either side."""

    paths: Sequence[FloatArray]
    cell: float

    def holds(self, points: FloatArray) -> BoolArray:
        """Whether it holds points (m, 2)."""
        from scipy.spatial import cKDTree

        distance, _ = cKDTree(self._along).query(points, distance_upper_bound=_TUBE * self.cell)
        return np.asarray(np.isfinite(distance))

    def holds_nodes(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Whether it holds each node (ny, nx) of a grid: far quicker than point by point."""
        return np.asarray(_nodes_near(x, y, self._along, _TUBE * self.cell))

    @property
    def _along(self) -> FloatArray:
        """Points (n, 2) along the paths, a cell apart at most."""
        lines = shapely.segmentize(shapely.MultiLineString(self.paths), self.cell)
        return np.asarray(shapely.get_coordinates(lines))


@kernel
def _nodes_near(x: FloatArray, y: FloatArray, points: FloatArray, distance: float) -> BoolArray:
    """Nodes (ny, nx) of a grid that are closer than a distance (m) to some points (n, 2)."""
    near = np.zeros((len(y), len(x)), dtype=np.bool_)
    for px, py in points:
        first = np.searchsorted(x, px - distance)
        last = np.searchsorted(x, px + distance, side="right")
        for row in range(
            np.searchsorted(y, py - distance), np.searchsorted(y, py + distance, side="right")
        ):
            for column in range(first, last):
                if math.hypot(x[column] - px, y[row] - py) < distance:
                    near[row, column] = True
    return near


def closer_look(
    paths: Sequence[FloatArray], voyage: Voyage, resolution: Resolution
) -> tuple[Resolution, Tube]:
    """Resolution and water in which paths (n, 2) that were found at another are looked at closer.

    Legs lead in many directions: the sides of an islet differ by less than a detour in few.
    """
    xmin, ymin, xmax, ymax = voyage.chart.bounds
    cell = math.sqrt((xmax - xmin) * (ymax - ymin) / resolution.cells) / _CLOSER
    return Resolution(_CLOSER**2 * resolution.cells, 4), Tube(paths, cell)
