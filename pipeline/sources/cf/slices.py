"""Which time steps of a file make up the fields of a season, and with which weights."""

import calendar
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np

import renew
from pipeline.model import Note
from pipeline.scenario.season import Season, TimeMethod
from pipeline.scenario.times import Period
from pipeline.sources.cf.contents import Contents
from pipeline.sources.cf.times import TimeSteps, label
from renew.inputs.tide import arguments, speeds

# Steps that are further apart than this multiple of the median interval have a hole between them.
_MISSING_STEP = 1.5
# Number of faults of one kind that a message names.
_MAX_FAULTS = 3


@dataclass(frozen=True, slots=True)
class SelectedSlices:
    """A season's fields: the weights (sum 1) of steps, by index, that make up each of them.

    `valid` is the time that they stand for. `times_s` are seconds since departure, and `labels` the
    times as text, one for each field; 0 and "" for a single one.
    """

    weights: tuple[Mapping[int, float], ...]
    valid: str
    notes: tuple[Note, ...] = ()
    is_climatology: bool = False
    times_s: tuple[float, ...] = (0.0,)
    labels: tuple[str, ...] = ("",)


LONGEST_STEP = timedelta(hours=1)
"""Longest time between the fields of tidal streams."""
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def select_slices(
    contents: Contents,
    season: Season,
    step: timedelta = LONGEST_STEP,
    *,
    with_mean: bool = True,
) -> SelectedSlices:
    """Select a season's fields.

    `step` is the time between fields that are computed from harmonic constants, at its whole
    multiples in UTC; `with_mean` says whether they include the constants' mean, if there is one.

    Raises
    ------
    ValueError
        There are no steps, or some are missing during the voyage.
    """
    if contents.constituents:
        return _of_constants(contents, season, step, with_mean=with_mean)
    if season.is_changing:
        return _all_steps(contents, season.period)
    return select_steps(contents.steps, season.period, season.resolved_time_method)


def select_steps(steps: TimeSteps, period: Period, method: TimeMethod) -> SelectedSlices:
    """Select the steps that make up a period's field.

    Raises
    ------
    ValueError
        No step fits the period; the message says which steps there are.
    """
    middle = period.begin + (period.end - period.begin) / 2
    if steps.months:
        return _month_of_climatology(steps, middle, method)
    if not steps.moments:
        return SelectedSlices(({0: 1.0},), "", (Note.of("time-assumed"),))
    if method == "mean":
        return _mean(steps, period)
    return (_linear if method == "linear" else _nearest)(steps, middle)


def _month_of_climatology(steps: TimeSteps, moment: datetime, method: TimeMethod) -> SelectedSlices:
    """Select the step of the moment's month, whatever the year."""
    if method == "linear":
        raise ValueError(
            "it is a climatology, one field per month: leave 'time_method' out, or use 'nearest'"
        )
    name = calendar.month_name[moment.month]
    if moment.month not in steps.months:
        raise ValueError(f"it is {steps.span}, not of {name}; give a file of that month")
    index = steps.months.index(moment.month)
    return SelectedSlices(({index: 1.0},), f"{name} of a climatology", is_climatology=True)


def _mean(steps: TimeSteps, period: Period) -> SelectedSlices:
    """Select all steps in the period, with equal weights."""
    inside = [i for i, moment in enumerate(steps.moments) if period.begin <= moment < period.end]
    if not inside:
        _, distance = steps.nearest(period.begin + (period.end - period.begin) / 2)
        is_near = steps.is_near(distance)
        other = ', or time_method = "nearest" for the one around it' if is_near else ""
        raise ValueError(
            f"it has {steps.span}, none inside {label(period.begin)} to {label(period.end)}; set "
            f"the season's 'valid' to what it has{other}"
        )
    first, last = inside[0], inside[-1]
    valid = "/".join(steps.labels[i] for i in dict.fromkeys((first, last)))
    weights = dict.fromkeys(inside, 1 / len(inside))
    return SelectedSlices((weights,), valid, _sparse_notes(steps, inside, period))


def _sparse_notes(steps: TimeSteps, inside: Sequence[int], period: Period) -> tuple[Note, ...]:
    """Return a note if the steps do not fill the period."""
    interval = steps.interval
    # A step stands for the time around it, or after it.
    times = [period.begin - interval / 2, *(steps.moments[i] for i in inside), period.end]
    largest = max(later - earlier for earlier, later in itertools.pairwise(times))
    if largest <= _MISSING_STEP * interval:
        return ()
    span = tuple(dict.fromkeys((steps.labels[inside[0]], steps.labels[inside[-1]])))
    asked = (label(period.begin), label(period.end))
    return (Note.of("steps-sparse", count=len(inside), steps=span, asked=asked),)


def _nearest(steps: TimeSteps, moment: datetime) -> SelectedSlices:
    """Select the nearest step, at most half an interval away."""
    index, distance = steps.nearest(moment)
    if not steps.is_near(distance):
        hours = steps.interval.total_seconds() / 2 / 3600
        within = f"{hours:.3g} hours" if hours < 48 else f"{hours / 24:.3g} days"
        raise ValueError(
            f"it has {steps.span}, none within {within} of {label(moment)}; "
            "set the season's 'valid' to what it has"
        )
    return SelectedSlices(({index: 1.0},), steps.labels[index], steps.notes)


