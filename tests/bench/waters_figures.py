"""Figures on waters drawn by a seed, none picked by eye: voyages from harbours and skerries too.

Coasts, ends and vessels are drawn from the whole world's land of OpenStreetMap. Each voyage is
planned as the pipeline does that chooses region, chart and offing, and is then measured by referees
that share no code with the planner: exact buffers of the raw land say whether there is a way, and a
grid Dijkstra and transversals say what the way costs. Sixty waters take an hour:
`python -m tests.bench.waters_figures 0 40 100 120` also writes docs/figures/waters.csv.
"""

import math
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry
from shapely.ops import substring

import renew
from pipeline._types import BoolArray, FloatArray
from pipeline.geo.projection import bounds_of
from pipeline.sources.land import osm
from pipeline.stages.water_grid import (
    FAR_WAY,
    DirectLine,
    widened_by,
)
from tests.bench.drawn_waters import (
    KNOT,
    PEAK_M_S,
    PLACES,
    DrawnWater,
    drawn,
    largest_between,
    sides,
)
from tests.bench.figure import Figure, at_most, record
from tests.oracles import grid_dijkstra, tighten

SEEDS = range(3)
"""The waters of the suite."""

# Cells of the rival's grid along the longer side.
_CELLS = 120
# Distance from the soft zone around an end at which rivals begin, m.
_OUTSIDE = 0.01


def figures() -> Iterator[Figure]:
    """Refusals, fuel beside a rival's, safety and distance from land."""
    for one in chain.from_iterable(water_figures(drawn(seed)) for seed in SEEDS):
        # Pages quote more waters than these.
        yield replace(one, values={})


def water_figures(water: DrawnWater) -> Iterator[Figure]:
    """All figures of a water."""
    name, spec, turns = water.name, water.spec, water.turns_m
    knots, circle = spec.speed_m_s / KNOT, 2 * water.vessel.turning_radius
    distance = DirectLine.between(water.start, water.goal).distance_m / 1000
    text = f"{water.start} to {water.goal}, {distance:.0f} km; {spec.length_m:.0f} m, "
    text += f"{knots:.1f} kn, circle {circle:.0f} m, turns {turns:.0f} m, offing {water.offing:g} m"
    yield Figure(f"{name}: asked", "", text)
    chart = water.simplified()
    started = time.process_time()
    try:
        plan = renew.plan(
            chart,
            water.current,
            water.vessel,
            *water.ends,
            clearance=water.offing,
            narrow_share=0.5,
            distinct_by="auto",
        )
    except renew.PlanningError as error:
        taken = time.process_time() - started
        yield at_most(f"{name}: CPU to a refusal", taken, 20.0, " s", key="most_refusal_s")
        wide, least = (
            water.has_way(width + osm.ACCURACY_M) for width in (turns, turns - _drift(water))
        )
        text = f"a way for turns {wide}, for turns in still water {least}: {str(error)[:300]}"
        values = {"refused": 1.0, "refused_with_a_way": float(wide)}
        yield Figure(f"{name}: refused though there is a way", "False", text, not wide, values)
        return
    taken = time.process_time() - started
    text = f"{len(plan.routes)} in {taken:.1f} s, gap {100 * plan.best.optimality_gap:.2f} %"
    yield Figure(f"{name}: routes", "", text)
    yield from _safety(water, plan)
    yield from _apart(water, chart, plan.best)
    yield from _fuel(water, chart, plan.best)
    yield _far_side(water, plan)


def _far_side(water: DrawnWater, plan: renew.Plan) -> Figure:
    """Whether the far side of the largest island within 1.5 best ways is planned, or left out."""
    voyage = DirectLine.between(water.start, water.goal)
    around = widened_by(bounds_of(voyage.points), voyage.distance_m)
    land = osm.land_polygons(shapely.box(*around), 0.0).polygons
    ends = np.array(water.start), np.array(water.goal)
    island = largest_between(land, around, *ends, FAR_WAY)
    name = f"{water.name}: far side of the largest island, planned or said to be left out"
    if island is None:
        return Figure(name, "", "no island")
    found = sides((np.asarray(route.path) for route in plan.routes), water.plane(island))
    said = water.leaves_out
    text = f"{len(found)} sides of the one at {island[0]:.2f} {island[1]:.2f}, left out {said}"
    is_known = len(found) > 1 or said
    return Figure(name, "True", text, is_known, {"islands": 1.0, "unnamed": float(not is_known)})


def _drift(water: DrawnWater) -> float:
    """How far the current carries the vessel in a turn at most, m."""
    return PEAK_M_S * water.vessel.turn_period


