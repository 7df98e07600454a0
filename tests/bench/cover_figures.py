"""Figures of ways to havens: what is claimed along routes, the bound from a haven, and turns."""

from __future__ import annotations

import math
import resource
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import replace
from typing import cast

import numpy as np
import shapely

import renew
from renew._types import FloatArray
from renew.bounds.fuel_lower_bound import HavenBound
from renew.request import Request
from tests.bench.figure import Figure, at_most
from tests.clock_oracle import earliest_arrival
from tests.moving_waters import MovingScene, moving_scene
from tests.oracles import grid_dijkstra, leg_times
from tests.strategies import PAPER_VESSEL, SIZE, random_scene

_ROUTES, _PLACES, _SCENES = (4, 20), 50, (20, 200)
"""Routes and scenes of the small and of the whole suite, and places on each route."""
# Distance (m) of havens from land and from the sides, and number of them; spacing of the oracle's
# grids (m), for claims and for the bound; pieces of a path (m).
_OFF_M, _HAVENS, _FINE_M, _COARSE_M, _PIECE_M = 9.0, 3, 5.0, 6.0, 2.0
_LIMITS_S, _STRONGEST = (25.0, 70.0), 0.9
_WITHIN_S, _OFF_SHORE_M = 6 * 3600.0, 1500.0


