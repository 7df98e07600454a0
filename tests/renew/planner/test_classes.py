"""Classes of a plan: what they share, which are rejected and why, and what is suggested then."""

import itertools
import math
import pickle
import re
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import shapely
from shapely import Point, box

import renew
from experiments.environments.loading import load_environment, load_spec
from pipeline.machine.store import Store
from renew.classes import class_enumerator, roadmap
from renew.errors import ClassName
from renew.planner import classes
from renew.planner.problem import Problem
from tests.bounded_scenes import bounded_scene
from tests.strategies import PAPER_VESSEL, STILL, chart_of, single_gyre, voyage_on

# A strait of 6 m between two walls; the way round leads past the end of one of them.
NARROW = [box(0, 45, 47, 55), box(53, 45, 90, 55)]
START, GOAL = (50.0, 10.0), (50.0, 90.0)


def test_a_blocked_class_names_its_strait_and_its_cost() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), NARROW)
    plan = renew.plan(chart, STILL, PAPER_VESSEL, START, GOAL, padding=3.2)
    [rejected] = plan.rejected
    strait = rejected.strait
    assert strait is not None
    assert strait.width == pytest.approx(6)
    assert (strait.padding_left, strait.padding_right) == pytest.approx((3.2, 3.2))
    assert np.sort(strait.gap[:, 0]) == pytest.approx([47, 53])
    assert "triangle" not in rejected.reason
    assert rejected.reason.startswith("blocked at (50, 45) m, between (")
    assert (
        "the gap is 6.00 m wide, and 6.40 m are needed, with 3.20 m on the left" in rejected.reason
    )
    # A caller who knows longitude and latitude can spell the places in them.
    assert rejected.text.spelled(lambda place: f"<{place[0]:g}>").startswith("blocked at <50>")
    # The strait would be the short way: 80 m. The way round costs more because of the padding.
    assert rejected.unpadded_fuel == pytest.approx(80, rel=1e-3)
    assert plan.best.fuel > 100
    again = pickle.loads(pickle.dumps(rejected))  # noqa: S301  (our own bytes)
    assert again.unpadded_fuel == rejected.unpadded_fuel
    assert again.reason == rejected.reason
    assert again.text.spelled(str) == rejected.text.spelled(str)


def test_classes_blocked_by_the_padding_of_others_are_planned_for_themselves() -> None:
    scene = single_gyre()
    plan = scene.plan()
    bare = scene.plan(padding="none")
    known = {r.homotopy for r in plan.routes} | {r.homotopy for r in plan.rejected}
    assert len(known) == len(plan.routes) + len(plan.rejected)
    assert known == {r.homotopy for r in bare.routes}
    assert len(scene.plan(classes=2).routes) == 2
    assert all(math.isfinite(r.unpadded_fuel) for r in plan.rejected)


# A strait of 6 m between two walls is the only way.
BLOCKED = [box(0, 45, 47, 55), box(53, 45, 100, 55)]


def test_where_a_fixed_padding_blocks_all_the_adaptive_one_is_suggested_first() -> None:
    # The strait is 10 m wide: still water needs 3.3 m on each side, a padding of 6 m blocks it.
    walls = [box(0, 45, 45, 55), box(55, 45, 100, 55)]
    with pytest.raises(renew.UnreachableError, match=r"the gap is 10\.00 m wide") as caught:
        renew.plan(chart_of(walls), STILL, PAPER_VESSEL, START, GOAL, padding=6.0)
    text = str(caught.value)
    assert set(caught.value.text.values_of(ClassName)) == {ClassName("e")}
    adaptive = re.search(r'"adaptive" would leave one, class \S+ for a fuel of ([\d.]+)', text)
    assert adaptive
    assert float(adaptive[1]) == pytest.approx(
        renew.plan(chart_of(walls), STILL, PAPER_VESSEL, START, GOAL).best.fuel, rel=1e-3
    )
    suggested = float(re.search(r"padding = ([\d.]+) \(planar m\) would leave one", text)[1])  # type: ignore[index]
    assert text.index("adaptive") < text.rindex("padding = ")
    assert renew.plan(chart_of(walls), STILL, PAPER_VESSEL, START, GOAL, padding=suggested).routes
    # The largest one: half of the gap, less the slack with which a path is planned.
    assert 4.6 < suggested < 5
    with pytest.raises(renew.UnreachableError):
        renew.plan(chart_of(walls), STILL, PAPER_VESSEL, START, GOAL, padding=1.03 * 5)


