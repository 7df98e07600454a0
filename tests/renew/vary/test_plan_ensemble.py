"""Plans in an ensemble: turns in every member, equal members, bounds, and what is refused."""

import itertools
from typing import Any

import numpy as np
import pytest

import renew
from renew.vary.ensemble import statistic
from tests.ensembles import Lattice, gyre_chart, stirred
from tests.strategies import PAPER_VESSEL, STILL

START, GOAL = np.array([10.0, 10.0]), np.array([90.0, 90.0])


def gyre_members(count: int, spread: float, seed: int) -> list[renew.GriddedCurrent]:
    """Members around a gyre of 0.5 m/s."""
    return stirred(renew.GyreCurrent(0.5, 100, 100), count, spread, seed)


def planned(members: Any, **options: Any) -> renew.EnsemblePlan:  # noqa: ANN401
    given = {"classes": 2, "drift": "crab", **options}
    return renew.plan_ensemble(gyre_chart(), members, PAPER_VESSEL, START, GOAL, **given)


def collisions(plan: renew.Plan, members: list[renew.GriddedCurrent]) -> int:
    """Turns that meet land, in any member."""
    each = itertools.product(plan.routes, members)
    return sum(
        renew.contingency(route, gyre_chart(), one, PAPER_VESSEL, drift="crab").collisions
        for route, one in each
    )


def test_turns_are_clear_in_every_member_and_not_only_in_the_mean() -> None:
    members = gyre_members(12, 0.2, 3)
    found = planned(members)
    assert collisions(found.plan, members) == 0
    mean = found.plan.voyage
    assert mean is not None
    alone = renew.plan(
        gyre_chart(), mean.current, PAPER_VESSEL, START, GOAL, classes=4, drift="crab"
    )
    assert collisions(alone, members) > 0


def test_each_route_is_sailed_in_every_member() -> None:
    members = gyre_members(6, 0.1, 4)
    weights = np.array([2.0, 1, 1, 1, 1, 0])
    found = planned(members, weights=weights, padding="none")
    for route, fuels in zip(found.routes, found.fuels, strict=True):
        own = [renew.fuel(route.path, one, PAPER_VESSEL, drift="crab") for one in members]
        assert fuels == pytest.approx(own)
    assert found.shares.sum() == pytest.approx(1)
    assert found.statistics["mean"] == pytest.approx(found.fuels @ weights / 6)
    assert found.waiting_saves >= 0
    assert found.best is found.routes[found.statistics["mean"].argmin()]


def test_equal_members_give_the_plain_plan() -> None:
    one = gyre_members(1, 0.2, 5)[0]
    twin = renew.GriddedCurrent(one.x, one.y, one.uv[..., 0], one.uv[..., 1])
    found = planned([one, twin, one], weights=[1, 2, 4])
    plain = renew.plan(gyre_chart(), one, PAPER_VESSEL, START, GOAL, classes=2, drift="crab")
    for route, own in zip(found.routes, plain.routes, strict=True):
        assert np.array_equal(route.trajectory, own.trajectory)
        assert np.array_equal(route.padding_used, own.padding_used)
        assert (route.fuel, route.optimality_gap) == (own.fuel, own.optimality_gap)
    assert found.best.fuel == plain.best.fuel
    assert (found.fuels == [[one.fuel] * 3 for one in plain.routes]).all()
    assert found.bound.of("mean") == pytest.approx(plain.best.fuel_bound.value)
    assert found.bound.of("cvar90") == pytest.approx(plain.best.fuel_bound.value)


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("drift", ["crab", "projected"])
def test_no_path_on_a_lattice_is_below_the_bounds(drift: Any) -> None:  # noqa: ANN401
    members, weights = gyre_members(4, 0.2, 6), np.array([0.1, 0.4, 0.3, 0.2])
    found = planned(members, weights=weights, padding="none", drift=drift)
    lattice = Lattice.of(gyre_chart(), members, (START, GOAL), 5.0, drift)
    mean = float(weights @ lattice.fuels(weights))
    assert found.bound.of("mean") <= min(mean, found.statistics["mean"].min())
    # With a tail of a half CVaR differs from the worst member: all weights in steps of 0.05.
    tail, cvar = 0.5, np.inf
    steps = np.arange(0, 21) / 20
    grid = [(*q, 1 - sum(q)) for q in itertools.product(steps, repeat=3) if sum(q) <= 1 + 1e-9]
    allowed = [np.array(q) for q in grid if (np.array(q) <= weights / tail + 1e-9).all()]
    assert len(allowed) > 50
    # Weak duality: no path's CVaR is below any mean; the best path of each weighting is tried.
    least = 0.0
    for q in allowed[::14]:
        fuels = lattice.fuels(q)
        least = max(least, float(q @ fuels))
        cvar = min(cvar, float(statistic("cvar90", fuels[None], weights, tail)[0]))
    assert least <= cvar + 1e-9
    assert found.bound.of("cvar90", tail) <= cvar
    # The few rounds come as near as the discretised land and the bound's own gap let them.
    assert found.bound.of("cvar90", tail) >= 0.95 * least
    assert found.bound.of("p90") <= statistic("p90", found.fuels, weights).min()


