"""The steps of a dataset that a season's time is made of."""

from __future__ import annotations

import calendar
from datetime import UTC, date, datetime, timedelta
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.scenario.period import period
from pipeline.sources.currents.copernicus.steps import Steps, selection

if TYPE_CHECKING:
    from pipeline.scenario.catalogue import StepKind, StepLength
    from pipeline.sources.currents.copernicus.steps import How

MONTHS, DAYS, HOURS = Steps("month", "mean"), Steps("day", "mean"), Steps("hour", "mean")
SIX_HOURS, INSTANTS = Steps("6 hours", "instant"), Steps("hour", "instant")
LENGTHS: tuple[StepLength, ...] = ("month", "day", "6 hours", "hour")
KINDS: tuple[StepKind, ...] = ("mean", "instant")
MOMENTS = st.datetimes(datetime(1993, 1, 1), datetime(2050, 1, 1))  # noqa: DTZ001 - made aware below


def test_a_month_of_months_is_that_month() -> None:
    chosen = selection(period("2024-07"), MONTHS, "mean")
    assert (chosen.labels, chosen.weights) == (("2024-07",), (1.0,))
    assert chosen.end == datetime(2024, 8, 1, tzinfo=UTC)


@given(st.dates(date(1993, 1, 1), date(2050, 1, 1)))
def test_a_month_of_finer_steps_is_all_of_them_alike(when: date) -> None:
    days = calendar.monthrange(when.year, when.month)[1]
    for steps, count in ((DAYS, days), (SIX_HOURS, 4 * days), (HOURS, 24 * days)):
        chosen = selection(period(when.isoformat()[:7]), steps, "mean")
        assert len(set(chosen.labels)) == len(chosen.begins) == count
        assert list(chosen.labels) == sorted(chosen.labels)
        assert sum(chosen.weights) == pytest.approx(1)
        assert len(set(chosen.weights)) == 1
        assert all((begin.year, begin.month) == (when.year, when.month) for begin in chosen.begins)


def test_a_day_is_its_steps_and_none_of_a_months() -> None:
    assert selection(period("2024-07-15"), DAYS, "mean").labels == ("2024-07-15",)
    assert selection(period("2024-07-15"), SIX_HOURS, "mean").labels == (
        "2024-07-15T00",
        "2024-07-15T06",
        "2024-07-15T12",
        "2024-07-15T18",
    )
    with pytest.raises(ValueError, match="holds steps of a month, which are longer"):
        selection(period("2024-07-15"), MONTHS, "mean")


@pytest.mark.parametrize(
    ("valid", "steps", "labels"),
    [
        ("2024-07-15T08:59Z", SIX_HOURS, ("2024-07-15T06",)),
        ("2024-07-15T09:00Z", SIX_HOURS, ("2024-07-15T06",)),
        ("2024-07-15T09:01Z", SIX_HOURS, ("2024-07-15T12",)),
        ("2024-07-31T23:31Z", INSTANTS, ("2024-08-01T00",)),
        ("2024-07-31T23:31Z", HOURS, ("2024-07-31T23",)),
        ("2024-07-31T23:31Z", DAYS, ("2024-07-31",)),
        ("2024-07-31T23:31Z", MONTHS, ("2024-07",)),
    ],
)
def test_an_instant_is_the_nearest_field_or_the_mean_that_it_lies_in(
    valid: str, steps: Steps, labels: tuple[str, ...]
) -> None:
    assert selection(period(valid), steps, "nearest").labels == labels


@pytest.mark.parametrize(
    ("valid", "steps", "labels", "weights"),
    [
        ("2024-07-15T08:00Z", SIX_HOURS, ("2024-07-15T06", "2024-07-15T12"), (2 / 3, 1 / 3)),
        ("2024-07-15T06:00Z", SIX_HOURS, ("2024-07-15T06",), (1.0,)),
        ("2024-07-15T12:00Z", DAYS, ("2024-07-15",), (1.0,)),
        ("2024-07-15T18:00Z", DAYS, ("2024-07-15", "2024-07-16"), (0.75, 0.25)),
        ("2024-07-15T06:00Z", DAYS, ("2024-07-14", "2024-07-15"), (0.25, 0.75)),
        ("2024-01-01T00:00Z", MONTHS, ("2023-12", "2024-01"), (0.5, 0.5)),
    ],
)
def test_linear_in_time_is_the_two_fields_around_a_mean_in_its_middle(
    valid: str, steps: Steps, labels: tuple[str, ...], weights: tuple[float, ...]
) -> None:
    chosen = selection(period(valid), steps, "linear")
    assert chosen.labels == labels
    assert chosen.weights == pytest.approx(weights)


@given(MOMENTS, st.sampled_from(LENGTHS), st.sampled_from(KINDS))
def test_linear_in_time_gives_a_linear_function_back(
    moment: datetime, length: StepLength, kind: StepKind
) -> None:
    steps, asked = Steps(length, kind), moment.replace(tzinfo=UTC, second=0, microsecond=0)
    chosen = selection(period(f"{asked:%Y-%m-%dT%H:%MZ}"), steps, "linear")
    stands_for = [steps.stands_for(begin).timestamp() for begin in chosen.begins]
    mean = sum(weight * time for weight, time in zip(chosen.weights, stands_for, strict=True))
    assert mean == pytest.approx(asked.timestamp(), abs=1e-3)
    assert all(0 < weight <= 1 for weight in chosen.weights)
    assert sum(chosen.weights) == pytest.approx(1)


@given(MOMENTS, st.sampled_from(LENGTHS))
def test_the_nearest_instant_is_half_a_step_away_at_most(
    moment: datetime, length: StepLength
) -> None:
    steps, asked = Steps(length, "instant"), moment.replace(tzinfo=UTC, second=0, microsecond=0)
    (begin,) = selection(period(f"{asked:%Y-%m-%dT%H:%MZ}"), steps, "nearest").begins
    others = (steps.after(begin), steps.begin(begin - timedelta(hours=1)))
    assert all(abs(asked - begin) <= abs(asked - other) for other in others)


@pytest.mark.parametrize("valid", ["1802-07", "2024-07-31", "2024-07-31T23:31Z"])
@pytest.mark.parametrize("how", ["nearest", "mean"])
def test_a_climatology_has_twelve_months_and_knows_no_years(valid: str, how: How) -> None:
    climatology = Steps("month", "climatology")
    chosen = selection(period(valid), climatology, how)
    assert (chosen.labels, chosen.weights) == (("07",), (1.0,))
    with pytest.raises(ValueError, match="nothing lies between"):
        selection(period(valid), climatology, "linear")


def test_of_a_period_the_nearest_and_the_two_around_are_those_of_its_middle() -> None:
    assert selection(period("2024-07-15"), MONTHS, "nearest").labels == ("2024-07",)
    assert selection(period("2024-07-15"), INSTANTS, "nearest").labels == ("2024-07-15T12",)
    assert selection(period("2024-07-15"), DAYS, "linear").labels == ("2024-07-15",)
    july = selection(period("2024-07"), SIX_HOURS, "linear")
    assert july.labels == ("2024-07-16T12",)