def _linear(steps: TimeSteps, moment: datetime) -> SelectedSlices:
    """Select the two steps around a moment, with the weights of linear interpolation."""
    after = int(np.searchsorted([own.timestamp() for own in steps.moments], moment.timestamp()))
    if after < len(steps.moments) and steps.moments[after] == moment:
        return SelectedSlices(({after: 1.0},), steps.labels[after], steps.notes)
    if not 0 < after < len(steps.moments):
        raise ValueError(
            f"it has {steps.span}, which do not lie on both sides of {label(moment)}; set the "
            "season's 'valid' to a time between them"
        )
    earlier, later = steps.moments[after - 1], steps.moments[after]
    if later - earlier > _MISSING_STEP * steps.interval:
        raise ValueError(
            f"it has no steps between {label(earlier)} and {label(later)}; give a file that has"
        )
    share = (moment - earlier) / (later - earlier)
    return SelectedSlices(({after - 1: 1 - share, after: share},), label(moment), steps.notes)


def _of_constants(
    contents: Contents, season: Season, step: timedelta, *, with_mean: bool
) -> SelectedSlices:
    """Return fields from an hour before a period, for a vessel that is early, to its end.

    Linear interpolation between fields damps a constituent by sinc² of half its change of phase in
    a step. The fields are divided by this factor, so that no error adds up on the way.
    """
    if not season.is_changing:
        raise ValueError(
            "it has harmonic constants, which need a clock: give the season time_method = "
            "'changing' and a 'departure', as --depart does"
        )
    period, names = season.period, contents.constituents
    first = math.floor((period.begin - LONGEST_STEP - _EPOCH) / step)
    last = math.ceil((period.end - _EPOCH) / step)
    moments = [_EPOCH + number * step for number in range(first, last + 1)]
    instants = np.array([one.replace(tzinfo=None) for one in moments], "datetime64[us]")
    try:
        factors, angles = arguments(names, instants)
    except renew.ParameterError as error:
        raise ValueError(str(error)) from None
    factors = factors / np.sinc(speeds(names)[:, None] * (step / timedelta(hours=1)) / 360) ** 2
    shares = [*factors * np.cos(angles), *-factors * np.sin(angles)]
    if contents.has_mean and with_mean:
        shares.append(np.ones(len(moments)))
    labels = tuple(map(label, moments))
    return SelectedSlices(
        weights=tuple(dict(enumerate(column)) for column in np.array(shares).T.tolist()),
        times_s=tuple((moment - period.begin).total_seconds() for moment in moments),
        labels=labels,
        valid=f"{labels[0]}/{labels[-1]}",
    )


def _all_steps(contents: Contents, period: Period) -> SelectedSlices:
    """Select all steps from the one before a period's begin to the one after its end."""
    steps, departure = contents.steps, period.begin
    moments = steps.moments
    if len(moments) < 2:
        raise ValueError(
            f"it has {steps.span}, which do not show how the current changes; give a file with "
            "two time steps or more, or leave time_method out"
        )
    if not moments[0] <= departure < moments[-1]:
        order = (
            f"{label(departure)}, is before its first step, {label(moments[0])}"
            if departure < moments[0]
            else f"{label(departure)}, is not before its last step, {label(moments[-1])}"
        )
        raise ValueError(f"the departure, {order}; depart between them, or give another file")
    times = np.array([(moment - departure).total_seconds() for moment in moments])
    first = int(np.searchsorted(times, 0.0, side="right")) - 1
    end_s = (period.end - departure).total_seconds()
    last = min(max(int(np.searchsorted(times, end_s)), first + 1), len(times) - 1)
    chosen = range(first, last + 1)
    faults = [*_holes(contents, chosen), *_descending(contents, chosen)]
    if faults:
        raise ValueError("; ".join(faults))
    labels = tuple(label(moments[i]) for i in chosen)
    return SelectedSlices(
        weights=tuple({i: 1.0} for i in chosen),
        times_s=tuple(times[first : last + 1].tolist()),
        labels=labels,
        valid=f"{labels[0]}/{labels[-1]}",
        notes=steps.notes,
    )


def _holes(contents: Contents, chosen: Sequence[int]) -> Iterator[str]:
    """Find steps that are missing between others."""
    moments = [contents.steps.moments[i] for i in chosen]
    gaps = [later - earlier for earlier, later in itertools.pairwise(moments)]
    usual = min(sorted(gaps)[(len(gaps) - 1) // 2], contents.steps.interval)
    holes = [i for i, gap in enumerate(gaps) if gap > _MISSING_STEP * usual]
    for i in holes[:_MAX_FAULTS]:
        yield (
            f"it has no step between {label(moments[i])} and {label(moments[i + 1])}, and others "
            f"every {usual.total_seconds() / 3600:g} hours; give a file without holes"
        )


def _descending(contents: Contents, chosen: Sequence[int]) -> Iterator[str]:
    """Find steps of one file that stand in another order than their times."""
    moments = contents.steps.moments
    wrong = [
        (earlier, later)
        for earlier, later in itertools.pairwise(chosen)
        if contents.u_index[earlier][0] == contents.u_index[later][0]
        and contents.u_index[earlier][1] > contents.u_index[later][1]
    ]
    for earlier, later in wrong[:_MAX_FAULTS]:
        yield (
            f"its steps don't ascend: {label(moments[later])} stands before "
            f"{label(moments[earlier])}; sort them by time"
        )
