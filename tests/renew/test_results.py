"""Routes with their soft no-go zone, how a notebook shows a plan, and the public names."""

import gc
import inspect
import pickle
import re
import typing
import weakref
from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import shapely
from hypothesis import given
from shapely import box

import renew
from renew.inputs.options import DistinctBy
from renew.planner.plan import planner_of
from renew.request import Request
from renew.results import Step, unite_soft_no_go, watched
from tests.renew.steering.motion import assert_sailable
from tests.strategies import PAPER_VESSEL, examples, random_scene, seeds, single_gyre


@examples(2, 6)
@given(seed=seeds)
def test_routes_are_what_their_figures_say(seed: int) -> None:
    scene = random_scene(seed)
    chart, current, start, goal = scene.parts
    try:
        plan = scene.plan(classes=4)
    except renew.UnreachableError as error:
        assert "were rejected" in str(error)  # noqa: PT017  (a crowded scene may have no safe class)
        return
    assert [r.fuel for r in plan.routes] == sorted(r.fuel for r in plan.routes)
    for route in plan.routes:
        line = shapely.LineString(route.path)
        assert route.path[0] == pytest.approx(start)
        assert route.path[-1] == pytest.approx(goal)
        assert chart.extent.covers(line)
        track = shapely.LineString(route.trajectory[:, 1:3])
        nearest = min(one.distance(chart.hard_no_go) for one in (line, track))
        assert nearest == pytest.approx(route.clearance)
        channel = shapely.union_all(shapely.polygons(route.channel)).buffer(1e-5)
        assert channel.covers(line)
        if not route.starts_in_soft_no_go and not route.ends_in_soft_no_go:
            # V is drawn with polygons inside its round ends: exact to 0.5 % of the padding.
            assert line.intersection(route.soft_no_go.buffer(-1e-3)).length < 1e-6
            assert scene.turns(route, seed=seed).collisions == 0
        assert route.fuel == pytest.approx(renew.fuel(route.path, current, PAPER_VESSEL))
        assert route.fuel >= route.fuel_bound.value
        assert_sailable(route.trajectory, current, start, goal)


def test_shares_and_rates_follow_from_fuel_and_length() -> None:
    best = single_gyre().plan().best
    assert best.length == pytest.approx(shapely.LineString(best.path).length)
    assert best.fuel_per_distance * best.length == pytest.approx(best.fuel)
    assert best.fuel_bound.value * (1 + best.optimality_gap) == pytest.approx(best.fuel)
    assert best.duration == pytest.approx(best.fuel)  # the paper's vessel: 1 m/s, 1 unit a second


def test_plans_survive_pickling_though_a_current_may_not() -> None:
    chart, gyre = single_gyre().parts[:2]
    walls = [box(0, 45, 47, 55), box(53, 45, 90, 55)]
    # A lambda can't be pickled: bound and rejected classes are pickled with their figures instead.
    plans = [
        renew.plan(chart, lambda points: 0.9 * gyre(points), PAPER_VESSEL, (10, 10), (90, 90)),
        renew.plan(
            renew.Chart(box(0, 0, 100, 100), walls),
            lambda points: 0 * points,
            PAPER_VESSEL,
            (50, 10),
            (50, 90),
            padding=3.2,
        ),
    ]
    assert any(plan.rejected for plan in plans)
    for plan in plans:
        again = pickle.loads(pickle.dumps(plan))  # noqa: S301  (our own bytes)
        assert again.best.fuel == plan.best.fuel
        assert again.best.optimality_gap == plan.best.optimality_gap
        assert np.array_equal(again.best.path, plan.best.path)
        assert again.best.soft_no_go.equals(plan.best.soft_no_go)
        assert [r.unpadded_fuel for r in again.rejected] == [r.unpadded_fuel for r in plan.rejected]
        # A second time, from what came back.
        assert pickle.loads(pickle.dumps(again)).best.fuel == plan.best.fuel  # noqa: S301


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("distinct_by", [0.0, "auto"])
def test_a_route_keeps_no_roadmap_and_a_plan_is_freed_without_a_search_for_cycles(
    distinct_by: DistinctBy,
) -> None:
    scene = random_scene(3, islands=5)
    gc.collect()
    gc.disable()
    try:
        plan = scene.plan(distinct_by=distinct_by)
        request = plan.voyage
        assert isinstance(request, Request)
        problem = weakref.ref(planner_of(request).problem)
        route = plan.best
        del plan, request
        assert problem() is None
        assert 0 < route.fuel_bound.value <= route.fuel
    finally:
        gc.enable()


def test_plans_print_and_compare_by_identity() -> None:
    plan = single_gyre().plan()
    again = pickle.loads(pickle.dumps(plan))  # noqa: S301  (our own bytes)
    assert repr(again) == repr(plan)
    assert plan.best in plan.routes
    assert again != plan


def test_a_plan_is_printed_in_at_most_ten_lines() -> None:
    plan = single_gyre().plan()
    many = replace(plan, routes=plan.routes * 20)
    assert len(str(plan).splitlines()) == 1 + len(plan.routes)
    one = replace(plan, routes=plan.routes[:1], rejected=())
    assert str(one).splitlines()[0] == "1 route, 0 classes rejected"
    assert len(str(many).splitlines()) == 8
    assert all(len(line) < 80 for line in str(many).splitlines())


