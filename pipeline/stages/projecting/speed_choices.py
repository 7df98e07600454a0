"""Choices of speeds, and the conversion of an arrival to the planner's clock.

The planner computes durations in the plane. In a steady current the true duration differs a little,
by the plane's point scale along the route: so the planner's arrival is set early enough that all
routes arrive in time.
"""

from collections.abc import Callable, Mapping

import numpy as np
import shapely

import renew
from pipeline.model import Scene, SpeedChoice
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import Season

# Share of the time under way by which the best route may arrive earlier than it has to, before it
# is planned once more; and by which it is asked to be earlier then, as routes shift a little.
_EARLY, _RESERVE = 1e-3, 2e-5
# Number of points at which the point scale is looked up: along the chart's edge, and along either
# side of a lattice.
_EDGE_POINTS, _LATTICE = 400, 40


def speed_choices(scenario: Scenario) -> Mapping[str, SpeedChoice]:
    """Choices of speeds by season, of those that have one, from the first departure on."""
    found = {season.name: _speed_choice(season) for season in scenario.seasons}
    return {name: choice for name, choice in found.items() if choice is not None}


def _speed_choice(season: Season) -> SpeedChoice | None:
    """Choice of speeds of a season; None if it has none."""
    begin, end = season.first_departure, season.arrive_by
    if season.speed is None or begin is None or end is None:
        return None
    return SpeedChoice(season.speed.least, season.speed.most, (end - begin).total_seconds())


def true_duration_s(route: renew.Route, scene: Scene, season: str) -> float:
    """Return a route's seconds at true scale, corrected for the plane's point scale along it.

    In a changing current they are the planner's own, by whose clock the current was read.
    """
    if not scene.currents[season].is_steady:
        return route.duration
    projection = scene.projection
    time, track = route.trajectory[:, 0], route.trajectory[:, 1:3]
    steps = np.diff(time)
    middles = projection.to_lonlat((track[:-1] + track[1:]) / 2)
    true = steps / projection.point_scale(middles)
    return float(route.duration * projection.scale * true.sum() / steps.sum())


def planned_in_time(
    planned: Callable[[float], renew.Plan], scene: Scene, season: str
) -> tuple[renew.Plan, float]:
    """Plan a season with a choice of speeds; return the plan, and the arrival for the planner.

    All its routes arrive in time at true scale. The best one is early by less than a thousandth of
    its duration, unless another route becomes the best.
    """
    within_s = scene.speeds[season].within_s
    by = within_s / largest_stretch(scene, season)
    plan = planned(by)
    if not scene.currents[season].is_steady:
        return plan, by
    stretch = [true_duration_s(route, scene, season) / route.duration for route in plan.routes]
    is_free = plan.best.duration < (1 - _EARLY) * by
    if is_free or by * stretch[plan.chosen] >= (1 - _EARLY) * within_s:
        return plan, by
    later = within_s / max(stretch) * (1 - _RESERVE)
    closer = planned(later)
    durations = [true_duration_s(route, scene, season) for route in closer.routes]
    return (closer, later) if max(durations) <= within_s else (plan, by)


def largest_stretch(scene: Scene, season: str) -> float:
    """Return an upper bound of the true seconds per second of the planner on the chart.

    In a changing current it is 1: the planner's clock is the current's.
    """
    if not scene.currents[season].is_steady:
        return 1.0
    projection, extent = scene.projection, scene.chart.extent
    edge = shapely.get_coordinates(shapely.segmentize(extent, extent.length / _EDGE_POINTS))
    west, south, east, north = extent.bounds
    x, y = np.linspace(west, east, _LATTICE), np.linspace(south, north, _LATTICE)
    points = np.concatenate([edge, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)])
    least = float(projection.point_scale(projection.to_lonlat(points)).min())
    return projection.scale / least * (1 + _RESERVE)
