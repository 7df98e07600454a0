"""Figures of plans in ensembles: bounds, coverage, calibration, and sides that are equal."""

import itertools
from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np

import renew
from renew._types import FloatArray
from renew.vary.ensemble import statistic, worst_weights
from tests.bench.figure import Figure, at_most, quoted
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


def figures() -> Iterator[Figure]:
    """Yield all figures of ensembles."""
    yield from _p90()
    yield from _sides()
    yield from _too_close()
    yield from _own_paths()
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