def _safety(water: DrawnWater, plan: renew.Plan) -> Iterator[Figure]:
    """Metres over raw land, and hard-over turns that meet it outside the ends' soft zone."""
    over = sum(water.over_land(route) for route in plan.routes)
    yield at_most(
        f"{water.name}: over the land itself, all routes", over, 0.0, " m", key="over_land"
    )
    hits, trials = 0, 0
    for route in plan.routes:
        spacing = max(route.length / 2000, water.vessel.turning_radius / 2)
        flown = renew.contingency(route, water.raw, water.current, water.vessel, spacing=spacing)
        outside = ~_in_soft_ends(flown.points, route)
        hits += int((flown.collided & outside).sum())
        trials += int(outside.sum())
    text = f"{hits} of {trials:,}"
    values = {"collisions": float(hits), "turns": float(trials)}
    yield Figure(f"{water.name}: places with turns that meet land", "0", text, not hits, values)


def _in_soft_ends(points: FloatArray, route: renew.Route) -> BoolArray:
    """Which points (n, 2) lie in capsules of the soft no-go zone that hold an end."""
    used = route.padding_used
    lines, where = shapely.linestrings(used[:, :4].reshape(-1, 2, 2)), shapely.points(points)
    inside = np.zeros(len(points), dtype=bool)
    for end in (route.path[0], route.path[-1]):
        for at in np.flatnonzero(shapely.distance(shapely.Point(end), lines) < used[:, 4]):
            inside |= shapely.dwithin(lines[at], where, used[at, 4])
    return inside


def _apart(water: DrawnWater, chart: renew.Chart, route: renew.Route) -> Iterator[Figure]:
    """Length of the best route that is too close to land: in narrows, and away from them."""
    offing, land = water.offing, chart.hard_no_go
    if land.is_empty:
        return
    step = max(0.1 * offing, route.length / 3000)
    line = shapely.LineString(route.path)
    along = np.arange(step / 2, line.length, step)
    places = shapely.get_coordinates(shapely.line_interpolate_point(line, along))
    ahead = shapely.get_coordinates(shapely.line_interpolate_point(line, along + 0.01 * step))
    course = (ahead - places) / np.linalg.norm(ahead - places, axis=1)[:, None]
    across = np.stack([-course[:, 1], course[:, 0]], axis=1)
    tree = shapely.STRtree(np.array(chart.no_go, dtype=object))
    shapely.prepare(land)

    def off(points: FloatArray) -> FloatArray:
        where = shapely.points(points.reshape(-1, 2))
        _, found = tree.query_nearest(where, return_distance=True, all_matches=False)
        return np.asarray(found.reshape(points.shape[:-1]))

    own = off(places)
    # Water on a section across the route, on each side up to land or two offings.
    shares = np.linspace(0.0, 2 * offing, 41)
    sides = [off(places[:, None] + sign * shares[:, None] * across[:, None]) for sign in (-1, 1)]
    open_to = [np.logical_and.accumulate(side > 0, axis=1) for side in sides]
    half = np.maximum(*(np.where(o, s, 0).max(axis=1) for o, s in zip(open_to, sides, strict=True)))
    narrow = ~open_to[0][:, -1] & ~open_to[1][:, -1]
    from_ends = np.linalg.norm(places[:, None] - water.ends, axis=2).min(axis=1)
    judged = (from_ends > 3 * offing) & ~_in_soft_ends(places, route)
    asked = np.minimum(np.minimum(0.5 * half, offing), water.turns_m + osm.ACCURACY_M)
    short = narrow & judged & (own < 0.97 * asked)
    yield _length(water, "in narrows, under half the half-width", short, own, places, step)
    near = np.zeros(len(places), dtype=bool)
    if narrow.any():
        spots = shapely.STRtree(shapely.points(places[narrow]))
        near[spots.query(shapely.points(places), predicate="dwithin", distance=3 * offing)[0]] = (
            True
        )
    close = ~near & judged & (own < 0.99 * offing)
    yield _length(water, "away from narrows, under the offing", close, own, places, step)


def _length(
    water: DrawnWater, what: str, short: BoolArray, own: FloatArray, places: FloatArray, step: float
) -> Figure:
    """Metres of the route that are too close, and where it is closest."""
    text = f"{step * short.sum():.0f} m"
    if short.any():
        worst = int(np.where(short, own, np.inf).argmin())
        lon, lat = water.projection.to_lonlat(places[worst])
        text += f", {own[worst]:.0f} m off at {lon:.4f} {lat:.4f}"
    return Figure(f"{water.name}: {what}", "0 m", text, not short.any())


