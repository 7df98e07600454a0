"""Water whose current outruns the vessel: no-go for it, though no land lies there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from renew.chart import Chart
    from renew.table import Table

# The outline of cells is a staircase. It is drawn in by so many cells and then straightened by a
# little less, so that it never reaches over water that can be sailed.
_DRAWN_IN, _STRAIGHTENED = 1.0, 0.9


def overpowering_water(table: Table, speed: float, chart: Chart) -> BaseGeometry:
    """Water where the current is at least as strong as the vessel is fast, as one geometry.

    It lies well inside of the true one: of cells with all four nodes that strong, the rim is left
    out. What the rim is like a path finds out for itself (:mod:`renew.viterbi`).
    """
    strong = np.linalg.norm(table.uv, axis=-1) >= speed
    cells = strong[1:, 1:] & strong[1:, :-1] & strong[:-1, 1:] & strong[:-1, :-1]
    row, column = np.nonzero(cells)
    if not len(row):
        return shapely.MultiPolygon()
    x, y = table.x, table.y
    squares = shapely.box(x[column], y[row], x[column + 1], y[row + 1])
    cell = float(max(np.diff(x).max(), np.diff(y).max()))
    core = shapely.coverage_union_all(squares).buffer(-_DRAWN_IN * cell, join_style="mitre")
    return shapely.intersection(
        core.simplify(_STRAIGHTENED * cell), chart.water, grid_size=chart.precision
    )
