"""Selection of a dataset's time steps.

A season's field is a weighted mean of some steps. A voyage in a changing current takes all steps of
its time, each as a field of its own.

The service labels the mean of a month or a day with its first moment, that of an hour with its
first or its middle, and an instantaneous field with its own time. So a step is identified here by a
label as coarse as the step itself: "2024-07", "2024-07-15", "2024-07-15T18".
"""

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

from pipeline.scenario.catalogue import StepKind, StepLength
from pipeline.scenario.season import TimeMethod
from pipeline.scenario.times import Period

_LABEL_FORMATS: dict[StepLength, str] = {
    "month": "%Y-%m",
    "day": "%Y-%m-%d",
    "6 hours": "%Y-%m-%dT%H",
    "hour": "%Y-%m-%dT%H",
}
_SPOKEN: dict[StepLength, str] = {
    "month": "a month",
    "day": "a day",
    "6 hours": "6 hours",
    "hour": "an hour",
}
_HOURS: dict[StepLength, int] = {"day": 24, "6 hours": 6, "hour": 1}


@dataclass(frozen=True, slots=True)
class TimeResolution:
    """Length and kind of a dataset's time steps."""

    length: StepLength
    kind: StepKind

    @property
    def label_format(self) -> str:
        """Format (strftime) of a step's label; a climatology has no years."""
        return "%m" if self.kind == "climatology" else _LABEL_FORMATS[self.length]

    def start(self, moment: datetime) -> datetime:
        """Start of the step that a moment lies in."""
        day = moment.replace(hour=0, minute=0, second=0, microsecond=0)
        if self.length == "month":
            return day.replace(day=1)
        hours = _HOURS[self.length]
        return day + timedelta(hours=moment.hour // hours * hours)

    def next_start(self, start: datetime) -> datetime:
        """Start of the step that follows."""
        if self.length == "month":
            return (start + timedelta(days=31)).replace(day=1)
        return start + timedelta(hours=_HOURS[self.length])

    def valid_time(self, start: datetime) -> datetime:
        """The time that a step's field is valid for: of a mean, the middle."""
        return start if self.kind == "instant" else start + (self.next_start(start) - start) / 2


@dataclass(frozen=True, slots=True)
class SelectedSteps:
    """Starts (UTC, ascending), labels and weights (sum 1) of time steps; the end of the last.

    Without weights each step is a field of its own, of a current that changes.
    """

    starts: tuple[datetime, ...]
    labels: tuple[str, ...]
    weights: tuple[float, ...]
    end: datetime

    @property
    def are_fields(self) -> bool:
        """Whether each step is a field of its own."""
        return not self.weights

    def until(self, last: datetime) -> "SelectedSteps":
        """Keep the steps that start at a moment or before it, where each is a field of its own."""
        if not self.are_fields:
            return self
        count = sum(start <= last for start in self.starts)
        return replace(self, starts=self.starts[:count], labels=self.labels[:count])


def select_steps(period: Period, resolution: TimeResolution, method: TimeMethod) -> SelectedSteps:
    """Select the steps that make up a period's field.

    Raises
    ------
    ValueError
        No steps can be selected: the steps are longer than the period, or the dataset is a
        climatology and linear interpolation between its months was asked for.
    """
    middle = period.begin + (period.end - period.begin) / 2
    if resolution.kind == "climatology":
        if method == "linear":
            raise ValueError("is a climatology of months, which are not interpolated in time")
        return _with_equal_weights([resolution.start(middle)], resolution)
    if method != "mean":
        return (_linear if method == "linear" else _nearest)(middle, resolution)
    starts = []
    start = resolution.start(period.begin)
    start = start if start == period.begin else resolution.next_start(start)
    while (following := resolution.next_start(start)) <= period.end:
        starts.append(start)
        start = following
    if not starts:
        length = _SPOKEN[resolution.length]
        raise ValueError(f"has time steps of {length}, which are longer than the time asked for")
    return _with_equal_weights(starts, resolution)


def select_all_steps(period: Period, resolution: TimeResolution) -> SelectedSteps:
    """Select all steps from the one valid before a period's begin to the one after its end.

    Raises
    ------
    ValueError
        The dataset is a climatology.
    """
    if resolution.kind == "climatology":
        raise ValueError("is a climatology of months, which does not show how currents change")
    starts = [resolution.start(period.begin)]
    if resolution.valid_time(starts[0]) > period.begin:
        starts = [resolution.start(starts[0] - timedelta(hours=1))]
    while len(starts) < 2 or resolution.valid_time(starts[-1]) < period.end:
        starts.append(resolution.next_start(starts[-1]))
    return _labelled(starts, (), resolution)


def _nearest(moment: datetime, resolution: TimeResolution) -> SelectedSteps:
    """Select the mean that a moment lies in, or the instantaneous field nearest to it."""
    start = resolution.start(moment)
    following = resolution.next_start(start)
    is_later = resolution.kind == "instant" and following - moment < moment - start
    return _with_equal_weights([following if is_later else start], resolution)


def _linear(moment: datetime, resolution: TimeResolution) -> SelectedSteps:
    """Select the two fields around a moment, or the one that is valid for that very time."""
    later = resolution.start(moment)
    if resolution.valid_time(later) < moment:
        later = resolution.next_start(later)
    if resolution.valid_time(later) == moment:
        return _with_equal_weights([later], resolution)
    earlier = resolution.start(later - timedelta(hours=1))
    begin, end = resolution.valid_time(earlier), resolution.valid_time(later)
    weight = (moment - begin) / (end - begin)
    return _labelled([earlier, later], (1 - weight, weight), resolution)


def _with_equal_weights(starts: list[datetime], resolution: TimeResolution) -> SelectedSteps:
    """Give all steps the same weight."""
    return _labelled(starts, (1 / len(starts),) * len(starts), resolution)


def _labelled(
    starts: list[datetime], weights: tuple[float, ...], resolution: TimeResolution
) -> SelectedSteps:
    """Label the steps."""
    labels = tuple(start.astimezone(UTC).strftime(resolution.label_format) for start in starts)
    return SelectedSteps(tuple(starts), labels, weights, resolution.next_start(starts[-1]))
