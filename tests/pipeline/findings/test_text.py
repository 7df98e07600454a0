"""Figures, moments and zones as texts, and values as JSON has them."""

import json
import math
from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest
import shapely
from hypothesis import given, strategies as st

from pipeline.findings import text as texts
from pipeline.findings.text import json_value
from pipeline.model import Energy, RouteMetrics, Zone

ROUTE = RouteMetrics(1, "e", 900.0, 0.9, 1e3, 1e6, 3e3, 8e5, 1.0, still_fuel=800.0)
POWERED = replace(ROUTE, energy=Energy("Wh", 1 / 3600, 1 / 3600, math.nan))
NOON, SECONDS = datetime(2026, 11, 22, 12, tzinfo=UTC), timedelta(seconds=20)


@pytest.mark.parametrize(
    ("formatted", "expected"),
    [
        (texts.number(1234.567), "1,235"),
        (texts.number(0.0), "0.000"),
        (texts.number(99.996, 3), "100"),
        (texts.number(-0.012345, 3), "-0.0123"),
        (texts.number(math.nan), "–"),
        (texts.number(None), "–"),
        (texts.capitalised("no-go: all water"), "No-go: all water"),
        (texts.capitalised("hourly.nc: the steps"), "hourly.nc: the steps"),
        (texts.distance(712_089.9), "712.1 km"),
        (texts.distance(3_460.0), "3.46 km"),
        (texts.distance(820.4), "820.4 m"),
        (texts.distance(math.inf), "–"),
        (texts.clearance(4_589.9), "4.58 km"),
        (texts.clearance(820.9), "820 m"),
        (texts.clearance(12.69), "12.6 m"),
        (texts.clearance(0.0), "0.00 m"),
        (texts.clearance(123_999.0), "123 km"),
        (texts.clearance(math.inf), "–"),
        (texts.fuel(695.62, ROUTE), "86.95 % of still water"),
        (texts.fuel(2_718_000, POWERED), "755.0 Wh"),
        (texts.fuel(44_316_000, POWERED), "12.31 kWh"),
        (texts.fuel(2_718_000, POWERED, least=True), "755.0 Wh"),
        (texts.box((119.8, -17.29, 120.2, -15.88)), "119.8 to 120.2 E, 17.29 to 15.88 S"),
        (texts.box((178, -1, 182, 2)), "178 E to 178 W, 1 S to 2 N"),
        (texts.fuel(math.nan, ROUTE), "–"),
        (texts.share(0.9664), "96.6 %"),
        (texts.share(1.0101), "101 %"),
        (texts.hours(722_000), "200.6 h"),
        (texts.hours(600), "10.0 min"),
        (texts.hours(97.07), "97.1 s"),
        (texts.at_most_hours(721_900), "200.6 h"),
        (texts.at_most_hours(97.01), "97.1 s"),
        (texts.at_most_hours(math.inf), "–"),
        (texts.days(722_248), "8 d 9 h"),
        (texts.at_least_percent(0.0239), "2.3 %"),
        (texts.at_most_percent(0.0231), "2.4 %"),
        (texts.at_most_percent(0.0), "0.0 %"),
        (texts.at_least_percent(math.inf), "–"),
        (texts.speed_range(2.57222, 4.63), ("2.58", "4.63")),
        (texts.speed_range(2.57222, 4.636), ("2.58", "4.63")),
        (texts.speed_range(2.57222, 2.57222), ("2.57222", "2.57222")),
        (texts.days(100_000), ""),
        (texts.percent(0.0234), "2.3 %"),
        (texts.part(0.0234), "2.3 %"),
        (texts.part(0.0), "none"),
        (texts.plain(1000.0), "1,000"),
        (texts.plain(0.5), "0.5"),
        (texts.moment_text(NOON - SECONDS), "2026-11-22 12:00 UTC"),
        (texts.moment_text(NOON + SECONDS), "2026-11-22 12:00 UTC"),
        (texts.moment_text(NOON - 2 * SECONDS), "2026-11-22 11:59 UTC"),
        (texts.moment_text(NOON.astimezone(timezone(timedelta(hours=8)))), "2026-11-22 12:00 UTC"),
        (texts.exact_moment_text(NOON), "2026-11-22 12:00 UTC"),
        (texts.exact_moment_text(NOON - SECONDS), "2026-11-22 11:59:40 UTC"),
        (texts.season_text("july"), "season 'july'"),
        (texts.season_text("2026-11-22"), "season '2026-11-22'"),
        (texts.season_text("2026-11-22t0600z"), "departure 2026-11-22 06:00 UTC"),
        (texts.seasons_text(["july", "may"]), "seasons 'july', 'may'"),
    ],
)
def test_formats(formatted: str, expected: str) -> None:
    assert formatted == expected


@given(st.floats(1e-6, 1e12))
def test_a_number_keeps_its_first_digits(value: float) -> None:
    assert float(texts.number(value).replace(",", "")) == pytest.approx(value, rel=5.1e-4)


@given(st.floats(1e-3, 1e8))
def test_a_clearance_is_never_rounded_up(metres: float) -> None:
    size, unit = texts.clearance(metres).replace(",", "").split()
    back = float(size) * {"km": 1000, "m": 1}[unit]
    assert metres * (1 - 1.01e-2) <= back <= metres * (1 + 1e-6)


@given(st.floats(1.0, 1e8))
def test_a_distance_keeps_its_first_digits(metres: float) -> None:
    size, unit = texts.distance(metres).replace(",", "").split()
    back = float(size) * {"km": 1000, "m": 1}[unit]
    assert back == pytest.approx(metres, rel=5.1e-3)


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


@given(st.floats(1e-3, 1e4), st.integers(0, 3))
def test_a_limit_is_never_rounded_to_the_wrong_side(value: float, decimals: int) -> None:
    step, slack = 10.0**-decimals, 1.1e-4 * 10.0**-decimals
    assert value - step < texts.rounded_down(value, decimals) <= value + slack
    assert value - slack <= texts.rounded_up(value, decimals) < value + step


def test_values_become_those_of_json() -> None:
    values = {
        "numbers": [np.float64(1.5), np.int64(2), math.inf, np.float64(np.nan)],
        "nested": {"flag": np.bool_(1), "nothing": None},
    }
    spelt = json.dumps(json_value(values), allow_nan=False, ensure_ascii=False)
    assert json.loads(spelt.encode()) == {
        "numbers": [1.5, 2, None, None],
        "nested": {"flag": True, "nothing": None},
    }
