"""Choices of speeds, and the latest arrival that the planner is given.

The planner computes durations in the plane. In a steady current the true duration differs a little,
according to the plane's point scale along the route. The planner's latest arrival is therefore set
so early that all routes arrive in time.
"""

from collections.abc import Callable, Mapping

import numpy as np
import shapely

import renew
from pipeline.model import Scene, SpeedChoice
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import Season

# If the best route is early by more than the first share of its duration, it is planned again with
# the second share as a reserve, because routes shift a little.
_EARLY, _RESERVE = 1e-3, 2e-5
# Number of points at which the point scale is computed: along the chart's edge, and along each side
# of a lattice.
_EDGE_POINTS, _LATTICE = 400, 40


def speed_choices(scenario: Scenario) -> Mapping[str, SpeedChoice]:
    """Return each season's choice of speeds, if any; its times count from the first departure."""
    found = {season.name: _speed_choice(season) for season in scenario.seasons}
    return {name: choice for name, choice in found.items() if choice is not None}


def _speed_choice(season: Season) -> SpeedChoice | None:
    """Return the choice of speeds of a season, or None."""
    begin, end = season.first_departure, season.arrive_by
    if season.speed is None or begin is None or end is None:
        return None
    return SpeedChoice(season.speed.least, season.speed.most, (end - begin).total_seconds())


def true_duration_s(route: renew.Route, scene: Scene, season: str) -> float:
    """Return a route's true duration, s, corrected for the plane's point scale along it.

    In a changing current it is the planner's duration, with which the current was read.
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
    """Plan a season with a choice of speeds; return the plan and the planner's latest arrival, s.

    All routes arrive in time at true scale. The best is early by less than a thousandth of its
    duration, unless fuel is least even earlier or the second plan has another best route.
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
    """Return an upper bound of true duration divided by planned duration on the chart.

    In a changing current it is 1, because the planner's times are those of the current.
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
