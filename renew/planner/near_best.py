"""The water outside which every route needs clearly more than the least fuel, proven.

A route that takes less than U is at a place x no earlier than a lower bound on the time from the
start, φ_start(x), and needs at least φ_goal(x) from there on; see
:mod:`renew.bounds.fuel_lower_bound`, (2). So with U a little above the best route's time, every
route of less than U keeps to the water where φ_start + φ_goal < U. This is necessary, not
sufficient: no route of less than U need lead through all of it.
"""

import numpy as np
import shapely

from renew._types import BoolArray, FloatArray
from renew.bounds.fuel_lower_bound import Front, drop_cells
from renew.bounds.grids import halved, turned_round, whole_grid
from renew.errors import ParameterError, check_kind, is_finite, shown
from renew.results import Plan
from renew.voyage.voyage import Voyage

# Number of cells of the first grid, and largest number of cells that are left on the finest.
_FIRST_CELLS = 8_000
_MOST_CELLS = 20_000
# Number of rounds on each grid.
_ROUNDS = 2


def near_best(plan: Plan, excess: float = 0.01) -> shapely.Geometry:
    """Return the water outside which every route needs more than the best and an excess, proven.

    Parameters
    ----------
    plan : Plan
        In a steady current, without via points or a choice of speeds; as planned, not unpickled.
    excess : float
        Share of the best route's fuel, above 0.

    Returns
    -------
    Geometry
        Polygons (m), along the lines of a grid. Routes are those on the chart's land alone, in the
        planner's drift model, whatever their clearance. Inside, a route may cost more, too.

    Raises
    ------
    ParameterError
        An excess out of range, or a plan of another kind.
    """
    check_kind("plan", plan, Plan)
    if not (is_finite(excess) and excess > 0):
        raise ParameterError(f"excess = {shown(excess)} must be a share above 0, as in 0.01")
    voyage = plan.best.fuel_bound.source
    if (
        not isinstance(voyage, Voyage)
        or not voyage.current.is_steady
        or len(voyage.via)
        or voyage.has_price
    ):
        raise ParameterError(
            "the water near the best route is known in steady currents only, without via points "
            "or chosen speeds, and before the plan was pickled; plan such a voyage"
        )
    most = (1 + excess) * plan.best.fuel / voyage.vessel.fuel_rate
    grid = whole_grid(voyage, _FIRST_CELLS)
    counts, ends = grid.wet.copy(), (voyage.start, voyage.goal)
    while True:
        fronts = Front(grid, *ends), Front(turned_round(grid, grid.departure + most), *ends[::-1])
        for at in range(_ROUNDS):
            for front in fronts:
                if at:
                    front.relax()
                front.advance(counts)
            drop_cells(counts, grid.wet, fronts[0].rise, fronts[1].rise, most)
        if not counts.any() or 4 * counts.sum() > _MOST_CELLS:
            return shapely.intersection(voyage.chart.open_water, _united(grid.x, grid.y, counts))
        grid, counts = halved(voyage, grid, counts)


def _united(x: FloatArray, y: FloatArray, cells: BoolArray) -> shapely.Geometry:
    """Return cells (ny - 1, nx - 1) of a grid as polygons."""
    step = np.diff(cells.astype(np.int8), axis=1, prepend=0, append=0)
    (row, begin), (_, end) = np.nonzero(step == 1), np.nonzero(step == -1)
    return shapely.union_all(shapely.box(x[begin], y[row], x[end], y[row + 1]))
