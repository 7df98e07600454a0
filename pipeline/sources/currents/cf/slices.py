"""Which steps of a file make up a season's current: one field, or a field for each time."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.scenario.period import Period
from pipeline.scenario.season import Season
from pipeline.sources.currents.cf.contents import Contents
from pipeline.sources.currents.cf.time import MISSING_STEP, label, select_steps

# Number of faults of one kind that a message names.
_MAX_FAULTS = 3


@dataclass(frozen=True, slots=True)
class SelectedSlices:
    """A season's fields: the weights (sum 1) of steps, by index, that make up each of them.

    `times_s` are seconds since departure, one for each field; 0 for a single one. `labels` are the
    fields' times in writing, empty for a single one.
    """

    weights: tuple[Mapping[int, float], ...]
    times_s: tuple[float, ...]
    labels: tuple[str, ...]
    valid: str
    notes: tuple[str, ...] = ()
    is_climatology: bool = False


def select_slices(contents: Contents, season: Season) -> SelectedSlices:
    """Select a season's fields.

    Raises
    ------
    ValueError
        There are none, or they are no series without holes around the voyage.
    """
    if season.is_changing:
        return _all_steps(contents, season.period)
    steps = select_steps(contents.steps, season.period, season.resolved_time_method)
    return SelectedSlices(
        (steps.weights,), (0.0,), ("",), steps.valid, steps.notes, steps.is_climatology
    )


def _all_steps(contents: Contents, period: Period) -> SelectedSlices:
    """Select all steps from the one before a period's begin to the one after its end."""
    steps, departure = contents.steps, period.begin
    moments = steps.moments
    if len(moments) < 2:
        raise ValueError(
            f"it has {steps.span}, which say nothing of how the current changes; give a file with "
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
    )


def _holes(contents: Contents, chosen: Sequence[int]) -> Iterator[str]:
    """Find steps that are missing between others."""
    moments = [contents.steps.moments[i] for i in chosen]
    gaps = [later - earlier for earlier, later in itertools.pairwise(moments)]
    usual = min(sorted(gaps)[(len(gaps) - 1) // 2], contents.steps.interval)
    holes = [i for i, gap in enumerate(gaps) if gap > MISSING_STEP * usual]
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
