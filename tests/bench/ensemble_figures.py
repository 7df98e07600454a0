"""Figures of plans in ensembles: bounds, coverage, calibration, sides that are equal, turns."""

from __future__ import annotations

import itertools
import resource
import time
from collections.abc import Iterator, Sequence
from typing import Literal, cast

import numpy as np

import renew
from pipeline.scenario.loading import load_scenario
from renew._types import FloatArray
from renew.vary.members import statistic, worst_weights
from tests.bench.figure import Figure, at_most, quoted
from tests.bench.palawan_figures import cases_of, fetched_data
from tests.ensembles import Lattice, evened, gyre_chart, island_between, stirred
from tests.strategies import PAPER_VESSEL, SIZE, random_scene

_START, _GOAL = np.array([10.0, 10.0]), np.array([90.0, 90.0])
_WEST, _EAST = np.array([10.0, 50.0]), np.array([90.0, 50.0])
_STILL, _GYRE = renew.UniformCurrent(0.0, 0.0), renew.GyreCurrent(0.5, 100, 100)
# Random ensembles, of which so many have members above the vessel's speed; their members, and the
# spacing (m) of the lattice.
_ENSEMBLES, _STRONG, _MEMBERS, _SPACING_M = 200, 40, 4, 10.0
# Ensembles and truths for the coverage of P90; for probabilities of a side.
_COVERED, _TRUTHS, _SIDES, _SIDE_TRUTHS = 20, 400, 10, 60
# Scenes whose sides are equal, and in which one is dearer in every member, and their island's
# distance from the middle (m).
_EQUAL, _DEARER, _OFF_M = 200, 50, 2.4
# Scenes of each kind in which members' own paths are tried.
_OWN = 6
# Turns to simulate.
_TURNS = 200_000
# Wave length of Palawan's eddies (m), their rms speed (m/s), members and classes.
_EDDY_M, _EDDY, _MANY, _CLASSES = 80_000.0, 0.2, 50, 8


def figures() -> Iterator[Figure]:
    """Yield all figures of ensembles."""
    yield from _equal_members()
    yield from _gaps()
    yield from _p90()
    yield from _sides()
    yield from _too_close()
    yield from _own_paths()
    yield from _palawan()
    yield from _turns()
    yield from _bounds()


def _bounds() -> Iterator[Figure]:
    """Yield how many bounds are above a candidate, or above the optimum over a lattice."""
    above, tightest = 0, list[float]()
    for seed in range(_ENSEMBLES):
        chart, base, start, goal = random_scene(seed).parts
        nodes = np.linspace(0, SIZE, 81)
        spread = 0.45 if seed < _STRONG else 0.2
        members = stirred(base, _MEMBERS, spread, [seed, 1], (nodes, nodes), 100.0)
        drift: Literal["crab", "projected"] = "crab" if seed % 2 else "projected"
        weights = np.random.default_rng([seed, 2]).dirichlet(np.full(_MEMBERS, 2.0))
        try:
            found = renew.plan_ensemble(
                chart,
                members,
                PAPER_VESSEL,
                start,
                goal,
                weights=weights,
                classes=3,
                padding="none",
                drift=drift,
            )
        except renew.PlanningError:
            continue
        lattice = Lattice.of(chart, members, (start, goal), _SPACING_M, drift)
        fuels, q = [*found.fuels], weights
        for at in range(4):
            fuels.append(lattice.fuels(q))
            q = q + (worst_weights(fuels[-1], weights) - q) * 2 / (at + 2)
        every = np.array(fuels)
        for name in ("mean", "p90", "cvar90"):
            least = float(statistic(name, every, weights).min())
            above += int(found.bound.of(name) > least * (1 + 1e-9))
            if name == "mean" and np.isfinite(least):
                tightest.append(least / found.bound.of(name) - 1)
    name = f"{len(tightest)} of {_ENSEMBLES} ensembles with finite mean"
    yield _none(
        f"bounds of mean, P90, CVaR above a path's, {_ENSEMBLES} random ensembles, {_STRONG} of "
        "them with members above the vessel's speed",
        above,
    )
    yield quoted(f"{name}: median gap of the mean, %", gap=100 * float(np.median(tightest)))


def _gaps() -> Iterator[Figure]:
    """Yield gaps of the mean and of the worst quarter in a gyre of 0.5 m/s, spread 0.2 m/s."""
    mean, cvar = list[float](), list[float]()
    for seed in range(6):
        found = _in_gyre(16, seed)
        least = float(found.statistics["mean"].min())
        mean.append(100 * (least / found.bound.of("mean") - 1))
        worst = statistic("cvar90", found.fuels, found.members.weights, 0.25)
        cvar.append(100 * (float(worst.min()) / found.bound.of("cvar90", 0.25) - 1))
    name = "gyre, crab, spread 0.2 m/s, 16 members, mean of 6 ensembles"
    yield at_most(f"{name}: gap of the mean", float(np.mean(mean)), 3.5, " %")
    yield at_most(f"{name}: gap of the worst quarter's mean", float(np.mean(cvar)), 4.0, " %")


