"""Compute a lower bound on the fuel of ways on the other side of the main island.

The best route crosses a line from the main island to the chart's edge; no route on the island's
other side crosses it. A strip along that line is treated as land. The lower bound on fuel
(:mod:`renew.bounds.fuel_lower_bound`) then holds for every way that avoids the strip, however close
to land. If the bound is above the best route's fuel, no such way is better.
"""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import shapely
from shapely import LineString

import renew
from pipeline.model import Evaluation, Scene, SeasonPlan, SideBound
from pipeline.scenario.model import PlannerOptions
from pipeline.stages.workers.local_cluster import cores
from renew.bounds.fuel_lower_bound import fuel_lower_bound
from renew.errors import PlanningError
from renew.inputs.current import as_field
from renew.voyage.voyage import NO_CHOICE, SpeedChoice, Voyage, Waters

# Number of lines from the island, in all directions; the suitable one with the least area is used.
_DIRECTIONS = 72
# Numbers of cells of the bound's grid, tried in turn until the side is proven. With few cells, the
# front passes through narrow islands: the bound stays valid, but is lower. Around Palawan, 16,000
# cells prove no season, and the larger number proves the summer.
_CELLS = (16_000, 160_000)
# Width of the strip, as a share of the square root of the chart's area: three cells of the finer
# grid.
_WIDTH = 3 / math.sqrt(_CELLS[-1])


def side_bounds(
    scene: Scene, plans: Sequence[SeasonPlan], evaluation: Evaluation, options: PlannerOptions
) -> tuple[SideBound, ...]:
    """Bound the fuel of ways on the other side, for each season with routes on both sides."""

    def bound(plan: SeasonPlan) -> SideBound:
        return SideBound(plan.season, _bound(scene, plan, evaluation, options))

    # Threads run in parallel here, because most of the work is compiled code.
    with ThreadPoolExecutor(max_workers=cores()) as pool:
        return tuple(one for one in pool.map(bound, plans) if math.isfinite(one.fuel))


def _bound(
    scene: Scene, plan: SeasonPlan, evaluation: Evaluation, options: PlannerOptions
) -> float:
    """Return a lower bound on the fuel of ways on the other side; inf if there is none."""
    rows = [row for row in evaluation.routes if row.season == plan.season]
    paths = [shapely.LineString(route.path) for route in plan.ranked_routes]
    others = [
        path
        for row, path in zip(rows, paths, strict=True)
        if row.main_passage != rows[0].main_passage
    ]
    strip = _strip(scene, paths[0], others, evaluation) if others else None
    if strip is None:
        return math.inf
    extent = scene.chart.extent
    # Like the optimality gap's bound, this one uses the land without margin or padding.
    water = shapely.difference(scene.chart.open_water, strip)
    try:
        voyage = Voyage(
            Waters(
                renew.Chart(extent, [shapely.difference(extent, water)]),
                as_field(scene.currents[plan.season]),
            ),
            scene.vessel_in(plan.season),
            scene.start,
            scene.goal,
            options.drift,
            via=scene.via,
            choice=_choice(scene, plan),
        )
        enough, proven = plan.ranked_routes[0].fuel, 0.0
        # With chosen speeds in a changing current the bound is loose on any grid.
        is_loose = voyage.has_price and not voyage.current.is_steady
        for cells in _CELLS[: 1 if is_loose else None]:
            proven = max(proven, fuel_lower_bound(voyage, cells, enough))
            if proven > enough:
                break
    except PlanningError:
        return math.inf
    return proven


def _choice(scene: Scene, plan: SeasonPlan) -> SpeedChoice:
    """Return the season's choice of speeds, with a price of time.

    The bound holds at any price (weak duality). The best price is nearly the slope of fuel over
    arrival time at the best route's arrival.
    """
    speeds, planned = scene.speeds.get(plan.season), plan.plan
    if speeds is None or planned is None or planned.trade_off is None:
        return NO_CHOICE
    arrivals, fuels = planned.trade_off.arrivals, planned.trade_off.fuels
    if len(arrivals) < 2:
        return NO_CHOICE
    slope = np.interp(planned.best.times[-1], arrivals, np.gradient(fuels, arrivals))
    return SpeedChoice(speeds.least, max(0.0, -float(slope)), plan.arrive_by_s)


def _strip(
    scene: Scene, best: LineString, others: Sequence[LineString], evaluation: Evaluation
) -> shapely.geometry.base.BaseGeometry | None:
    """Return the smallest strip from the main island to the chart's edge that `best` crosses.

    No other route meets the strip, and all stops lie outside. None if there is no such strip.
    """
    main = next(iter(evaluation.islands), None)
    if main is None:
        return None
    extent, island = scene.chart.extent, shapely.Point(main.x, main.y)
    reach, half = extent.length, _WIDTH * math.sqrt(extent.area) / 2
    ends = shapely.points(scene.stops)
    strips = []
    for angle in 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS:
        far = (main.x + reach * math.cos(angle), main.y + reach * math.sin(angle))
        line = shapely.intersection(shapely.LineString([island, far]), extent)
        crossings = shapely.get_num_geometries(shapely.intersection(line, best))
        strip = line.buffer(half, cap_style="flat")
        if (
            line.geom_type == "LineString"
            and shapely.intersects(line, best)
            and crossings % 2 == 1
            and not shapely.intersects(strip, [*others, *ends]).any()
        ):
            strips.append(strip)
    return min(strips, key=lambda strip: strip.area, default=None)