def test_where_a_clearance_blocks_all_the_largest_clearance_is_suggested() -> None:
    asked = chart_of(BLOCKED), STILL, PAPER_VESSEL, START, GOAL
    with pytest.raises(renew.UnreachableError) as caught:
        renew.plan(*asked, padding="none", clearance=8.0)
    suggested = float(re.search(r"clearance = ([\d.]+) \(planar m\) would", str(caught.value))[1])  # type: ignore[index]
    assert 2.7 < suggested < 3
    assert "padding = " not in str(caught.value)
    assert renew.plan(*asked, padding="none", clearance=suggested).best.clearance >= suggested


@pytest.mark.slow
def test_where_adaptive_padding_blocks_all_the_largest_fixed_one_is_suggested() -> None:
    with pytest.raises(renew.UnreachableError) as caught:
        renew.plan(chart_of(BLOCKED), STILL, PAPER_VESSEL, START, GOAL)
    text = str(caught.value)
    assert "a risk of" not in text  # none up to 0.5 leaves a route
    assert "more classes" not in text  # there are none
    assert re.search(r"padding = 2\.\d+ \(planar m\) would leave one", text)
    assert "widest way through has a gap of 6.00 m" in text
    assert text.startswith("the only class was rejected: class e: blocked at (50, 45) m")
    # Where a planar metre is a kilometre, only what the option takes stays in planar metres.
    at_scale = caught.value.text.spelled(str, length=lambda one: f"{one.metres:.2f} km")
    assert "widest way through has a gap of 6.00 km" in at_scale
    assert re.search(r"padding = 2\.\d+ \(planar m\) would leave one, .* 3\.00 km clear", at_scale)