def figures(*, is_whole: bool) -> Iterator[Figure]:
    """Yield what is claimed along routes beside oracles, and the bound from havens."""
    counts: Counter[str] = Counter()
    seconds: dict[str, float] = defaultdict(float)
    for seed in range(_ROUTES[is_whole]):
        _claims(seed, counts, seconds)
    name = f"{_ROUTES[is_whole]} routes"
    yield _none(
        f"{name}: of {counts['covered']:,} places claimed covered, above the limit", counts["above"]
    )
    yield _none(
        f"{name}: of {counts['uncovered']:,} places claimed uncovered, within it", counts["below"]
    )
    share = 100 * seconds["not settled"] / seconds["all"]
    yield at_most(f"{name}: not settled", share, 1.0, " %", key="not_settled_pct")
    yield _none(
        f"{name}: of {counts['turns']:,} turns on {counts['ways']} ways, meet land", counts["meet"]
    )
    count = _SCENES[is_whole]
    above = [_bound_above(seed, is_strong=seed < count // 5) for seed in range(count)]
    yield _none(f"bound from a haven above the oracle's time, {count} scenes", sum(above))


def _none(name: str, count: int) -> Figure:
    """Return the figure of something of which there should be none."""
    return Figure(name, "0", f"{count:,}", count == 0)


def _scene(seed: int) -> MovingScene:
    """Return a seeded scene; every second has a current that changes."""
    if seed % 2:
        return moving_scene(seed)
    return MovingScene(*random_scene(seed).parts)


def _havens(seed: int, chart: renew.Chart, count: int) -> list[renew.Haven]:
    """Return seeded havens off land."""
    rng, found = np.random.default_rng([seed, 3]), list[renew.Haven]()
    water = shapely.buffer(chart.water, -_OFF_M)
    while len(found) < count:
        place = rng.uniform(0, SIZE, 2)
        if water.contains(shapely.Point(place)):
            found.append(renew.Haven(f"haven {len(found) + 1}", place))
    return found


def _claims(seed: int, counts: Counter[str], seconds: dict[str, float]) -> None:
    """Count places of one route by what is claimed there, and claims that don't hold."""
    scene, rng = _scene(seed), np.random.default_rng([seed, 5])
    route, within = scene.plan().best, float(rng.uniform(*_LIMITS_S))
    havens = _havens(seed, scene.chart, _HAVENS)
    found = renew.cover(
        route, scene.chart, scene.current, PAPER_VESSEL, havens, within=within, drift=scene.drift
    )
    for stretch in found.stretches:
        seconds[stretch.state] += stretch.end - stretch.begin
        seconds["all"] += stretch.end - stretch.begin
    track = route.trajectory[:, :3]
    for now in rng.uniform(track[0, 0], track[-1, 0], _PLACES).tolist():
        stretch = found.at(now)
        counts[stretch.state] += 1
        place = np.array([np.interp(now, track[:, 0], axis) for axis in track.T[1:]])
        if stretch.diversion is not None:
            ahead = track[(track[:, 0] > now) & (track[:, 0] < stretch.diversion.time), 1:]
            path = np.vstack([place, ahead, stretch.diversion.route.path])
            off = 0.0 if scene.current.is_steady else 0.05 * (now - track[0, 0])
            took = [_time(path, scene, now + late) for late in dict.fromkeys((-off, 0.0, off))]
            counts["above"] += int(max(took) > within * (1 + 1e-6))
        elif stretch.state == "uncovered":
            # Farther havens are out of reach without any land.
            reach = within * (PAPER_VESSEL.speed + _STRONGEST)
            near = [one for one in found.havens if math.dist(place, one.place) <= reach]
            times = [_oracle(scene, place, one, now, _FINE_M) for one in near]
            counts["below"] += int(min(times, default=math.inf) <= within)
    for way in dict.fromkeys(one.diversion for one in found.stretches if one.diversion):
        flown = renew.contingency(
            way.route,
            scene.chart,
            scene.current,
            PAPER_VESSEL,
            spacing=0.5,
            drift=scene.drift,
            min_lateness=2 * (way.time - float(way.route.times[0])),
        )
        counts["ways"] += 1
        counts["turns"] += flown.trials
        counts["meet"] += flown.collisions


def _time(path: FloatArray, scene: MovingScene, begin: float) -> float:
    """Return the time (s) along a path (n, 2) begun at a time (s)."""
    if scene.current.is_steady:
        legs = path[:-1], path[1:], scene.current, PAPER_VESSEL, scene.drift
        return float(leg_times(*legs, _PIECE_M)[0].sum())
    fuel = renew.fuel(path, scene.current, PAPER_VESSEL, departure=begin, drift=scene.drift)
    return fuel / PAPER_VESSEL.fuel_rate


def _oracle(
    scene: MovingScene, place: FloatArray, haven: renew.Haven, begin: float, spacing: float
) -> float:
    """Return the least time (s) along the edges of a grid from a place (2,) to a haven."""
    ends = scene.chart, scene.current, PAPER_VESSEL, place, haven.place
    if scene.current.is_steady:
        fuel, _ = grid_dijkstra(*ends, spacing, drift=scene.drift)
        return fuel / PAPER_VESSEL.fuel_rate
    fuel, _ = earliest_arrival(
        *ends,
        begin,
        spacing=spacing,
        drift=scene.drift,
    )
    return fuel / PAPER_VESSEL.fuel_rate


def _bound_above(seed: int, *, is_strong: bool) -> bool:
    """Whether the bound from a haven is above the oracle's time from some place of a scene."""
    scene = _scene(1000 + seed)
    if is_strong:
        scene = MovingScene(*random_scene(1000 + seed, 1.4).parts)
    haven, *places = _havens(1000 + seed, scene.chart, 4)
    most = SIZE / PAPER_VESSEL.speed
    voyage = replace(scene, goal=haven.place).voyage
    bound = HavenBound.of(voyage, most, scene.departure + 2 * most)
    least = bound.at(np.array([one.place for one in places]))
    times = [_oracle(scene, one.place, haven, scene.departure, _COARSE_M) for one in places]
    return bool((least > np.array(times) * (1 + 1e-9)).any())


def palawan(plan: renew.Plan, chart: renew.Chart, vessel: renew.Vessel) -> Iterator[Figure]:
    """Yield time and memory of six havens along a plan off Palawan, within 6 h."""
    route, land = plan.best, chart.hard_no_go
    line, havens = shapely.LineString(route.path), list[renew.Haven]()
    for number, share in enumerate((0.08, 0.25, 0.42, 0.58, 0.75, 0.92)):
        abeam = line.interpolate(share, normalized=True)
        x, shore = shapely.get_coordinates(shapely.shortest_line(abeam, land))
        place = shore + _OFF_SHORE_M * (x - shore) / math.dist(x, shore)
        havens.append(renew.Haven(f"haven {number + 1}", place))
    current = cast("Request", plan.voyage).current

    def covered() -> renew.Coverage:
        return renew.cover(route, chart, current, vessel, havens, within=_WITHIN_S)

    covered()  # compiles
    begun = time.process_time()
    found = covered()
    took = time.process_time() - begun
    name = "Palawan, six havens, within 6 h"
    yield at_most(f"{name}: CPU", took, 60.0, " s", key="palawan_cpu_s")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    yield at_most(f"{name}: memory, with the plan", peak, 1.0, " GB", key="palawan_gb")
    share = 100 * found.share("not settled")
    yield at_most(f"{name}: not settled", share, 1.0, " %", key="palawan_not_settled_pct")
