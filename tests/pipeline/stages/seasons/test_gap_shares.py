"""The parts of an optimality gap add up to it, and each is there only where its cause is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

import renew
from pipeline.geo.projection import Projection
from pipeline.model import Case, CaseResult, Water
from pipeline.scenario.model import PlannerOptions
from pipeline.stages.measure import gap_shares
from pipeline.stages.plan_case import planned

EXTENT = shapely.box(-200, -100, 200, 100)
LAND = shapely.box(-20, -60, 20, 60)
MARGIN = 10.0


def voyage(margin: float) -> Case:
    """An island on the way, in a steady current, with a margin on the planner's chart."""
    no_go = LAND.buffer(margin, quad_segs=4) if margin else LAND
    return Case(
        "steady",
        Water(renew.Chart(EXTENT, [no_go], land=[LAND]), (LAND,), Projection.at(0.0, 0.0)),
        renew.Vessel(speed=1.0, turn_rate=math.radians(10)),
        start=np.array([-150.0, 0.0]),
        goal=np.array([150.0, 10.0]),
        current=renew.UniformCurrent(0.2, 0.1),
    )


@pytest.mark.gate_share(4)
@pytest.mark.parametrize("margin", [0.0, MARGIN])
@pytest.mark.parametrize("padding", ["adaptive", "none"])
@pytest.mark.parametrize("clearance", [0.0, 4.0])
def test_parts_add_up_and_have_their_causes(margin: float, padding: str, clearance: float) -> None:
    risk_at = "point" if padding == "adaptive" else "route"
    options = PlannerOptions(padding=padding, clearance=clearance, classes=2, risk_at=risk_at)
    asked = voyage(margin)
    season = planned(asked, options)
    assert season.plan is not None
    shares = gap_shares(asked, season, options)
    assert shares is not None
    parts = (shares.chart, shares.padding, shares.bound)
    assert min(parts) >= 0
    assert sum(parts) == pytest.approx(season.plan.best.optimality_gap)
    # Each metre of distance from land makes the way round its corners longer.
    assert (shares.chart > 1e-3) is bool(margin or clearance)
    assert (shares.padding > 1e-3) is (padding == "adaptive")


def test_the_charts_part_is_what_its_margin_costs() -> None:
    """In still water fuel is length: the shortest ways round the two outlines."""
    options = PlannerOptions(padding="none", clearance=0.0, classes=2)
    asked = replace(voyage(MARGIN), current=renew.UniformCurrent(0.0, 0.0))
    season = planned(asked, options)
    assert season.plan is not None
    shares = gap_shares(asked, season, options)
    assert shares is not None
    corners = shapely.get_coordinates(LAND)[:4]
    top = corners[corners[:, 1] > 0]
    ends = np.array([asked.start, *top[np.argsort(top[:, 0])], asked.goal])
    shortest = float(np.linalg.norm(np.diff(ends, axis=0), axis=1).sum())
    bound = season.plan.best.fuel / (1 + season.plan.best.optimality_gap)
    assert shares.chart * bound == pytest.approx(season.plan.best.fuel - shortest, rel=0.02)


def test_the_tides_part_is_what_the_way_round_a_bar_costs() -> None:
    """In still water: a bar that is shut on the direct way, and open for the bound."""
    options = PlannerOptions(padding="none", clearance=0.0, classes=2)
    tide = renew.Tide(
        {"M2": renew.Constant(1.5, 0.0)}, 2.0, np.datetime64("2026-11-22T00:00:00"), name="bar"
    )
    bar, shallow = shapely.box(100, -100, 110, 60), shapely.box(-150, -100, -140, -20)
    depth = renew.TidalDepth([bar, shallow], [3.0, 9.0], tide, surge=0.0, lag=0.0)
    shut = next(
        time for time in np.arange(0.0, 86_400.0, 600.0) if tide.heights(np.array([time]))[0] < 1.0
    )
    later = renew.Tide(dict(tide.constants), 2.0, tide.epoch + np.timedelta64(int(shut), "s"))
    depth = replace(depth, tide=later)
    asked = replace(
        voyage(0.0),
        current=renew.UniformCurrent(0.0, 0.0),
        tidal_depth=depth,
    )
    season = planned(asked, options)
    assert season.plan is not None
    shares = gap_shares(asked, season, options)
    assert shares is not None
    best = season.plan.best
    bound = best.fuel / (1 + best.optimality_gap)
    # From the corner of the land at (20, 60): past the end of the bar at (110, 60), or straight.
    around = math.dist((20, 60), (110, 60)) + math.dist((110, 60), asked.goal)
    straight = math.dist((20, 60), asked.goal)
    assert shares.tide * bound == pytest.approx(around - straight, rel=5e-3)
    assert shares.chart + shares.padding + shares.bound + shares.tide == pytest.approx(
        best.optimality_gap
    )


def test_a_season_without_a_plan_has_no_gap() -> None:
    failed = CaseResult("steady", None, "no way", 0.0)
    assert gap_shares(voyage(0.0), failed, PlannerOptions()) is None