def test_a_gap_in_the_soft_zone_of_an_end_hides_no_risk_that_leaves_a_route(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # The start lies between two walls, whose padding holds it; only the strait ahead needs less.
    # Between the walls the current runs east and west in turn: a larger risk needs less padding.
    monkeypatch.setattr(classes, "_RISK_STEP", 0.5)
    walls = [box(0, 28, 15, 32), box(25, 28, 40, 32), box(0, 9, 18.5, 11), box(21.5, 9, 40, 11)]
    chart = renew.Chart(box(0, 6, 40, 46), walls)

    y = np.linspace(6.0, 46.0, 81)
    u = np.repeat(0.35 * np.sin(y / 0.7)[:, None], 2, axis=1)
    swirl = renew.GriddedCurrent(np.array([0.0, 40.0]), y, u, 0.0 * u)
    with pytest.raises(renew.UnreachableError, match=r"a risk of 0\.5 would leave one"):
        renew.plan(chart, swirl, PAPER_VESSEL, (20, 10), (20, 42), risk=0.01, padding="triangle")


# Requests on one water, each asking for less than the one before it, in v/ω where of width.
LESS_AND_LESS: tuple[tuple[dict[str, Any], ...], ...] = (
    ({"classes": 4}, {"classes": 16}, {"classes": 48}),
    ({"risk": 0.05}, {"risk": 0.3}, {"risk": 0.5}),
    ({"clearance": 2.0}, {"clearance": 0.6}, {"clearance": 0.0}),
    ({"padding": 1.0}, {"padding": 0.5}, {"padding": 0.0}),
)


WIDTHS = "clearance", "padding"


def fuels(seed: int, requests: tuple[dict[str, Any], ...]) -> list[float]:
    """The best fuel for each request on a drawn water; inf where it is refused."""
    scene, found = bounded_scene(seed), list[float]()
    radius = scene.vessel.turning_radius
    for request in requests:
        widths = {name: request[name] * radius for name in request if name in WIDTHS}
        try:
            found.append(scene.plan(**{"classes": 4} | request | widths).best.fuel)
        except renew.PlanningError:
            found.append(math.inf)
    return found


@pytest.mark.gate_share(1)
@pytest.mark.parametrize(("seed", "of"), [(34, 1), (14, 0), (68, 1), (10, 1)])
def test_a_request_for_less_needs_no_more_fuel(seed: int, of: int) -> None:
    # These lost up to 23 %: the search with more classes, more risk or less padding shut ways.
    for stricter, laxer in itertools.pairwise(fuels(seed, LESS_AND_LESS[of])):
        assert laxer <= 1.001 * stricter


@pytest.mark.slow
def test_hardly_any_request_for_less_needs_more_fuel() -> None:
    pairs = [
        pair
        for seed in range(0, 110, 4)
        for requests in LESS_AND_LESS
        for pair in itertools.pairwise(fuels(seed, requests))
    ]
    dearer = [laxer / stricter for stricter, laxer in pairs if math.isfinite(stricter)]
    assert len(dearer) > 200
    assert np.isfinite(dearer).all()
    assert np.mean(np.array(dearer) > 1.001) <= 0.01


@pytest.mark.slow
def test_less_padding_never_shuts_a_side_of_palawan(tmp_path: Path) -> None:
    # Near islets no way east can be steered at half a metre; further off land there is one.
    spec = load_spec("palawan-as-published").model_copy(update={"scale": 1000})
    environment, winter = load_environment(spec, Store(tmp_path)), spec.cases[1]
    voyage, options = environment.voyage(winter), environment.options(winter)
    asked = voyage.chart, voyage.current, voyage.vessel, voyage.start, voyage.goal
    fuels = []
    for padding in (1.0, 0.5, "none"):
        options["padding"] = padding
        fuels.append(renew.plan(*asked, **options).best.fuel)  # type: ignore[arg-type]
    assert fuels == sorted(fuels, reverse=True)


def test_a_reason_is_given_once_and_remedies_tried_in_the_ways_refused_on_their_roadmaps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    built = Mock(wraps=roadmap.roadmap)
    monkeypatch.setattr(class_enumerator, "roadmap", built)
    islands = [*BLOCKED, box(20, 20, 30, 30), box(60, 20, 70, 30), box(60, 70, 70, 80)]
    with pytest.raises(renew.UnreachableError, match="would leave one") as caught:
        renew.plan(chart_of(islands), STILL, PAPER_VESSEL, START, GOAL, classes=8)
    assert built.call_count <= 4
    text = str(caught.value)
    assert text.count("the gap is 6.00 m wide") == 1
    named = re.match(
        r"all (\d+) classes were rejected: classes \S+, \S+, \S+ and (\d+) more: ", text
    )
    assert named
    assert int(named[1]) == 3 + int(named[2])
    assert "more reason" not in text


def test_names_of_classes_among_hundreds_of_islands_are_shortened() -> None:
    x, y = np.meshgrid(np.linspace(12, 88, 14), np.linspace(12, 88, 14))
    islands = [box(a - 2.2, b - 2.2, a + 2.2, b + 2.2) for a, b in zip(x.flat, y.flat, strict=True)]
    with pytest.raises(renew.UnreachableError) as caught:
        renew.plan(chart_of(islands), STILL, PAPER_VESSEL, (18, 50), (82, 50), classes=2)
    assert len(str(caught.value)) < 2000


CHART = renew.Chart(box(0, 0, 100, 100), [Point(20, 20).buffer(4), Point(80, 80).buffer(1)])


class Race(renew.CurrentField):
    """2 m/s in the middle of the chart."""

    def __call__(self, points: np.ndarray) -> np.ndarray:
        distance = np.linalg.norm(points - 50, axis=-1)
        speed = 2 * np.exp(-((distance / 15) ** 4))
        return np.stack([speed, np.zeros_like(speed)], axis=-1)


def test_parts_are_computed_once_and_triangles_leave_overpowered_water_out() -> None:
    problem = Problem(voyage_on(CHART, (10, 50), (90, 50), Race()), renew.PlanOptions())
    assert problem.triangulation is problem.triangulation
    assert problem.fuel_bound is problem.fuel_bound
    closed = problem.overpowered_water
    assert closed.contains(Point(50, 50))
    covered = shapely.union_all(shapely.polygons(problem.triangulation.corners))
    assert covered.intersection(closed).area < 1e-3
    assert covered.area == pytest.approx(CHART.water.area - closed.area)
    # Two islands and the closed water each have a ray.
    assert len(problem.rays.island) == 3


def test_islands_below_the_least_size_name_no_class() -> None:
    problem = Problem(voyage_on(CHART), renew.PlanOptions(distinct_by=5.0))
    assert len(problem.rays.island) == 1
    assert problem.rays.omits_islands
    assert len(problem.enumerator(0.0).channels(20)) == 2


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("seed", [126, 322, 498])
def test_finds_the_way_that_a_coarse_roadmap_misses(seed: int) -> None:
    """Thin walls, with the current from still to strong; without it: 41, 17 and 32 % dearer."""
    scene = bounded_scene(seed)
    assert scene.plan(padding="none", classes=1).best.fuel < 1.03 * scene.oracle()
