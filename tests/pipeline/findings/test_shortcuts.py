"""Ways through shut straits: the quickest, at no one's cost, and named where a chart names land."""

import csv
import itertools
import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st

import renew
from pipeline.findings.shortcuts import Shortcut, shortcuts, undominated
from pipeline.model import CaseResult
from tests.commands import ended
from tests.pipeline.formats import small_run
from tests.true_scale import GEOD

EXTENT = shapely.box(0, 0, 10e3, 10e3)
START, GOAL = np.array([500.0, 1e3]), np.array([9.5e3, 1e3])
TOP = 9e3


def walls(gates: list[list[tuple[float, float]]]) -> np.ndarray:
    """Walls 200 m thick, open at the top, each with gates at heights y and of widths, m."""
    parts = []
    for x, of_wall in zip(np.linspace(3e3, 7e3, len(gates)), gates, strict=True):
        holes = [shapely.box(0, y - width / 2, 10e3, y + width / 2) for y, width in of_wall]
        parts.append(shapely.box(x, -1, x + 200, TOP) - shapely.union_all(holes))
    return np.array(shapely.get_parts(shapely.union_all(parts)))


def length_m(
    gates: list[list[tuple[float, float]]], ys: tuple[float, ...], via: np.ndarray
) -> float:
    """Length of the way over the points via that passes each wall behind them at a height."""
    xs = np.linspace(3e3, 7e3, len(gates))
    corners = [(x + aside, y) for x, y in zip(xs, ys, strict=True) for aside in (0, 200)]
    return float(shapely.LineString([START, *via, *corners, GOAL]).length)


HEIGHTS = st.lists(st.integers(2, 8), min_size=1, max_size=3, unique=True)
WIDTHS = st.lists(st.floats(20.0, 90.0), min_size=3, max_size=3)


@given(
    heights=st.lists(HEIGHTS, min_size=1, max_size=2),
    widths=st.lists(WIDTHS, min_size=2, max_size=2),
    via=st.sampled_from([np.empty((0, 2)), np.array([[2e3, 4e3]])]),
)
@settings(max_examples=3)
def test_ways_through_gates_save_what_their_lengths_say(
    heights: list[list[int]], widths: list[list[float]], via: np.ndarray
) -> None:
    """Against lines that are drawn by hand: without a current, time is length."""
    gates = [
        [(1e3 * y, width) for y, width in zip(ys, of_wall, strict=False)]
        for ys, of_wall in zip(heights, widths, strict=False)
    ]
    like = small_run.parts(planar=True).planned["gyre"]
    solid = renew.Chart(EXTENT, walls([[] for _ in gates]))
    case = replace(
        like,
        water=replace(like.water, chart=solid, land=tuple(walls(gates))),
        current=renew.UniformCurrent(0.0, 0.0),
        start=START,
        goal=GOAL,
        via=via,
    )
    plan = renew.plan(solid, case.current, case.vessel, START, GOAL, via=via, padding="none")
    numbered = [
        (x, y, width)
        for x, of_wall in zip(np.linspace(3e3, 7e3, len(gates)), gates, strict=True)
        for y, width in of_wall
    ]
    lines = [[(x + 100, y - w / 2), (x + 100, y + w / 2)] for x, y, w in numbered]
    share = np.array([width / 100 for *_, width in numbered])
    planned = [(case, CaseResult(case.name, plan, "", 0.0))]
    found = shortcuts(planned, EXTENT, np.array(lines), share, "projected")
    around = length_m(gates, (TOP,) * len(gates), via)
    assert plan.best.length == pytest.approx(around, rel=0.01)
    for way in found:
        by_wall = {numbered[at][0]: numbered[at][1] for at in way.straits}
        ys = tuple(by_wall.get(x, TOP) for x in np.linspace(3e3, 7e3, len(gates)))
        assert len(by_wall) == len(way.straits)
        assert way.saves == pytest.approx(1 - length_m(gates, ys, via) / around, abs=0.02)
    # The shortest of all is the first, but for the price of narrow gates.
    every = itertools.product(*([y for y, _ in of_wall] for of_wall in gates))
    shortest = min(length_m(gates, ys, via) for ys in every)
    assert found[0].saves == pytest.approx(1 - shortest / around, abs=0.04)


SETS = st.frozensets(st.integers(0, 5), min_size=1, max_size=4)


@given(drawn=st.lists(st.tuples(st.floats(0.01, 0.9), SETS), max_size=12))
def test_a_way_is_left_out_only_where_another_is_as_good(
    drawn: list[tuple[float, frozenset[int]]],
) -> None:
    share = np.array([0.1, 0.9, 0.2, 0.8, 0.5, 0.5])
    ways = [Shortcut(worth, worth, straits) for worth, straits in drawn]
    kept = undominated(ways, share)

    def is_as_good(one: Shortcut, other: Shortcut) -> bool:
        """Whether one is worth as much, on fewer of the straits, or on wider ones."""
        narrowest = [min(share[at] for at in way.straits) for way in (one, other)]
        is_wider = bool(one.straits & other.straits) and narrowest[0] >= narrowest[1]
        return one.worth >= other.worth and (one.straits <= other.straits or is_wider)

    assert all(any(is_as_good(one, way) for one in kept) for way in ways)
    assert not any(is_as_good(one, other) for one, other in itertools.permutations(kept, 2))
    assert [way.worth for way in kept] == sorted((way.worth for way in kept), reverse=True)


@pytest.mark.slow
def test_the_far_side_of_isla_wellington_is_named_with_its_saving(tmp_path: Path) -> None:
    """Canal Messier, whose narrows leave no room to turn: Angostura Inglesa, 340 m here."""
    asked = ["47.90S 74.70W", "49.62S 74.43W", "--speed", "10kn", "--turning-circle", "400m"]
    asked += ["--length", "60m", "--currents", "still", "--offline", "--name", "messier"]
    done = ended(sys.executable, "-m", "pipeline.cli.main", "go", *asked, "--output", tmp_path)
    assert done.returncode == 0, done.stderr
    said = re.search(r"straits are shut .* (\d+)% shorter .* which is", done.stdout)
    assert said is not None
    assert "beside Isla Wellington, which is" in said[0]
    written = json.loads((tmp_path / "messier" / "manifest.json").read_text())
    first, *others = written["shut_straits"]
    assert (first["way"], first["beside"]) == (1, ["Isla Wellington"])
    assert (first["lon"], first["lat"]) == pytest.approx((-74.42, -48.98), abs=0.02)
    assert said[1] == f"{100 * first['saves']:.0f}"
    # The straight line is no longer than any way through, and the best way round is far longer.
    _, _, straight_m = GEOD.inv(-74.7, -47.9, -74.43, -49.62)
    (best, *_) = csv.DictReader((tmp_path / "messier" / "metrics.csv").read_text().splitlines())
    assert 0.4 < first["saves"] < 1 - straight_m / float(best["length_m"]) + 0.01
    assert [one["saves"] for one in others] == sorted(
        (one["saves"] for one in others), reverse=True
    )
