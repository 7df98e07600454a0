from __future__ import annotations

import math
from dataclasses import replace

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pipeline.formats.shared import text as phrases
from pipeline.model import RouteMetrics, Zone

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
    side="west",
)
TWIN = replace(BEST, rank=2, fuel=910.0)
OTHER = replace(
    BEST, rank=3, fuel=1000.0, length_m=960_000.0, duration_s=960_000 / 0.9, side="east"
)


@pytest.mark.parametrize(
    ("spelt", "expected"),
    [
        (phrases.number(1234.567), "1,235"),
        (phrases.number(0.0), "0.000"),
        (phrases.number(-0.012345, 3), "-0.0123"),
        (phrases.number(math.nan), "–"),
        (phrases.number(None), "–"),
        (phrases.distance(712_089.9), "712.1 km"),
        (phrases.distance(3_460.0), "3.46 km"),
        (phrases.distance(820.4), "820.4 m"),
        (phrases.distance(math.inf), "–"),
        (phrases.hours(722_000), "200.6 h"),
        (phrases.hours(600), "10.0 min"),
        (phrases.hours(97.07), "97.1 s"),
        (phrases.days(722_248), "8 d 9 h"),
        (phrases.days(100_000), ""),
        (phrases.percent(0.0234), "2.3 %"),
        (phrases.plain(1000.0), "1,000"),
        (phrases.plain(0.5), "0.5"),
    ],
)
def test_spelling(spelt: str, expected: str) -> None:
    assert spelt == expected


@given(st.floats(1e-6, 1e12))
def test_a_number_keeps_its_first_digits(value: float) -> None:
    assert float(phrases.number(value).replace(",", "")) == pytest.approx(value, rel=5.1e-4)


@given(st.floats(1.0, 1e8))
def test_a_distance_keeps_its_first_digits(metres: float) -> None:
    size, unit = phrases.distance(metres).replace(",", "").split()
    back = float(size) * {"km": 1000, "m": 1}[unit]
    assert back == pytest.approx(metres, rel=5.1e-3)


def test_the_winner_is_held_against_the_other_side() -> None:
    text = " ".join(phrases.verdict([BEST, TWIN, OTHER], 1.0))
    assert "West about takes 10.0 % less fuel than the best way east about (rank 3)" in text
    assert "though it is 40.00 km longer" in text
    assert "1.25 m/s on average (+0.25 by the current) against 0.90 m/s (−0.10)" in text
    assert "1 class is shorter" in text
    assert "saves 40.00 km and costs 11.1 % more fuel" in text
    assert "3.46 km or more from land; none of 1,430 simulated hard-over turns met land" in text
    # A gap of a quarter of the bound: 720, a fifth below the fuel.
    assert "less than 720.0 fuel: this one is within 25.0 % of that" in text


def test_without_another_side_the_next_best_is_the_measure() -> None:
    text = phrases.verdict([BEST, TWIN], 1.0)[0]
    assert "The best route takes 1.1 % less fuel than the next best (rank 2)" in text
    assert "on the same distance" in text


def test_a_winner_by_its_class_is_not_called_cheaper() -> None:
    text = phrases.verdict([replace(BEST, fuel=1100.0), OTHER], 1.0)[0]
    assert "was chosen by the mean of its class" in text
    assert "though it takes 10.0 % more fuel" in text


def test_the_only_class_and_its_collisions_are_called_so() -> None:
    alone = replace(BEST, collisions=7, clearance_m=math.inf, optimality_gap=math.nan)
    text = " ".join(phrases.verdict([alone], 1.0))
    assert "the only class" in text
    assert "no land to stay clear of; 7 of 1,430 simulated hard-over turns met land" in text
    assert "saved" not in text


def test_speeds_that_read_alike_are_told_once() -> None:
    slower = replace(OTHER, duration_s=OTHER.length_m / 1.2499)
    first, *_ = phrases.verdict([BEST, slower], 1.0)
    assert "both make 1.25 m/s on average (+0.25 by the current)." in first
    first, *_ = phrases.verdict([BEST, OTHER], 1.0)
    assert "it makes 1.25 m/s on average (+0.25 by the current) against 0.90 m/s" in first


@pytest.mark.parametrize(
    ("zone", "words"),
    [
        (("restricted", "", ""), "Restricted area"),
        (("restricted", "Whales", ""), "Whales"),
        (("restricted", "", "no anchoring"), "Restricted area: no anchoring"),
        (("traffic", "", ""), "Traffic scheme"),
        (("traffic", "Lane", "one way"), "Lane: one way"),
    ],
)
def test_zones_are_named_with_their_rule(zone: tuple[str, str, str], words: str) -> None:
    kind, name, rule = zone
    assert phrases.zone_words(Zone(kind, name, rule, shapely.Polygon())) == words  # type: ignore[arg-type]
