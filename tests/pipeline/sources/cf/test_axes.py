"""Axes and times of the user's files: which steps make up a field, what makes no grid."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, strategies as st

from pipeline.findings.note_words import note_text
from pipeline.scenario.season import TimeMethod, period
from pipeline.sources.cf.axes import TimeSteps, merge_steps, read_steps, reference_time
from pipeline.sources.cf.fields import select_steps
from pipeline.sources.cf.mesh import Axes
from tests.pipeline.sources.cf.sample_files import LON, SEA, refusal
from tests.pipeline.synthetic_currents import dataset


def _with_old_bounds() -> xr.Dataset:
    data = dataset(SEA)
    data["lon_bnds"] = (("longitude", "nv"), np.stack([LON - 0.75, LON - 0.25], axis=1))
    data.longitude.attrs["bounds"] = "lon_bnds"
    return data


def test_coordinates_outside_their_bounds_are_refused(tmp_path: Path) -> None:
    message = refusal(tmp_path, _with_old_bounds)
    assert "bad.nc: longitude lies outside its own bounds" in message


def test_axes_are_the_same_but_for_rounding() -> None:
    own = Axes(("y", "x"), LON, LON / 4)
    assert own.is_same(Axes(("lat", "lon"), LON.astype("f4").astype(float) + 1e-5, LON / 4))
    assert not own.is_same(replace(own, lon=LON + 0.01))
    assert not own.is_same(replace(own, lon=LON[:-1]))
    assert not own.is_same(own.as_mesh())


# --- The time steps of the user's files, and which of them make up a season's field ---


HOUR = timedelta(hours=1)


def read(values: Any, units: str = "hours since 2024-07-01", **attributes: Any) -> TimeSteps:  # noqa: ANN401
    """Read a time axis with these undecoded values."""
    axis = xr.DataArray(np.asarray(values, dtype=float), dims="time", name="time")
    found, _ = merge_steps([read_steps(axis.assign_attrs(units=units, **attributes), None)])
    return found


def days(first: str, count: int, every: int = 1) -> TimeSteps:
    """Read an axis of days."""
    return read(np.arange(count) * every, f"days since {first}")


@pytest.mark.parametrize(
    ("units", "calendar"),
    [
        ("days since 1950-01-01", "gregorian"),
        ("hours since 1950-01-01 00:00:00", "standard"),
        ("seconds since 1970-01-01T00:00:00Z", "proleptic_gregorian"),
        ("minutes since 2000-01-01 12:00:00 +02:00", "standard"),
        ("days since 2030-01-01", "standard"),
    ],
)
def test_moments_are_those_that_the_axis_was_made_of(units: str, calendar: str) -> None:
    moments = [datetime(2019, 2, 23, 6, tzinfo=UTC), datetime(2024, 12, 31, 18, 30, tzinfo=UTC)]
    unit, _, since = units.partition(" since ")
    origin = datetime.fromisoformat(since.replace(" +", "+"))
    origin = origin if origin.tzinfo else origin.replace(tzinfo=UTC)
    length = timedelta(**{unit: 1})
    found = read([(moment - origin) / length for moment in moments], units, calendar=calendar)
    assert list(found.moments) == moments
    assert all(type(moment) is datetime and moment.tzinfo is UTC for moment in found.moments)
    assert found.labels == ("2019-02-23T06:00Z", "2024-12-31T18:30Z")


def test_days_in_float32_are_rounded_to_the_second() -> None:
    found = read(np.array([25255.25], dtype="f4"), "days since 1950-01-01")
    assert found.labels == ("2019-02-23T06:00Z",)


@pytest.mark.parametrize("calendar", ["360_day", "noleap", "nonsense"])
def test_another_calendar_is_refused(calendar: str) -> None:
    with pytest.raises(ValueError, match=f"'{calendar}'.*convert_calendar"):
        read([0], calendar=calendar)


def test_a_calendar_called_julian_means_the_real_dates() -> None:
    # OSCAR's: 12,492 days from 1990-01-01 are 2024-03-15 in both calendars.
    found = read([12492], "days since 1990-01-01", calendar="julian")
    assert found.labels == ("2024-03-15",)
    with pytest.raises(ValueError, match=r"'julian'.*convert_calendar"):
        read([0], "days since 1850-01-01", calendar="julian")


@pytest.mark.parametrize(
    "units",
    [
        "m",
        "",
        "days since the flood",
        "fortnights since 2020-01-01",
        "days since -4713-01-01 12:00",
    ],
)
def test_what_is_no_time_is_refused(units: str) -> None:
    with pytest.raises(ValueError, match="time is no time"):
        read([0, 24], units)


def test_the_mean_of_a_month_is_of_all_its_steps_and_no_others() -> None:
    daily = days("2023-12-30", 40)
    chosen = select_steps(daily, period("2024-01"), "mean")
    taken = [daily.labels[i] for i in chosen.weights[0]]
    assert taken == [f"2024-01-{day:02d}" for day in range(1, 32)]
    assert sum(chosen.weights[0].values()) == pytest.approx(1)
    assert len(set(chosen.weights[0].values())) == 1
    assert chosen.valid == "2024-01-01/2024-01-31"
    assert not chosen.notes


def test_six_fields_five_days_apart_stand_for_their_month_without_a_note() -> None:
    chosen = select_steps(days("2024-01-03", 6, every=5), period("2024-01"), "mean")
    assert len(chosen.weights[0]) == 6
    assert not chosen.notes


@pytest.mark.parametrize(
    ("axis", "text"),
    [
        (
            days("2024-01-01", 5),
            "5 time steps stand for all of 2024-01-01 to 2024-02-01: 2024-01-01 to 2024-01-05",
        ),
        (
            days("2024-01-20", 20),
            "12 time steps stand for all of 2024-01-01 to 2024-02-01: 2024-01-20 to 2024-01-31",
        ),
        (
            days("2024-01-17", 1),
            "1 time step stands for all of 2024-01-01 to 2024-02-01: 2024-01-17",
        ),
    ],
)
def test_steps_that_do_not_fill_the_month_are_noted(axis: TimeSteps, text: str) -> None:
    (note,) = select_steps(axis, period("2024-01"), "mean").notes
    assert note_text(note) == text.format("2024-01-01 to 2024-02-01")


def test_a_single_field_stands_for_its_day_without_a_note() -> None:
    chosen = select_steps(days("2020-06-17", 1), period("2020-06-17"), "mean")
    assert (dict(chosen.weights[0]), chosen.valid, chosen.notes) == ({0: 1.0}, "2020-06-17", ())


def test_a_period_without_steps_is_refused_with_the_steps_that_there_are() -> None:
    with pytest.raises(ValueError, match="6 time steps, 2024-01-03 to 2024-01-28, none inside"):
        select_steps(days("2024-01-03", 6, every=5), period("2024-02"), "mean")
    with pytest.raises(ValueError, match=r"none inside 2024-01-05.*\(--month, .*nearest"):
        select_steps(days("2024-01-03", 6, every=5), period("2024-01-05"), "mean")


@given(st.lists(st.integers(0, 5000), min_size=2, max_size=30, unique=True), st.integers(-50, 5050))
def test_nearest_selects_the_nearest_step_or_none_if_it_is_too_far(
    hours: list[int], hour: int
) -> None:
    axis = read(sorted(hours))
    moment = datetime(2024, 7, 1, tzinfo=UTC) + hour * HOUR
    distance = min(abs(moment - own) for own in axis.moments)
    interval = float(np.median(np.diff(sorted(hours)))) * HOUR
    wanted = period(moment.strftime("%Y-%m-%dT%H:%MZ"))
    if distance > interval / 2 * 1.04:
        with pytest.raises(ValueError, match=r"none within .* of 202"):
            select_steps(axis, wanted, "nearest")
        return
    (index,) = select_steps(axis, wanted, "nearest").weights[0]
    assert abs(axis.moments[index] - moment) == distance


@given(st.lists(st.integers(0, 300), min_size=2, max_size=30, unique=True), st.floats(0, 1))
def test_linear_reproduces_a_linear_function_of_time(hours: list[int], share: float) -> None:
    axis = read(sorted(hours))
    begin, end = axis.moments[0], axis.moments[-1]
    moment = (begin + share * (end - begin)).replace(second=0, microsecond=0)
    wanted = period(moment.strftime("%Y-%m-%dT%H:%MZ"))
    gaps = np.diff(sorted(hours))
    after = int(np.searchsorted(axis.moments, moment))  # type: ignore[call-overload]
    if axis.moments[after] != moment and gaps[after - 1] > 1.5 * np.median(gaps):
        with pytest.raises(ValueError, match="no steps between"):
            select_steps(axis, wanted, "linear")
        return
    chosen = select_steps(axis, wanted, "linear")
    assert all(weight >= 0 for weight in chosen.weights[0].values())
    found = sum(axis.moments[i].timestamp() * weight for i, weight in chosen.weights[0].items())
    assert found == pytest.approx(moment.timestamp(), abs=1)


@pytest.mark.parametrize("valid", ["2024-06-30T23:00Z", "2024-07-03T01:00Z"])
def test_linear_does_not_extrapolate(valid: str) -> None:
    with pytest.raises(ValueError, match="do not lie on both sides"):
        select_steps(read([0, 24, 48]), period(valid), "linear")


# --- months -------------------------------------------------------------------------------------


def test_monthly_fields_labelled_with_their_first_day_stand_for_the_month() -> None:
    axis = read([0, 31, 60, 91], "days since 2024-01-01")
    assert axis.labels == ("2024-01", "2024-02", "2024-03", "2024-04")
    for valid, method in (("2024-03", "mean"), ("2024-03-30T12:00Z", "nearest")):
        chosen = select_steps(axis, period(valid), method)  # type: ignore[arg-type]
        assert (dict(chosen.weights[0]), chosen.valid) == ({2: 1.0}, "2024-03")
        # Of a month's mean it makes no difference where its middle is.
        assert [note.kind for note in chosen.notes] == ["steps-read"] * (method == "nearest")


def test_bounds_give_the_period_of_a_single_field() -> None:
    axis = xr.DataArray([1.0], dims="time", name="time", attrs={"units": "days since 2024-08-01"})
    single, _ = merge_steps([read_steps(axis, np.array([[0.0, 31.0]]))])
    assert not select_steps(single, period("2024-08"), "mean").notes
    assert select_steps(single, period("2024-08-29T00:00Z"), "nearest").valid == "2024-08-02"


@pytest.mark.parametrize(
    "axis",
    [
        read(range(1, 13), ""),
        read(range(1, 13), "months"),
        read(np.arange(12) * 30.4 + 15, "days since 0001-01-01"),
        read(np.arange(12) * 30.4 + 15, "days since 0000-01-01"),
        read(np.arange(12) * 30.4 + 15, "days since 1993-01-01", climatology="climatology_bounds"),
    ],
)
def test_a_climatology_gives_the_field_of_the_calendar_month(axis: TimeSteps) -> None:
    for month in (1, 7, 12):
        for valid in (f"2024-{month:02d}", f"1999-{month:02d}-28", f"2031-{month:02d}-02T05:00Z"):
            method: TimeMethod = "nearest" if "T" in valid else "mean"
            chosen = select_steps(axis, period(valid), method)
            assert dict(chosen.weights[0]) == {month - 1: 1.0}
            assert chosen.is_climatology
            assert "climatology" in chosen.valid
    with pytest.raises(ValueError, match="it is a climatology"):
        select_steps(axis, period("2024-07"), "linear")


def test_a_climatology_without_the_month_is_refused() -> None:
    with pytest.raises(ValueError, match="a climatology of June, July, not of January"):
        select_steps(read([6, 7], "month"), period("2024-01"), "mean")


def test_a_file_without_time_is_accepted_with_a_note() -> None:
    chosen = select_steps(read_steps(None, None), period("2024-07"), "mean")
    assert dict(chosen.weights[0]) == {0: 1.0}
    assert "gives no time" in note_text(chosen.notes[0])


# --- several files ------------------------------------------------------------------------------


@given(st.permutations(range(9)), st.integers(1, 4))
def test_steps_of_several_files_are_merged_in_order(order: list[int], files: int) -> None:
    parts = [list(order[i::files]) for i in range(files)]
    axes = [
        read_steps(
            xr.DataArray(
                np.array(part, dtype=float), dims="t", attrs={"units": "days since 2024-07-02"}
            ),
            None,
        )
        for part in parts
    ]
    merged, index = merge_steps(axes)
    assert merged.labels == tuple(f"2024-07-{day + 2:02d}" for day in range(9))
    assert [parts[part][i] for part, i in index] == list(range(9))


def test_files_that_overlap_or_differ_in_kind_are_refused() -> None:
    with pytest.raises(ValueError, match="two steps of 2024-07-02"):
        merge_steps([days("2024-07-01", 2), days("2024-07-02", 2)])
    with pytest.raises(ValueError, match="have years and some not"):
        merge_steps([days("2024-07-01", 2), read(range(1, 13), "month")])
    with pytest.raises(ValueError, match="their order is unknown"):
        merge_steps([read_steps(None, None), read_steps(None, None)])


@pytest.mark.parametrize(
    ("text", "hour"),
    [
        ("2024-03-15T06:00Z", 6),
        ("2024-03-15 06:00:00", 6),
        ("2024-03-15 06:00:00 UTC", 6),
        ("20240315T06", 6),
        ("2024-03-15T00:00-06:00", 6),
        ("15 March", None),
    ],
)
def test_a_reference_time_counts_in_its_zone(text: str, hour: int | None) -> None:
    found = reference_time(xr.Dataset(attrs={"bulletin_date": text}))
    assert found == (None if hour is None else datetime(2024, 3, 15, hour, tzinfo=UTC))
