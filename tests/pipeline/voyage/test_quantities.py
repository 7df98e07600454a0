"""Quantities with units, and months."""

from __future__ import annotations

from datetime import date

import pytest
from hypothesis import given, strategies as st

from pipeline.scenario.season import period
from pipeline.voyage.quantities import length_m, read_months, speed_m_s, speed_range_m_s

sizes = st.floats(0, 1e6).map(lambda value: round(value, 4))


@given(sizes, st.sampled_from(["", " "]))
def test_figures_come_back_in_each_unit(size: float, space: str) -> None:
    # The definitions: a nautical mile is 1852 m, a foot is 0.3048 m.
    assert speed_m_s(f"{size:.4f}{space}kn") * 3600 / 1852 == pytest.approx(size)
    assert speed_m_s(f"{size:.4f}{space}km/h") * 3.6 == pytest.approx(size)
    assert speed_m_s(f"{size:.4f}{space}m/s") == pytest.approx(size)
    assert length_m(f"{size:.4f}{space}ft") / 0.3048 == pytest.approx(size)
    assert length_m(f"{size:.4f}{space}m") == length_m(f"{size:.4f}") == pytest.approx(size)
    assert length_m(f"{size:.4f}{space}nm") / 1852 == pytest.approx(size)


def test_a_decimal_comma_and_capitals_are_read() -> None:
    assert speed_m_s("7,2 KM/H") == pytest.approx(2.0)
    assert length_m("1,5M") == 1.5


@pytest.mark.parametrize("text", ["12", "12 mph", "kn", "", "12kn!", "1e3kn", "nan m/s", "- 3kn"])
def test_a_speed_without_a_known_unit_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="such as 12kn"):
        speed_m_s(text)


@pytest.mark.parametrize("text", ["4kn..9kn", "4..9kn", "4 .. 9 kn", "7.408km/h..9kn"])
def test_a_range_of_speeds_may_give_its_unit_once(text: str) -> None:
    assert speed_range_m_s(text) == pytest.approx((4 * 1852 / 3600, 9 * 1852 / 3600))


@pytest.mark.parametrize("text", ["", "long", "12kn", "12 m m"])
def test_what_is_no_length_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="such as 90m"):
        length_m(text)


months = st.dates(max_value=date(9998, 12, 31)).map(lambda day: f"{day:%Y-%m}".zfill(7))


@given(st.lists(months, unique=True, max_size=4))
def test_months_keep_their_order_and_are_periods(texts: list[str]) -> None:
    assert list(read_months(texts)) == texts
    for text in texts:
        begin = period(text).begin
        assert (begin.day, begin.hour) == (1, 0)


def test_every_fault_is_reported() -> None:
    with pytest.raises(ValueError, match="2024-13") as caught:
        read_months(["2024-13", "July", "2024-07", "2024-07", "2024-07-01"])
    assert len(caught.value.args) == 4
