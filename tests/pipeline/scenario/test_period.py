"""Months, days and instants of a season, against the calendar of the standard library."""

import calendar
from datetime import UTC, date, datetime, timedelta

import pytest
from hypothesis import given, strategies as st

from pipeline.scenario.season import Period, period


@given(st.dates(date(1700, 1, 1), date(2199, 12, 31)))
def test_months_and_days_agree_with_the_calendar(when: date) -> None:
    month, day = period(when.isoformat()[:7]), period(when.isoformat())
    assert month.end - month.begin == timedelta(calendar.monthrange(when.year, when.month)[1])
    assert month.begin.day == month.end.day == 1
    assert day.end - day.begin == timedelta(days=1)
    assert day.begin.date() == when
    assert month.begin <= day.begin < day.end <= month.end


def test_an_instant_has_no_duration_and_all_are_utc() -> None:
    moment = datetime(2024, 7, 1, 18, 30, tzinfo=UTC)
    assert period("2024-07-01T18:30Z") == Period(moment, moment)
    instant = period("2024-07-01T18:30Z")
    assert instant.begin == instant.end
    day = period("2024-07-01")
    assert day.begin < day.end
    for valid in ("2024-07", "2024-07-01", "2024-07-01T18:30Z"):
        assert period(valid).begin.utcoffset() == timedelta(0)


@pytest.mark.parametrize(
    "valid",
    [
        "",
        "2024",
        "2024-7",
        "2024-13",
        "2024-00",
        "0000-01",
        "9999-12",
        "9999-12-31",
        "2023-02-29",
        "2024-07-01T18:30",
        "2024-07-01T24:00Z",
        "2024-07-01T18:30+02:00",
        "2024-07-01 18:30Z",
        " 2024-07",
        "2024-07\n",
        "\u0662\u0660\u0662\u0664-\u0660\u0667",
    ],
)
def test_other_texts_are_refused_with_the_remedy(valid: str) -> None:
    with pytest.raises(ValueError, match="give a month 'YYYY-MM', a day") as caught:
        period(valid)
    assert repr(valid) in str(caught.value)