def _equal_members() -> Iterator[Figure]:
    """Yield how many figures differ from the plain plan's, where all members are equal."""
    differ = 0
    for seed, drift in itertools.product(range(5), ("crab", "projected")):
        one = stirred(_GYRE, 1, 0.2, seed)[0]
        twin = renew.GriddedCurrent(one.x, one.y, one.uv[..., 0], one.uv[..., 1])
        own = PAPER_VESSEL, _START, _GOAL
        kind = cast("Literal['crab', 'projected']", drift)
        plain = renew.plan(gyre_chart(), one, *own, classes=4, drift=kind)
        found = renew.plan_ensemble(gyre_chart(), [one, twin, one], *own, classes=4, drift=kind)
        for a, b in itertools.zip_longest(found.routes, plain.routes):
            differ += int(
                not np.array_equal(a.trajectory, b.trajectory)
                or a.fuel != b.fuel
                or a.optimality_gap != b.optimality_gap
            )
    yield _none("equal members: routes that differ from the plain plan's, 10 scenes", differ)


def _p90() -> Iterator[Figure]:
    """Yield in how many truths of the members' law the fuel is within P90."""
    held = []
    for seed in range(_COVERED):
        found = _in_gyre(50, seed)
        p90 = float(found.statistics["p90"][found.plan.chosen])
        truths = stirred(_GYRE, _TRUTHS, 0.2, [seed, 3])
        fuels = _along(found.best.path, truths)
        held.append(100 * float((fuels <= p90).mean()))
    share = float(np.mean(held))
    text = f"{share:.1f} % (ensembles {min(held):.0f} to {max(held):.0f} %)"
    name = f"P90 holds, of {_TRUTHS} truths, mean of {_COVERED} ensembles of 50 members"
    yield Figure(name, "85 to 95 %", text, 85 <= share <= 95)


def _own_paths() -> Iterator[Figure]:
    """Yield what members' own paths save where members change, in members that were held back."""
    saves, least = list[float](), 0
    for seed, flow in itertools.product(range(_OWN), (_drifting, _tidal)):
        members, held = flow(12, [seed, 9]), flow(60, [seed, 10])
        own = PAPER_VESSEL, _START, _GOAL
        scene = {"classes": 3, "padding": "none", "drift": "crab"}
        found = renew.plan_ensemble(gyre_chart(), members, *own, **scene)  # type: ignore[arg-type]
        paths = [found.best.path]
        for one in members:
            plan = renew.plan(gyre_chart(), one, *own, **scene)  # type: ignore[arg-type]
            paths += [r.path for r in plan.routes if r.homotopy == found.best.homotopy]
        chosen = int(np.argmin([_along(path, members).mean() for path in paths]))
        least += int(chosen == 0)
        fuels = [_along(path, held).mean() for path in (paths[0], paths[chosen])]
        saves.append(100 * float(1 - fuels[1] / fuels[0]))
    yield quoted(
        f"members that change, {len(saves)} ensembles: the mean's own path is the best of those "
        "of all members in so many; what the best saves in members held back, mean %",
        ensembles=least,
        saves=float(np.mean(saves)),
    )


def _drifting(count: int, seed: list[int]) -> list[renew.VaryingCurrent]:
    """Return members whose eddies of 0.2 m/s turn into others while the vessel is under way."""
    found = (stirred(_GYRE, 3, 0.2, [*seed, at]) for at in range(count))
    return [renew.VaryingCurrent([0.0, 120.0, 400.0], one) for one in found]


def _tidal(count: int, seed: list[int]) -> list[renew.VaryingCurrent]:
    """Return members of a gyre that turns round every 75 s, and whose phase is off by a radian."""
    rng, clock = np.random.default_rng(seed), np.linspace(0.0, 400.0, 33)
    found = list[renew.VaryingCurrent]()
    for phase, strength in zip(rng.normal(0, 1, count), rng.uniform(0.5, 0.7, count), strict=True):
        now = strength * np.cos(2 * np.pi * clock / 150 + phase)
        found.append(renew.VaryingCurrent(clock, [renew.GyreCurrent(a, 100, 100) for a in now]))
    return found


def _sides() -> Iterator[Figure]:
    """Yield the Brier score of a side's share where sides flip: truths are planned themselves."""
    scores, expected, shares = list[float](), list[float](), list[float]()
    for seed in range(_SIDES):
        chart = island_between(float(np.random.default_rng(seed).uniform(-1.5, 1.5)))
        found = _past(chart, stirred(_STILL, 50, 0.2, [seed, 4]))
        share = float(found.shares[0])
        if not 0.3 <= share <= 0.7:
            continue
        shares.append(share)
        for truth in stirred(_STILL, _SIDE_TRUTHS, 0.2, [seed, 5]):
            best = _plain(chart, truth)
            scores.append((share - float(best == found.routes[0].homotopy)) ** 2)
            expected.append(share * (1 - share))
    limit = float(np.mean(expected)) + 0.01
    name = f"Brier score of a side's share, {len(shares)} scenes, {len(scores)} truths"
    yield at_most(name, float(np.mean(scores)), round(limit, 4), digits=4)