@pytest.mark.parametrize(("along", "reason"), [(-1.3, "no headway"), (1.3, "runs at 1.3 m/s")])
def test_a_class_is_shut_in_a_member_whose_current_is_too_strong(along: float, reason: str) -> None:
    calm = gyre_members(5, 0.05, 7)
    x = calm[0].x
    blocked = np.where((x > 70) & (x < 80), along, 0.0) * np.ones((65, 1))
    strong = renew.GriddedCurrent(x, x, blocked, np.zeros((65, 65)))
    names = ["a", "b", "c", "d", "e", "storm"]
    found = planned([*calm, strong], names=names, padding="none")
    assert np.isinf(found.fuels[:, 5]).all()
    assert {one.member for one in found.shut} == {"storm"}
    assert found.best_in[5] == -1
    assert reason in str(found.shut[0].cause)
    assert found.shares.sum() == pytest.approx(5 / 6)


@pytest.mark.slow
def test_members_that_change_are_sailed_by_their_own_clocks() -> None:
    times, fields = [0.0, 60.0, 150.0], gyre_members(6, 0.15, 8)
    members = [renew.VaryingCurrent(times, fields[at : at + 3]) for at in range(3)]
    found = planned(members)
    for route, fuels in zip(found.routes, found.fuels, strict=True):
        own = [renew.fuel(route.path, one, PAPER_VESSEL, drift="crab") for one in members]
        assert fuels == pytest.approx(own, rel=1e-6)
        for one in members:
            turns = renew.contingency(route, gyre_chart(), one, PAPER_VESSEL, drift="crab")
            assert turns.collisions == 0
    # The theorem does not hold for them: the bound is that of their own bounds.
    assert found.bound.of("mean") == pytest.approx(np.mean(found.bound.of_members))
    assert found.bound.of("mean") <= found.statistics["mean"].min()


@pytest.mark.parametrize(
    ("members", "options", "says"),
    [
        ([STILL], {}, "currents has 1 member; an ensemble has two or more"),
        (STILL, {}, "must be fields in a row"),
        ([STILL] * 2, {"weights": [1, 2, 3]}, "weights has shape (3,); there must be 2"),
        ([STILL] * 2, {"weights": [1, -2]}, "weights must be finite, 0 or more: member 2 -2"),
        ([STILL] * 2, {"weights": [1, np.nan]}, "member 2 nan"),
        ([STILL] * 2, {"weights": [0, 3]}, "only member 2 has a weight above 0"),
        ([STILL] * 2, {"names": ["a", "a"]}, "must be 2 different names"),
        ([STILL] * 4, {"choose": "p90"}, "choose = 'p90' needs 5 members or more"),
        ([STILL] * 4, {"choose": "median"}, "is not one of mean, p90, cvar90, regret"),
        ([STILL] * 2, {"sure": 1.0}, "sure = 1.0 must lie between 0 and 1"),
        (
            [STILL, renew.SwingingGyre(0.1, 100, 100, 0.25, 0.1)],
            {},
            "member 1 is steady, and member 2 changes with time",
        ),
        (
            [renew.VaryingCurrent([a, a + 9], [STILL] * 2) for a in (0.0, 9.0)],
            {},
            "member 2 begins at 9 s, and member 1 has ended at 9 s",
        ),
        (
            [STILL] * 2,
            {"avoid": [renew.ShutArea(gyre_chart().no_go[0], 0.0, 9.0)]},
            "avoid[0] is shut for some hours only",
        ),
    ],
)
def test_what_can_not_be_planned_is_refused(
    members: Any,  # noqa: ANN401
    options: dict[str, Any],
    says: str,
) -> None:
    with pytest.raises(renew.ParameterError) as error:
        planned(members, **options)
    assert says in str(error.value)
