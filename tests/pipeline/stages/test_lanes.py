"""Lanes that a ship keeps: planted ones, in open water of 40 km, and drawn ones."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from pipeline.geo.projection import Projection
from pipeline.model import Case, CaseResult, Zone
from pipeline.scenario.loading import parse_scenario
from pipeline.scenario.model import PlannerOptions
from pipeline.stages.lanes import against_lanes, kept_lanes
from pipeline.stages.plan_case import planned
from tests.pipeline.planar_cases import case_of

PLANE = Projection.at(4.0, 52.0)
OPTIONS = PlannerOptions(classes=4)
SOUTH, NORTH = (20_000.0, 2_000.0), (20_000.0, 38_000.0)


def lane(name: str, course_deg: float, *bounds: float) -> Zone:
    """A lane between bounds (xmin, ymin, xmax, ymax), m."""
    area = PLANE.geometry_to_lonlat(shapely.box(*bounds))
    return Zone("traffic", name, "", area, course_deg)


def case(
    start: tuple[float, float], goal: tuple[float, float], *lanes: Zone, length_m: float = 100.0
) -> Case:
    """A voyage past an island, in still water."""
    scenario = parse_scenario(
        {
            "schema_version": 1,
            "name": "lanes",
            "title": "Lanes",
            "vessel": {"speed_m_s": 6.0, "turn_rate_deg_s": 1.5, "length_m": length_m},
            "start": list(start),
            "goal": list(goal),
            "plane": {
                "extent": [0, 0, 40_000, 40_000],
                "obstacles": [[[2e4, 1.8e4], [2.3e4, 1.8e4], [2.3e4, 2.2e4], [2e4, 2.2e4]]],
            },
            "seasons": [{"name": "calm", "uniform": {"u": 0.0}}],
        }
    )
    found = case_of(scenario)
    water = replace(found.water, is_planar=False, projection=PLANE)
    return replace(found, water=water, lanes=kept_lanes(lanes, OPTIONS, length_m))


def broken(result: CaseResult, lanes: tuple[Zone, ...]) -> list[set[str]]:
    """Return the names of the lanes that each route sails against, by rank."""
    lines = (PLANE.to_lonlat(route.path) for route in result.routes)
    return [{one.zone.name for one in against_lanes(line, lanes)} for line in lines]


UP = lane("up", 0.0, 22_000, 8_000, 30_000, 32_000)
DOWN = lane("down", 180.0, 12_000, 8_000, 21_000, 32_000)


@pytest.mark.parametrize(("start", "goal", "shut"), [(SOUTH, NORTH, "down"), (NORTH, SOUTH, "up")])
def test_a_ship_keeps_to_the_lane_of_its_direction(
    start: tuple[float, float], goal: tuple[float, float], shut: str
) -> None:
    result = planned(case(start, goal, UP, DOWN), OPTIONS)
    assert result.routes
    assert broken(result, (UP, DOWN)) == [set()] * len(result.routes)
    free = planned(case(start, goal, UP, DOWN, length_m=12.0), OPTIONS)
    assert free.kept_lanes == ()
    assert result.routes[0].fuel >= free.routes[0].fuel
    if shut in broken(free, (UP, DOWN))[0]:
        assert result.kept_lanes == (shut,)
    assert {shut} in broken(free, (UP, DOWN))


def test_who_crosses_lanes_or_sails_with_them_is_planned_as_without() -> None:
    west, east = (3_000.0, 25_000.0), (37_000.0, 25_500.0)
    for start, goal in ((west, east), (east, west)):
        result = planned(case(start, goal, UP, DOWN), OPTIONS)
        bare = planned(case(start, goal), OPTIONS)
        assert result.kept_lanes == ()
        assert [one.fuel for one in result.routes] == [one.fuel for one in bare.routes]


def test_a_lane_across_all_water_is_broken_and_that_is_said() -> None:
    """As is one in which the voyage begins."""
    for one in (
        lane("bar", 180.0, 0, 8_000, 40_000, 12_000),
        lane("berth", 180.0, 15_000, 1_000, 25_000, 9_000),
    ):
        result = planned(case(SOUTH, NORTH, one), OPTIONS)
        assert broken(result, (one,))[0] == {one.name}
        assert result.kept_lanes == ()


@pytest.mark.parametrize("seed", range(3))
def test_drawn_lanes_are_kept_wherever_one_is_shut(seed: int) -> None:
    """Five lanes of any course; what the free plan breaks, the ship's does not."""
    draw = np.random.default_rng(seed)
    lanes = tuple(
        lane(f"lane {k}", float(draw.uniform(0, 360)), x, y, x + w, y + h)
        for k, (x, y, w, h) in enumerate(
            zip(
                draw.uniform(4e3, 28e3, 5), draw.uniform(6e3, 28e3, 5),
                draw.uniform(2e3, 9e3, 5), draw.uniform(2e3, 7e3, 5), strict=True,
            )
        )
    )  # fmt: skip
    result = planned(case(SOUTH, NORTH, *lanes), OPTIONS)
    assert broken(result, lanes) == [set()] * len(result.routes)


@pytest.mark.parametrize(
    ("asked", "length_m", "keeps"),
    [(None, 19.9, False), (None, 20.0, True), (True, 5.0, True), (False, 300.0, False)],
)
def test_who_keeps_lanes(asked: bool | None, length_m: float, *, keeps: bool) -> None:
    restricted = replace(UP, course_deg=None)
    found = kept_lanes((UP, restricted), PlannerOptions(lanes=asked), length_m)
    assert found == ((UP,) if keeps else ())