def _fuel(water: DrawnWater, chart: renew.Chart, route: renew.Route) -> Iterator[Figure]:
    """Best fuel beside rivals that keep as far off land as the route had to, and the bound."""
    path = _beyond_soft_ends(route)
    if len(path) < 2:
        return
    zone = _forbidden(chart, route, max(water.offing, water.turns_m))
    low, high = path.min(axis=0), path.max(axis=0)
    room = 0.15 * float((high - low).max()) + 2 * water.offing
    window = shapely.intersection(shapely.box(*(low - room), *(high + room)), water.extent)
    parts = [one for one in shapely.get_parts(shapely.intersection(zone, window)) if one.area > 0]
    rival_chart = renew.Chart(window, [one for one in parts if one.geom_type == "Polygon"])
    xmin, ymin, xmax, ymax = window.bounds
    spacing = max(xmax - xmin, ymax - ymin) / _CELLS
    given = (rival_chart, water.current, water.vessel)
    found, other = grid_dijkstra(*given, path[0], path[-1], spacing, radius=4)
    own, fuels = water.fuel(path), {"grid": math.inf}
    if math.isfinite(found):
        fuels["grid"], _ = tighten(other, *given, spacing=spacing, width=2 * spacing)
    pieces = route.length / PLACES
    fuels["own"], _ = tighten(path, *given, spacing=pieces, width=2 * pieces, rounds=8)
    name = f"{water.name}: fuel beside {', '.join(f'{k} {own / v:.4f}' for k, v in fuels.items())}"
    yield at_most(name, own / min(fuels.values()), 1.003, digits=4, key="most_fuel")
    bare = (water.raw, water.current, water.vessel)
    least, _ = tighten(route.path, *bare, spacing=pieces, width=8 * pieces, rounds=9)
    bound = route.fuel / (1 + route.optimality_gap)
    yield Figure(
        f"{water.name}: bound beside a way along the land",
        "<= 1",
        f"{bound / least:.4f}",
        bound <= least,
        {"most_bound": bound / least},
    )


def _beyond_soft_ends(route: renew.Route) -> FloatArray:
    """A route's path (n, 2) from where it leaves the soft zone of its start to the goal's."""
    used, path = route.padding_used, route.path
    lines = shapely.linestrings(used[:, :4].reshape(-1, 2, 2))
    for _ in range(2):
        holds = shapely.distance(shapely.Point(path[0]), lines) < used[:, 4]
        if len(path) > 1 and holds.any():
            line = shapely.LineString(path)
            soft = shapely.union_all(shapely.buffer(lines[holds], used[holds, 4], quad_segs=64))
            after = shapely.get_parts(shapely.difference(line, soft))
            # Just outside, so that rounding does not leave it inside.
            out = [line.project(shapely.get_point(part, 0)) + _OUTSIDE for part in after]
            rest = substring(line, min(out, default=line.length), line.length)
            path = shapely.get_coordinates(rest)
        path = path[::-1]
    return np.asarray(path)


def _forbidden(chart: renew.Chart, route: renew.Route, width: float) -> BaseGeometry:
    """The land, the route's padded edges, and a width (m) round edges that it does not have."""
    used = route.padding_used
    capsules = shapely.buffer(shapely.linestrings(used[:, :4].reshape(-1, 2, 2)), used[:, 4])
    rings = shapely.get_parts(shapely.boundary(np.array(chart.no_go, dtype=object)))
    edges = np.concatenate(
        [np.empty((0, 4))]
        + [np.hstack([xy[:-1], xy[1:]]) for xy in map(shapely.get_coordinates, rings)]
    )
    known = {tuple(row) for row in np.round(used[:, :4], 1).tolist()}
    others = [
        row
        for row in np.round(edges, 1).tolist()
        if tuple(row) not in known and (*row[2:], *row[:2]) not in known
    ]
    lines = shapely.linestrings(np.array(others).reshape(-1, 2, 2))
    return shapely.union_all([chart.hard_no_go, *capsules, *shapely.buffer(lines, width)])


def totals(waters: Sequence[Sequence[Figure]]) -> dict[str, float]:
    """What pages quote of some waters: sums, and the largest of the figures called most_*."""
    found: dict[str, list[float]] = {"waters": [1.0] * len(waters)}
    for name, value in chain.from_iterable(
        one.values.items() for one in chain.from_iterable(waters)
    ):
        found.setdefault(name, []).append(value)
    return {
        name: max(values) if name.startswith("most_") else sum(values)
        for name, values in found.items()
    }


def main() -> None:
    """Print and record the figures of seeds: from each first up to, but not with, each second."""
    waters = []
    bounds = list(map(int, sys.argv[1:]))
    for seed in chain.from_iterable(map(range, bounds[::2], bounds[1::2])):
        waters.append(list(water_figures(drawn(seed))))
        for one in waters[-1]:
            print(f"{one.verdict or '-'}\t{one.name}\t{one.reached}", flush=True)
        record("waters", totals(waters))


if __name__ == "__main__":
    main()