def _too_close() -> Iterator[Figure]:
    """Yield how often equal sides are too close to call, and sides that differ in all members."""
    middle, beside = island_between(), island_between(_OFF_M)
    close = [
        not _past(middle, stirred(_STILL, 20, 0.2, [seed, 6])).is_sure for seed in range(_EQUAL)
    ]
    share = 100 * float(np.mean(close))
    name = f"too close to call, {_EQUAL} scenes with two equal sides"
    yield Figure(name, ">= 85 %", f"{share:.1f} %", share >= 85)
    wrong, dearer = 0, list[float]()
    for seed in range(_DEARER):
        members = [evened(one) for one in stirred(_STILL, 20, 0.03, [seed, 7])]
        found = _past(beside, members)
        wrong += int(not found.is_sure)
        best, other = found.fuels[found.statistics["mean"].argsort()]
        dearer += (other / best - 1).tolist()
    more = f"{100 * min(dearer):.1f} to {100 * max(dearer):.1f} % dearer in all members"
    yield at_most(f"too close to call, {_DEARER} scenes, one side {more}", 2.0 * wrong, 5, " %", 0)


def _turns() -> Iterator[Figure]:
    """Yield how many turns meet land, in any member, early, on time and late."""
    trials = hits = 0
    for seed in itertools.count():
        if trials >= _TURNS:
            break
        members: list[renew.CurrentField] = [*stirred(_GYRE, 8, 0.2, [seed, 8])]
        if seed % 2:
            # Members that change: one field becomes another while the vessel is under way.
            pairs = itertools.pairwise([*members, members[0]])
            members = [renew.VaryingCurrent([0.0, 90.0, 400.0], [*pair, pair[0]]) for pair in pairs]
        own = PAPER_VESSEL, _START, _GOAL
        found = renew.plan_ensemble(gyre_chart(), members, *own, classes=4, drift="crab")
        for route, member in itertools.product(found.routes, members):
            flown = renew.contingency(
                route, gyre_chart(), member, PAPER_VESSEL, seed=seed, drift="crab"
            )
            trials, hits = trials + flown.trials, hits + flown.collisions
    yield _none(f"of {trials:,} turns in single members, early, on time and late, meet land", hits)


def _palawan() -> Iterator[Figure]:
    """Yield the time of 50 members and 8 classes of Palawan."""
    scenario = load_scenario("palawan-usv")
    scene, _ = cases_of(scenario, fetched_data(scenario))
    base = cast("renew.GriddedCurrent", scene.current)
    members = stirred(base, _MANY, _EDDY, 0, (base.x, base.y), _EDDY_M)
    wall, cpu = time.perf_counter(), time.process_time()
    found = renew.plan_ensemble(
        scene.chart,
        members,
        scene.vessel,
        scene.start,
        scene.goal,
        classes=_CLASSES,
        distinct_by=scenario.planner.distinct_by,
    )
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    name = f"Palawan, {_MANY} members, {len(found.routes)} classes"
    yield at_most(f"{name}: time on the wall", wall, 60.0, " s", 1)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    yield quoted(f"{name}: CPU s, memory GB of the process", cpu=cpu, gb=peak)
    cpu = time.process_time()
    gaps = {name: 100 * found.gap(name) for name in ("mean", "cvar90")}
    cpu = time.process_time() - cpu
    yield quoted(f"{name}: bounds, CPU s; gaps of mean and CVaR, %", cpu=cpu, **gaps)
    land = sum(
        renew.contingency(found.best, scene.chart, one, scene.vessel, spacing=500.0).collisions
        for one in members[::5]
    )
    yield _none(f"{name}: turns of the best route that meet land in 10 members", land)


def _in_gyre(count: int, seed: int) -> renew.EnsemblePlan:
    """Return the plan in a seeded ensemble of the gyre, crab, without padding."""
    members = stirred(_GYRE, count, 0.2, seed)
    own = PAPER_VESSEL, _START, _GOAL
    return renew.plan_ensemble(gyre_chart(), members, *own, classes=4, drift="crab", padding="none")


def _past(chart: renew.Chart, members: list[renew.GriddedCurrent]) -> renew.EnsemblePlan:
    """Return the plan past an island, two classes, without padding."""
    own = PAPER_VESSEL, _WEST, _EAST
    return renew.plan_ensemble(chart, members, *own, classes=2, drift="crab", padding="none")


def _plain(chart: renew.Chart, truth: renew.CurrentField) -> str:
    """Return the best class in a current."""
    own = PAPER_VESSEL, _WEST, _EAST
    plan = renew.plan(chart, truth, *own, classes=2, drift="crab", padding="none")
    return plan.best.homotopy


def _along(path: FloatArray, currents: Sequence[renew.CurrentField]) -> FloatArray:
    """Return the fuel (n,) along a path in each current."""
    return np.array([renew.fuel(path, one, PAPER_VESSEL, drift="crab") for one in currents])


def _none(name: str, count: int) -> Figure:
    """Return the figure of something of which there should be none."""
    return Figure(name, "0", f"{count:,}", count == 0)
