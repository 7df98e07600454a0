"""Forward simulation of hard-over turns along a route, to see that the vessel can turn away.

At points along the route the rudder goes hard over to port and to starboard, and the vessel
turns a full circle while the current carries it: once in the field as it is, and again in draws
of the field's spread over the water that the turn sweeps. A turn that touches the hard no-go
zone L is a collision.

For the report, the reach of such turns is also drawn at the place where a route comes nearest to
land.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
import shapely

from renew._types import BoolArray, FloatArray
from renew.errors import ParameterError, check_kind, is_finite, shown
from renew.inputs.chart_and_vessel import Chart, Vessel
from renew.inputs.current import (
    CurrentField,
    CurrentLike,
    TabulatedCurrent,
    as_field,
    sample_statistics,
)
from renew.inputs.options import Drift, check_seed, check_turns
from renew.kernels.turn_tracks import TurnsBegun, flown_by_table
from renew.results import Route
from renew.turns import turn_reach
from renew.voyage.fuel import as_path, ground_speed, reading_times, speeds_along, speeds_by_leg
from renew.voyage.voyage import early_and_late

# Number of headings of a full turn, one every 10 degrees: by the midpoint rule the track is within
# 0.1 % of the radius.
_TURN_STEPS = 36
# Number of draws of the field's spread for each point and side, besides the field itself.
_DRAWS = 4
# Number of points on each ring over which that spread is taken.
_RING = 8


class HasPath(Protocol):
    """Any object with a path (n, 2) in metres: a Route, or a route of another planner."""

    @property
    def path(self) -> FloatArray:
        """Polyline (n, 2) in metres."""
        ...


@dataclass(frozen=True, slots=True)
class Contingency:
    """Outcome of the turns along a route.

    Attributes
    ----------
    trials : turns simulated.
    collisions : turns that touched the no-go zone.
    points : (n, 2) metres, where turns began.
    collided : (n,) True where at least one turn of that point collided.
    """

    trials: int
    collisions: int
    points: FloatArray
    collided: BoolArray


def contingency(
    route: HasPath,
    chart: Chart,
    current: CurrentLike,
    vessel: Vessel,
    *,
    spacing: float = 1.0,
    seed: int = 0,
    departure: float | None = None,
    lateness: float = 0.05,
    min_lateness: float = 0.0,
    drift: Drift = "projected",
    speeds: FloatArray | None = None,
) -> Contingency:
    """Simulate full hard-over turns to both sides from points along a route.

    In a current that changes the clock runs: turns begin when the vessel passes, and when it is
    early and late by a share of the time under way.

    Parameters
    ----------
    route : Route
        Anything with a `path` (n, 2) in metres.
    chart : Chart
        No turn may touch its no-go zone; it need not be the chart planned on.
    current : CurrentField or callable
        The field in which turns are simulated.
    vessel : Vessel
        Gives v and ω.
    spacing : float
        Distance between points along the route (m).
    seed : int
        Seed of the draws of the field's spread.
    departure : float
        When the route is begun (s), on the clock of a current that changes; by default as it was
        planned, or at 0.
    lateness : float
        Share of the time since departure by which the vessel may be early or late.
    min_lateness : float
        Least time (s) by which it may be early or late.
    drift : {"projected", "crab"}
        Drift model by which the time of passage is computed.
    speeds : array_like, optional
        Speeds through water (n - 1,), m/s, at which the legs are sailed and turns are simulated; by
        default the speeds chosen for the route, or the vessel's.

    Returns
    -------
    Contingency
        Trials, collisions and where.

    Raises
    ------
    ParameterError
        No route, chart or vessel, or figures out of range.
    """
    field, path = as_field(current), as_path(getattr(route, "path", None))
    length, lates = shapely.LineString(path).length, (lateness, min_lateness)
    check_turns(chart, vessel, length, spacing=spacing, seed=seed, late=lates)
    if departure is None:
        departure = getattr(route, "times", (0.0,))[0]
    if not is_finite(departure):
        raise ParameterError(f"departure = {shown(departure)} s must be finite")
    points, course = stations(path, spacing)
    if speeds is None:
        speeds = getattr(route, "speeds", None)
    own = speeds_by_leg(speeds, vessel, len(path) - 1)
    speed = speeds_along(points, path, own)
    vessel = chart.turning(replace(vessel, speed=float(own.max())))
    times = reading_times(points, field, vessel, drift, departure, speed[:-1], chart)
    passed: tuple[FloatArray, ...] = (times,)
    if not field.is_steady:
        early, late = early_and_late(times, departure, lateness, min_lateness)
        passed = (early, times, late)
    # Only turns within reach of land can touch it; the others are counted, not simulated.
    near = np.zeros(len(points), dtype=bool)
    if chart.no_go:
        tree = shapely.STRtree(chart.no_go)
        reach = turn_reach.TurnReach.of(field.table(chart.bounds), vessel)
        found = tree.query(shapely.points(points), predicate="dwithin", distance=reach(points))
        near[np.unique(found[0])] = True
    hits = np.zeros(len(points), dtype=np.int64)
    deviations = _drawn_deviations(len(points), seed)
    for begin in passed:
        begun = TurnsBegun(points[near], course[near], begin[near], speed[near])
        turns = fly_turns(begun, field, vessel, deviations[near])
        if chart.no_go and near.any():
            hits[near] += _touching(turns, tree).sum(axis=1)
    return Contingency(
        trials=2 * (1 + _DRAWS) * len(points) * len(passed),
        collisions=int(hits.sum()),
        points=points,
        collided=hits > 0,
    )


def _drawn_deviations(count: int, seed: int) -> FloatArray:
    """Return deviations (count, 1 + draws, 2) of speed and direction: none, then drawn ones."""
    deviations = np.random.default_rng(seed).standard_normal((count, 1 + _DRAWS, 2))
    deviations = np.clip(deviations, -turn_reach.MAX_DEVIATIONS, turn_reach.MAX_DEVIATIONS)
    deviations[:, 0] = 0.0
    return deviations


def fly_turns(
    begun: TurnsBegun,
    field: CurrentField,
    vessel: Vessel,
    deviations: FloatArray,
    steps: int = _TURN_STEPS,
) -> FloatArray:
    """Return tracks (n, turns, steps + 1, 2) of full turns.

    Each of the draws, to either side, is simulated in the field perturbed by `deviations` (n or 1,
    draws, 2): multiples of the spread of its speed and of its direction.
    """
    points, course, times, speeds = begun
    heading = crab_heading(points, course, field, speeds, times)
    changes = perturbations(points, field, vessel, deviations, times)
    if isinstance(field, TabulatedCurrent):
        flown = flown_by_table(begun, heading, changes, field.nodes, vessel.turn_rate, steps)
        return np.asarray(flown)
    return _flown(begun, heading, changes, field, vessel, steps)


def _flown(
    begun: TurnsBegun,
    heading: FloatArray,
    changes: tuple[FloatArray, FloatArray],
    field: CurrentField,
    vessel: Vessel,
    steps: int,
) -> FloatArray:
    """Return tracks (n, turns, steps + 1, 2) in any field, perturbed by `changes` (n, draws).

    Integrated by the midpoint rule; each draw turns to port, then to starboard.
    """
    (points, _, times, speeds), (speed_change, direction_change) = begun, changes
    side = np.array([1.0, -1.0])
    shape = (len(points), speed_change.shape[1], 2)
    position = np.broadcast_to(points[:, None, None], (*shape, 2)).copy()
    step = vessel.turn_period / steps
    track = [position]
    for i in range(steps):
        now = times[:, None, None] + i * step
        middle = heading[:, None, None] + side * vessel.turn_rate * step * (i + 0.5)
        through = np.stack([np.cos(middle), np.sin(middle)], axis=-1)
        through *= speeds[:, None, None, None]
        through = np.broadcast_to(through, position.shape)
        half = position + step / 2 * (
            through + _perturbed(field.velocity(position, now), speed_change, direction_change)
        )
        position = position + step * (
            through
            + _perturbed(field.velocity(half, now + step / 2), speed_change, direction_change)
        )
        track.append(position)
    return np.stack(track, axis=-2).reshape(len(points), 2 * speed_change.shape[1], steps + 1, 2)


def _touching(turns: FloatArray, tree: shapely.STRtree) -> BoolArray:
    """Whether each track (n, turns, steps, 2) touches a polygon of the tree: (n, turns)."""
    touched = np.zeros(turns.shape[0] * turns.shape[1], dtype=bool)
    lines = shapely.linestrings(turns.reshape(-1, *turns.shape[2:]))
    touched[np.unique(tree.query(lines, predicate="intersects")[0])] = True
    return touched.reshape(turns.shape[:2])


def stations(path: FloatArray, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Return points (n, 2) every `spacing` metres along a path, and the course (n,) there, rad."""
    legs = np.diff(path, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    is_leg = lengths > 0
    path, legs, lengths = path[np.append(is_leg, True)], legs[is_leg], lengths[is_leg]
    if not len(legs):
        return path[:1], np.zeros(1)
    begin = np.concatenate([[0.0], np.cumsum(lengths)])
    along = np.append(np.arange(0.0, begin[-1], spacing), begin[-1])
    leg = np.clip(np.searchsorted(begin, along, side="right") - 1, 0, len(legs) - 1)
    place = (along - begin[leg]) / lengths[leg]
    return path[leg] + place[:, None] * legs[leg], np.arctan2(legs[leg, 1], legs[leg, 0])


def crab_heading(
    points: FloatArray,
    course: FloatArray,
    field: CurrentField,
    speeds: FloatArray,
    times: FloatArray,
) -> FloatArray:
    """Return heading (n,) that holds the course in the current, or the course where none does."""
    tangent = np.stack([np.cos(course), np.sin(course)], axis=-1)
    velocity = field.velocity(points, times)
    speed = ground_speed(velocity, tangent, speeds, "crab")
    through = np.where((speed > 0)[:, None], speed[:, None] * tangent - velocity, tangent)
    return np.arctan2(through[:, 1], through[:, 0])


def perturbations(
    points: FloatArray,
    field: CurrentField,
    vessel: Vessel,
    deviations: FloatArray,
    times: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return perturbations (n, draws) of the field's speed (m/s) and direction (rad) at times (n,).

    The field's spread is taken on rings within the turning circle's diameter.
    """
    if not deviations.any():
        none = np.zeros((len(points), deviations.shape[1]))
        return none, none
    angle = 2 * np.pi * np.arange(_RING) / _RING
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    reach = 2 * vessel.turning_radius
    around = np.concatenate([np.zeros((1, 2)), ring * reach / 2, ring * reach])
    spread = sample_statistics(field.velocity(points[:, None] + around, times[:, None]))
    return (
        spread.speed_std[:, None] * deviations[..., 0],
        spread.direction_std[:, None] * deviations[..., 1],
    )


def _perturbed(
    velocity: FloatArray, speed_change: FloatArray, direction_change: FloatArray
) -> FloatArray:
    """Return velocities (n, draws, sides, 2) with speed and direction changed by (n, draws)."""
    speed = np.linalg.norm(velocity, axis=-1)
    factor = np.maximum(0.0, speed + speed_change[..., None]) / np.where(speed > 0, speed, 1.0)
    cos = np.cos(direction_change)[..., None] * factor
    sin = np.sin(direction_change)[..., None] * factor
    u, v = velocity[..., 0], velocity[..., 1]
    return np.stack([u * cos - v * sin, u * sin + v * cos], axis=-1)


# Number of draws of the reach of turns at the tightest place: enough for a smooth picture.
_DRAWS_OF_REACH = 4096


class Tightest(NamedTuple):
    """The place of a route that is nearest to a padded edge.

    Attributes
    ----------
    point : (2,) metres, on the route.
    edge : (2, 2) metres, the constrained edge nearest to it.
    heading : rad, of the route there.
    padding : of the edge (m).
    turns : the padding that hard-over turns need there (m); `padding` is wider by a clearance.
    gap : from the point to the edge (m).
    reaches : (n,) m, how far hard-over turns from there reach towards the edge, the worse of both
        sides, at the speed sailed there, in draws of the current around the place, within a turning
        circle's diameter, and of headings about this one.
    """

    point: FloatArray
    edge: FloatArray
    heading: float
    padding: float
    turns: float
    gap: float
    reaches: FloatArray


def tightest(
    route: Route, current: CurrentLike, vessel: Vessel, *, seed: int = 0
) -> Tightest | None:
    """Find where a route is nearest to land and draw the reach of turns there.

    Parameters
    ----------
    route : Route
        As planned.
    current : CurrentField or callable
        The current in which it was planned.
    vessel : Vessel
        The vessel for which it was planned.
    seed : int
        Seed of the draws.

    Returns
    -------
    Tightest or None
        Edges whose padding reaches over the start or the goal are left out, as harbours lie there.
        None where no other edge is padded.
    """
    check_kind("route", route, Route)
    check_kind("vessel", vessel, Vessel)
    check_seed(seed)
    field = as_field(current)
    edges, padding = route.padding_used[:, :4].reshape(-1, 2, 2), route.padding_used[:, 4]
    lines = shapely.linestrings(edges)
    endpoints = shapely.points(route.path[[0, -1]])
    padded = (padding > 0) & (shapely.distance(lines[:, None], endpoints) >= padding[:, None]).all(
        axis=1
    )
    if not padded.any():
        return None
    way = shapely.LineString(route.path)
    gaps = np.where(padded, shapely.distance(lines, way), np.inf)
    # Of an edge and its pieces, whose padding is for a clearance, the one with the widest padding.
    nearest = int(np.lexsort((-padding, np.round(gaps, 9)))[0])
    on_way = shapely.get_point(shapely.shortest_line(way, lines[nearest]), 0)
    along = float(shapely.line_locate_point(way, on_way))
    point = shapely.get_coordinates(shapely.line_interpolate_point(way, along))[0]
    passed = np.cumsum(np.linalg.norm(np.diff(route.path, axis=0), axis=1))
    leg = min(int(np.searchsorted(passed, along)), len(passed) - 1)
    east, north = route.path[leg + 1] - route.path[leg]
    course = np.arctan2(north, east)
    angle = course + 2 * np.pi * np.arange(3) / 3
    around = point + 2 * vessel.turning_radius * np.column_stack([np.cos(angle), np.sin(angle)])
    when = np.interp(along, np.concatenate([[0.0], passed]), route.times)
    asked = turn_reach.TurnsAtEdges(
        field.statistics(around[None], np.array([[when, when + vessel.turn_period]])),
        np.array([course]),
        np.zeros(1, dtype=np.int64),
        turn_reach.normals_away(edges[[nearest]], point[None]),
        replace(vessel, speed=float(route.speeds[leg])),
    )
    return Tightest(
        point=point,
        edge=edges[nearest],
        heading=float(course),
        padding=float(padding[nearest]),
        turns=float(route.turn_padding[nearest]),
        gap=float(gaps[nearest]),
        reaches=turn_reach.TurnSampler(seed, _DRAWS_OF_REACH).reaches(asked)[0],
    )