def test_a_plan_built_without_routes_has_no_best_one() -> None:
    with pytest.raises(renew.UnreachableError, match="holds no route"):
        _ = renew.Plan((), ()).best


def test_soft_no_go_zones_united_together_are_those_united_alone() -> None:
    routes = random_scene(5).plan(classes=6).routes
    assert len(routes) > 2
    unite_soft_no_go(routes)
    for route in routes:
        capsules = [
            shapely.LineString(edge[:4].reshape(2, 2)).buffer(edge[4], quad_segs=16)
            for edge in route.padding_used
            if edge[4] > 0
        ]
        alone = shapely.union_all(capsules)
        assert not alone.is_empty
        assert route.soft_no_go.symmetric_difference(alone).area < 1e-6


SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def plan() -> renew.Plan:
    return random_scene(1, islands=3).plan(classes=8)


@pytest.fixture(scope="module")
def shown(plan: renew.Plan) -> ET.Element:
    return ET.fromstring(f"<div>{plan._repr_html_()}</div>")  # noqa: S314  # our own


def points(element: ET.Element) -> np.ndarray:
    """Points (n, 2) of a line or an area, pixels."""
    return np.array([xy.split(",") for xy in element.attrib["points"].split()], dtype=float)


def test_each_route_is_a_line_as_long_as_it_is(plan: renew.Plan, shown: ET.Element) -> None:
    lines = [points(line) for line in shown.iter(f"{SVG}polyline")][::-1]
    assert len(lines) == min(6, len(plan.routes))
    lengths = [np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines]
    scale = lengths[0] / plan.routes[0].length
    for route, length in zip(plan.routes, lengths, strict=False):
        assert length == pytest.approx(scale * route.length, rel=0.01)


def test_north_is_up_and_everything_lies_within_the_picture(
    plan: renew.Plan, shown: ET.Element
) -> None:
    (svg,) = shown.iter(f"{SVG}svg")
    x, y, width, height = map(float, svg.attrib["viewBox"].split())
    drawn = np.concatenate([points(line) for line in shown.iter() if "points" in line.attrib])
    best = points(list(shown.iter(f"{SVG}polyline"))[-1])
    assert ((drawn >= [x, y]) & (drawn <= [x + width, y + height])).all()
    north = plan.best.path[-1, 1] - plan.best.path[0, 1]
    assert np.sign(best[0, 1] - best[-1, 1]) == np.sign(north)


def test_the_table_has_a_row_for_each_route(plan: renew.Plan, shown: ET.Element) -> None:
    (body,) = shown.iter("tbody")
    rows = [["".join(cell.itertext()) for cell in row] for row in body]
    assert len(rows) == min(6, len(plan.routes))
    for route, (_, homotopy, fuel, *_) in zip(plan.routes, rows, strict=False):
        assert homotopy == route.homotopy
        assert float(fuel) == pytest.approx(route.fuel, abs=0.05)


def test_it_needs_nothing_from_elsewhere(plan: renew.Plan) -> None:
    html = plan._repr_html_()
    assert "<script" not in html
    assert re.findall(r"(?:src|href)=", html) == []


ISLAND_CHART = renew.Chart(box(0, 0, 100, 100), [box(40, 30, 60, 70)])
ISLAND_CURRENT = renew.UniformCurrent(0.2, 0.1)
ISLAND_VESSEL = renew.Vessel(speed=1.0, turn_rate=0.6, length=2.0)


def island_plan() -> renew.Plan:
    return renew.plan(ISLAND_CHART, ISLAND_CURRENT, ISLAND_VESSEL, (10, 50), (90, 50))


def test_every_route_was_told_as_a_path_after_its_class_was_begun() -> None:
    steps: list[Step] = []
    with watched(steps.append):
        watched_plan = island_plan()
    assert steps[0].kind == "class"
    told = [step.path for step in steps if step.path is not None]
    for route in watched_plan.routes:
        assert any(np.array_equal(path, route.path) for path in told)
    assert all((step.path is not None) == (step.kind == "path") for step in steps)


def test_watching_changes_nothing_and_ends_with_its_block() -> None:
    steps: list[Step] = []
    with watched(steps.append):
        with watched(None):
            unseen = island_plan()
        assert steps == []
        seen = island_plan()
    count = len(steps)
    again = island_plan()
    assert len(steps) == count
    for one, other in ((unseen, seen), (seen, again)):
        assert [route.fuel for route in one.routes] == [route.fuel for route in other.routes]


PUBLIC = [getattr(renew, name) for name in renew.__all__]


def callables(public: object) -> list[object]:
    """A function, or a class with its public methods and properties."""
    if not inspect.isclass(public):
        return [public]
    members = [
        member.fget if isinstance(member, property) else getattr(member, "func", member)
        for name, member in vars(public).items()
        if not name.startswith("_")
    ]
    return [public, *(member for member in members if inspect.isfunction(member))]


@pytest.mark.parametrize("public", PUBLIC, ids=renew.__all__)
def test_everything_public_is_documented_and_has_types_that_can_be_evaluated(
    public: object,
) -> None:
    for member in callables(public):
        assert inspect.getdoc(member), member
        typing.get_type_hints(member)
