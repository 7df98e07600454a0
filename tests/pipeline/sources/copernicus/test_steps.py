"""The time steps of a dataset that make up a season's field."""

from __future__ import annotations

import calendar
from datetime import UTC, date, datetime, timedelta

import pytest
from hypothesis import given, strategies as st

from pipeline.scenario.catalogue import StepKind, StepLength
from pipeline.scenario.season import TimeMethod
from pipeline.scenario.times import Period, period
from pipeline.sources.copernicus.download import TimeResolution, select_steps

MONTHS, DAYS, HOURS = (
    TimeResolution("month", "mean"),
    TimeResolution("day", "mean"),
    TimeResolution("hour", "mean"),
)
SIX_HOURS, INSTANTS = TimeResolution("6 hours", "instant"), TimeResolution("hour", "instant")
LENGTHS: tuple[StepLength, ...] = ("month", "day", "6 hours", "hour")
KINDS: tuple[StepKind, ...] = ("mean", "instant")
MOMENTS = st.datetimes(datetime(1993, 1, 1), datetime(2050, 1, 1))  # noqa: DTZ001 - made aware below


def test_a_month_in_months_is_one_step() -> None:
    chosen = select_steps(period("2024-07"), MONTHS, "mean")
    assert (chosen.labels, chosen.weights) == (("2024-07",), (1.0,))
    assert chosen.end == datetime(2024, 8, 1, tzinfo=UTC)


@given(st.dates(date(1993, 1, 1), date(2050, 1, 1)))
def test_a_month_in_finer_steps_is_all_of_them_with_equal_weights(when: date) -> None:
    days = calendar.monthrange(when.year, when.month)[1]
    for resolution, count in ((DAYS, days), (SIX_HOURS, 4 * days), (HOURS, 24 * days)):
        chosen = select_steps(period(when.isoformat()[:7]), resolution, "mean")
        assert len(set(chosen.labels)) == len(chosen.starts) == count
        assert list(chosen.labels) == sorted(chosen.labels)
        assert sum(chosen.weights) == pytest.approx(1)
        assert len(set(chosen.weights)) == 1
        assert all((start.year, start.month) == (when.year, when.month) for start in chosen.starts)


def test_a_day_is_its_own_steps_but_no_month() -> None:
    assert select_steps(period("2024-07-15"), DAYS, "mean").labels == ("2024-07-15",)
    assert select_steps(period("2024-07-15"), SIX_HOURS, "mean").labels == (
        "2024-07-15T00",
        "2024-07-15T06",
        "2024-07-15T12",
        "2024-07-15T18",
    )
    with pytest.raises(ValueError, match="has time steps of a month, which are longer"):
        select_steps(period("2024-07-15"), MONTHS, "mean")


@pytest.mark.parametrize(("length", "words"), [("6 hours", "of 6 hours,"), ("hour", "of an hour,")])
def test_the_length_of_steps_is_written_in_words(length: StepLength, words: str) -> None:
    moment = datetime(2024, 7, 15, 12, tzinfo=UTC)
    with pytest.raises(ValueError, match=words):
        select_steps(Period(moment, moment), TimeResolution(length, "mean"), "mean")


@pytest.mark.parametrize(
    ("valid", "resolution", "labels"),
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
def test_an_instant_is_the_nearest_field_or_the_mean_that_contains_it(
    valid: str, resolution: TimeResolution, labels: tuple[str, ...]
) -> None:
    assert select_steps(period(valid), resolution, "nearest").labels == labels


@pytest.mark.parametrize(
    ("valid", "resolution", "labels", "weights"),
    [
        ("2024-07-15T08:00Z", SIX_HOURS, ("2024-07-15T06", "2024-07-15T12"), (2 / 3, 1 / 3)),
        ("2024-07-15T06:00Z", SIX_HOURS, ("2024-07-15T06",), (1.0,)),
        ("2024-07-15T12:00Z", DAYS, ("2024-07-15",), (1.0,)),
        ("2024-07-15T18:00Z", DAYS, ("2024-07-15", "2024-07-16"), (0.75, 0.25)),
        ("2024-07-15T06:00Z", DAYS, ("2024-07-14", "2024-07-15"), (0.25, 0.75)),
        ("2024-01-01T00:00Z", MONTHS, ("2023-12", "2024-01"), (0.5, 0.5)),
    ],
)
def test_linear_selects_the_two_fields_around_with_means_in_their_middle(
    valid: str, resolution: TimeResolution, labels: tuple[str, ...], weights: tuple[float, ...]
) -> None:
    chosen = select_steps(period(valid), resolution, "linear")
    assert chosen.labels == labels
    assert chosen.weights == pytest.approx(weights)


@given(MOMENTS, st.sampled_from(LENGTHS), st.sampled_from(KINDS))
def test_linear_reproduces_a_linear_function_of_time(
    moment: datetime, length: StepLength, kind: StepKind
) -> None:
    resolution = TimeResolution(length, kind)
    moment = moment.replace(tzinfo=UTC, second=0, microsecond=0)
    chosen = select_steps(period(f"{moment:%Y-%m-%dT%H:%MZ}"), resolution, "linear")
    times = [resolution.valid_time(start).timestamp() for start in chosen.starts]
    mean = sum(weight * time for weight, time in zip(chosen.weights, times, strict=True))
    assert mean == pytest.approx(moment.timestamp(), abs=1e-3)
    assert all(0 < weight <= 1 for weight in chosen.weights)
    assert sum(chosen.weights) == pytest.approx(1)


@given(MOMENTS, st.sampled_from(LENGTHS))
def test_the_nearest_instant_is_at_most_half_a_step_away(
    moment: datetime, length: StepLength
) -> None:
    resolution = TimeResolution(length, "instant")
    moment = moment.replace(tzinfo=UTC, second=0, microsecond=0)
    (start,) = select_steps(period(f"{moment:%Y-%m-%dT%H:%MZ}"), resolution, "nearest").starts
    others = (resolution.next_start(start), resolution.start(start - timedelta(hours=1)))
    assert all(abs(moment - start) <= abs(moment - other) for other in others)


@pytest.mark.parametrize("valid", ["1802-07", "2024-07-31", "2024-07-31T23:31Z"])
@pytest.mark.parametrize("method", ["nearest", "mean"])
def test_a_climatology_gives_the_field_of_the_month_in_any_year(
    valid: str, method: TimeMethod
) -> None:
    climatology = TimeResolution("month", "climatology")
    chosen = select_steps(period(valid), climatology, method)
    assert (chosen.labels, chosen.weights) == (("07",), (1.0,))
    with pytest.raises(ValueError, match="not interpolated in time"):
        select_steps(period(valid), climatology, "linear")


def test_nearest_and_linear_select_around_the_middle_of_a_period() -> None:
    assert select_steps(period("2024-07-15"), MONTHS, "nearest").labels == ("2024-07",)
    assert select_steps(period("2024-07-15"), INSTANTS, "nearest").labels == ("2024-07-15T12",)
    assert select_steps(period("2024-07-15"), DAYS, "linear").labels == ("2024-07-15",)
    july = select_steps(period("2024-07"), SIX_HOURS, "linear")
    assert july.labels == ("2024-07-16T12",)
