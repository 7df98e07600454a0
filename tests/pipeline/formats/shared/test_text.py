from __future__ import annotations

import math
from dataclasses import replace

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pipeline.formats.shared import text as texts
from pipeline.model import GapShares, Passage, RouteMetrics, Zone

BEST = RouteMetrics(
    season="summer",
    rank=1,
    homotopy="e",
    fuel=900.0,
    fuel_per_distance=0.9,
    length=1000.0,
    length_m=1_000_000.0,
    clearance_m=3_460.0,
    duration_s=1_000_000 / 1.25,
    optimality_gap=0.25,
    trials=1430,
    collisions=0,
    land_m=0.0,
    passages=(Passage("west", ("1",)), Passage("between", ("2", "3"))),
)
TWIN = replace(BEST, rank=2, fuel=910.0)
OTHER = replace(
    BEST,
    rank=3,
    fuel=1000.0,
    length_m=960_000.0,
    duration_s=960_000 / 0.9,
    passages=(Passage("east", ("1",)),),
)


@pytest.mark.parametrize(
    ("formatted", "expected"),
    [
        (texts.number(1234.567), "1,235"),
        (texts.number(0.0), "0.000"),
        (texts.number(-0.012345, 3), "-0.0123"),
        (texts.number(math.nan), "–"),
        (texts.number(None), "–"),
        (texts.distance(712_089.9), "712.1 km"),
        (texts.distance(3_460.0), "3.46 km"),
        (texts.distance(820.4), "820.4 m"),
        (texts.distance(math.inf), "–"),
        (texts.hours(722_000), "200.6 h"),
        (texts.hours(600), "10.0 min"),
        (texts.hours(97.07), "97.1 s"),
        (texts.days(722_248), "8 d 9 h"),
        (texts.days(100_000), ""),
        (texts.percent(0.0234), "2.3 %"),
        (texts.plain(1000.0), "1,000"),
        (texts.plain(0.5), "0.5"),
    ],
)
def test_formats(formatted: str, expected: str) -> None:
    assert formatted == expected


def test_long_texts_are_shortened() -> None:
    assert texts.shortened("abcd", 4) == "abcd"
    assert texts.shortened("abcde", 4) == "abc…"


@given(st.floats(1e-6, 1e12))
def test_a_number_keeps_its_first_digits(value: float) -> None:
    assert float(texts.number(value).replace(",", "")) == pytest.approx(value, rel=5.1e-4)


@given(st.floats(1.0, 1e8))
def test_a_distance_keeps_its_first_digits(metres: float) -> None:
    size, unit = texts.distance(metres).replace(",", "").split()
    back = float(size) * {"km": 1000, "m": 1}[unit]
    assert back == pytest.approx(metres, rel=5.1e-3)


def test_the_best_route_is_compared_with_the_best_by_another_passage() -> None:
    assert texts.closest_rival([BEST, TWIN, OTHER]) is OTHER
    text = " ".join(texts.verdict([BEST, TWIN, OTHER], 1.0))
    assert "The way west of island 1 needs 10.0 % less fuel than the best way east of " in text
    assert "although it is 40.00 km longer" in text
    assert "averages 1.25 m/s over ground (+0.25 from the current), the other 0.90 m/s" in text
    assert "(−0.10)" in text
    assert "1 class is shorter" in text
    assert "saves 40.00 km and needs 11.1 % more fuel" in text
    assert "keeps at least 3.46 km from land; none of 1,430 simulated hard-over turns met" in text
    # A gap of a quarter of the bound: 720, a fifth below the fuel.
    assert "can need less fuel than 720.0; this one is within 25.0 % of that bound" in text


def test_ways_name_islands_on_the_same_side_together() -> None:
    passages = [Passage("west", (name,)) for name in ("1", "4", "Isle")]
    straits = (Passage("between", ("2", "3")), Passage("between", ("5", "6")))
    assert replace(BEST, passages=tuple(passages)).way == "west of island 1, island 4 and Isle"
    assert replace(BEST, passages=(passages[0], *straits, passages[1])).way == (
        "west of island 1, between islands 2 and 3, between islands 5 and 6, west of island 4"
    )
    assert replace(BEST, passages=()).way == ""


def test_the_parts_of_a_gap_are_told() -> None:
    text = texts.verdict([BEST, OTHER], 1.0, GapShares("summer", 0.05, 0.08, 0.12))[-1]
    assert "gap of 25.0 %, 5.0 % is the chart's" in text
    assert "8.0 % is the padding's" in text
    assert "12.0 % the bound's own" in text


def test_without_another_passage_it_is_compared_with_the_next_best() -> None:
    assert texts.closest_rival([BEST, TWIN]) is TWIN
    text = texts.verdict([BEST, TWIN], 1.0)[0]
    assert "The best route needs 1.1 % less fuel than the next best (rank 2)" in text
    assert "over the same distance" in text


def test_a_route_chosen_by_its_class_is_not_called_cheaper() -> None:
    text = texts.verdict([replace(BEST, fuel=1100.0), OTHER], 1.0)[0]
    assert "was chosen over the best way east of island 1 (rank 3) by the mean fuel of its" in text
    assert "although it needs 10.0 % more fuel" in text


def test_the_only_class_and_its_collisions_are_stated() -> None:
    alone = replace(BEST, collisions=7, clearance_m=math.inf, optimality_gap=math.nan)
    assert texts.closest_rival([alone]) is None
    text = " ".join(texts.verdict([alone], 1.0))
    assert "the only class" in text
    assert "no land to keep clear of; 7 of 1,430 simulated hard-over turns met land" in text
    assert "saved" not in text


def test_where_there_is_no_land_no_turn_is_said_to_have_missed_it() -> None:
    alone = replace(BEST, collisions=0, clearance_m=math.inf)
    text = " ".join(texts.verdict([alone], 1.0))
    assert "There is no land to keep clear of." in text
    assert "turns" not in text


def test_equal_speeds_are_stated_once() -> None:
    slower = replace(OTHER, duration_s=OTHER.length_m / 1.2499)
    first, *_ = texts.verdict([BEST, slower], 1.0)
    assert "both average 1.25 m/s over ground (+0.25 from the current)." in first
    first, *_ = texts.verdict([BEST, OTHER], 1.0)
    assert "it averages 1.25 m/s over ground (+0.25 from the current), the other 0.90" in first


@pytest.mark.parametrize(
    ("zone", "text"),
    [
        (("restricted", "", ""), "Restricted area"),
        (("restricted", "Whales", ""), "Whales"),
        (("restricted", "", "no anchoring"), "Restricted area: no anchoring"),
        (("traffic", "", ""), "Traffic scheme"),
        (("traffic", "Lane", "one way"), "Lane: one way"),
    ],
)
def test_zones_are_named_with_their_rule(zone: tuple[str, str, str], text: str) -> None:
    kind, name, rule = zone
    assert texts.zone_text(Zone(kind, name, rule, shapely.Polygon())) == text  # type: ignore[arg-type]
