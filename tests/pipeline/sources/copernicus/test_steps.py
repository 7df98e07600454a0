"""The time steps of a dataset that make up a season's field."""

import calendar
from datetime import UTC, date, datetime, timedelta

import pytest
from hypothesis import given, strategies as st

from pipeline.scenario.catalogue import CopernicusSpec, StepKind, StepLength
from pipeline.scenario.season import Period, TimeMethod, period
from pipeline.sources.cf.axes import TimeSteps
from pipeline.sources.copernicus.download import select, step_ends
from tests.loopback_store.world import spec

LENGTHS: tuple[StepLength, ...] = ("month", "day", "6 hours", "hour")
KINDS: tuple[StepKind, ...] = ("mean", "instant")
MOMENTS = st.datetimes(datetime(1993, 1, 1), datetime(2050, 1, 1))  # noqa: DTZ001 - made aware below


def dataset(length: StepLength, kind: StepKind) -> CopernicusSpec:
    """Return an entry of the catalogue with other steps."""
    entry = spec("copernicus-glorys-monthly")
    return entry.model_copy(update={"step": length, "kind": kind})


MONTHS, DAYS, HOURS = dataset("month", "mean"), dataset("day", "mean"), dataset("hour", "mean")
SIX_HOURS, INSTANTS = dataset("6 hours", "instant"), dataset("hour", "instant")


def chosen(
    entry: CopernicusSpec, valid: str, method: TimeMethod
) -> tuple[TimeSteps, tuple[float, ...]]:
    """Return the steps of a period's one field, and their weights."""
    steps, selected = select(entry, period(valid), method)
    (weights,) = selected.weights
    assert list(weights) == list(range(len(steps.labels)))
    return steps, tuple(weights.values())


def test_a_month_in_months_is_one_step() -> None:
    steps, weights = chosen(MONTHS, "2024-07", "mean")
    assert (steps.labels, weights) == (("2024-07",), (1.0,))
    assert steps.moments == (datetime(2024, 7, 16, 12, tzinfo=UTC),)


@given(st.dates(date(1993, 1, 1), date(2050, 1, 1)))
def test_a_month_in_finer_steps_is_all_of_them_with_equal_weights(when: date) -> None:
    days = calendar.monthrange(when.year, when.month)[1]
    for entry, count in ((DAYS, days), (SIX_HOURS, 4 * days), (HOURS, 24 * days)):
        steps, weights = chosen(entry, when.isoformat()[:7], "mean")
        assert len(set(steps.labels)) == len(steps.moments) == count
        assert list(steps.labels) == sorted(steps.labels)
        assert sum(weights) == pytest.approx(1)
        assert len(set(weights)) == 1
        assert all((at.year, at.month) == (when.year, when.month) for at in steps.moments)


def test_a_day_is_its_own_steps_but_no_month() -> None:
    assert chosen(DAYS, "2024-07-15", "mean")[0].labels == ("2024-07-15",)
    assert chosen(SIX_HOURS, "2024-07-15", "mean")[0].labels == (
        "2024-07-15T00",
        "2024-07-15T06",
        "2024-07-15T12",
        "2024-07-15T18",
    )
    with pytest.raises(ValueError, match="has time steps of a month, which are longer"):
        chosen(MONTHS, "2024-07-15", "mean")


@pytest.mark.parametrize(("length", "words"), [("6 hours", "of 6 hours,"), ("hour", "of an hour,")])
def test_the_length_of_steps_is_written_in_words(length: StepLength, words: str) -> None:
    moment = datetime(2024, 7, 15, 12, tzinfo=UTC)
    with pytest.raises(ValueError, match=words):
        select(dataset(length, "mean"), Period(moment, moment), "mean")


@pytest.mark.parametrize(
    ("valid", "entry", "labels"),
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
    valid: str, entry: CopernicusSpec, labels: tuple[str, ...]
) -> None:
    assert chosen(entry, valid, "nearest")[0].labels == labels


@pytest.mark.parametrize(
    ("valid", "entry", "labels", "weights"),
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
    valid: str, entry: CopernicusSpec, labels: tuple[str, ...], weights: tuple[float, ...]
) -> None:
    steps, found = chosen(entry, valid, "linear")
    assert steps.labels == labels
    assert found == pytest.approx(weights)


@given(MOMENTS, st.sampled_from(LENGTHS), st.sampled_from(KINDS))
def test_linear_reproduces_a_linear_function_of_time(
    moment: datetime, length: StepLength, kind: StepKind
) -> None:
    moment = moment.replace(tzinfo=UTC, second=0, microsecond=0)
    steps, weights = chosen(dataset(length, kind), f"{moment:%Y-%m-%dT%H:%MZ}", "linear")
    times = [at.timestamp() for at in steps.moments]
    mean = sum(weight * time for weight, time in zip(weights, times, strict=True))
    assert mean == pytest.approx(moment.timestamp(), abs=1e-3)
    assert all(0 < weight <= 1 for weight in weights)
    assert sum(weights) == pytest.approx(1)


@given(MOMENTS, st.sampled_from(LENGTHS))
def test_the_nearest_instant_is_at_most_half_a_step_away(
    moment: datetime, length: StepLength
) -> None:
    entry = dataset(length, "instant")
    moment = moment.replace(tzinfo=UTC, second=0, microsecond=0)
    (at,) = chosen(entry, f"{moment:%Y-%m-%dT%H:%MZ}", "nearest")[0].moments
    others = (step_ends(entry, at)[1], step_ends(entry, at - timedelta(hours=1))[0])
    assert all(abs(moment - at) <= abs(moment - other) for other in others)


@given(MOMENTS, st.sampled_from(LENGTHS))
def test_the_nearest_mean_is_the_one_that_contains_the_moment(
    moment: datetime, length: StepLength
) -> None:
    """Even where the middle of a month beside it is nearer, as on 31 January."""
    entry = dataset(length, "mean")
    moment = moment.replace(tzinfo=UTC, second=0, microsecond=0)
    (at,) = chosen(entry, f"{moment:%Y-%m-%dT%H:%MZ}", "nearest")[0].moments
    begin, end = step_ends(entry, at)
    assert begin <= moment < end


@pytest.mark.parametrize("valid", ["1802-07", "2024-07-31", "2024-07-31T23:31Z"])
@pytest.mark.parametrize("method", ["nearest", "mean"])
def test_a_climatology_gives_the_field_of_the_month_in_any_year(
    valid: str, method: TimeMethod
) -> None:
    climatology = dataset("month", "climatology")
    steps, weights = chosen(climatology, valid, method)
    assert (steps.labels, weights) == (("07",), (1.0,))
    with pytest.raises(ValueError, match="not interpolated in time"):
        chosen(climatology, valid, "linear")


def test_nearest_and_linear_select_around_the_middle_of_a_period() -> None:
    assert chosen(MONTHS, "2024-07-15", "nearest")[0].labels == ("2024-07",)
    assert chosen(INSTANTS, "2024-07-15", "nearest")[0].labels == ("2024-07-15T12",)
    assert chosen(DAYS, "2024-07-15", "linear")[0].labels == ("2024-07-15",)
    assert chosen(SIX_HOURS, "2024-07", "linear")[0].labels == ("2024-07-16T12",)
