"""Which time steps of a dataset make up a season's field, and with which weights.

The service labels a mean over a month or a day with its first moment, an hour's with its first or
its middle, and an instantaneous field with its own time. So a step is known here by a label as
fine as the step itself: "2024-07", "2024-07-15", "2024-07-15T18".
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from pipeline.scenario.catalogue import StepKind, StepLength
    from pipeline.scenario.period import Period

How = Literal["mean", "nearest", "linear"]

_FORMS: dict[StepLength, str] = {
    "month": "%Y-%m",
    "day": "%Y-%m-%d",
    "6 hours": "%Y-%m-%dT%H",
    "hour": "%Y-%m-%dT%H",
}
_HOURS: dict[StepLength, int] = {"day": 24, "6 hours": 6, "hour": 1}


@dataclass(frozen=True, slots=True)
class Steps:
    """How a dataset steps through time; a mean stands for all of its step, else for its begin."""

    length: StepLength
    kind: StepKind

    @property
    def form(self) -> str:
        """Format (strftime) of a step's label; years mean nothing to a climatology."""
        return "%m" if self.kind == "climatology" else _FORMS[self.length]

    def begin(self, moment: datetime) -> datetime:
        """Begin of the step that a moment lies in."""
        day = moment.replace(hour=0, minute=0, second=0, microsecond=0)
        if self.length == "month":
            return day.replace(day=1)
        hours = _HOURS[self.length]
        return day + timedelta(hours=moment.hour // hours * hours)

    def after(self, begin: datetime) -> datetime:
        """Begin of the step that follows."""
        if self.length == "month":
            return (begin + timedelta(days=31)).replace(day=1)
        return begin + timedelta(hours=_HOURS[self.length])

    def stands_for(self, begin: datetime) -> datetime:
        """The time of a step's field: the middle of a mean."""
        return begin if self.kind == "instant" else begin + (self.after(begin) - begin) / 2


@dataclass(frozen=True, slots=True)
class Selection:
    """The wanted steps: begins (UTC, ascending), labels, weights that add up to 1; their end."""

    begins: tuple[datetime, ...]
    labels: tuple[str, ...]
    weights: tuple[float, ...]
    end: datetime


def selection(period: Period, steps: Steps, how: How) -> Selection:
    """Choose the steps inside a period, or the one nearest to its middle, or the two around that.

    Raises
    ------
    ValueError
        There are none: the dataset's steps are longer, or a climatology has no time between them.
    """
    middle = period.begin + (period.end - period.begin) / 2
    if steps.kind == "climatology":
        if how == "linear":
            raise ValueError("is a climatology, one field a month, and nothing lies between")
        return _even([steps.begin(middle)], steps)
    if how != "mean":
        return (_linear if how == "linear" else _nearest)(middle, steps)
    begins = []
    begin = steps.begin(period.begin)
    begin = begin if begin == period.begin else steps.after(begin)
    while (following := steps.after(begin)) <= period.end:
        begins.append(begin)
        begin = following
    if not begins:
        raise ValueError(f"holds steps of a {steps.length}, which are longer than that")
    return _even(begins, steps)


def _nearest(moment: datetime, steps: Steps) -> Selection:
    """Choose the mean that an instant lies in, or the field nearest to it: half a step at most."""
    begin = steps.begin(moment)
    after = steps.after(begin)
    is_later = steps.kind == "instant" and after - moment < moment - begin
    return _even([after if is_later else begin], steps)


def _linear(moment: datetime, steps: Steps) -> Selection:
    """Choose the two fields around an instant; one where it has its very time."""
    later = steps.begin(moment)
    if steps.stands_for(later) < moment:
        later = steps.after(later)
    if steps.stands_for(later) == moment:
        return _even([later], steps)
    earlier = steps.begin(later - timedelta(hours=1))
    begin, end = steps.stands_for(earlier), steps.stands_for(later)
    weight = (moment - begin) / (end - begin)
    return _selected([earlier, later], (1 - weight, weight), steps)


def _even(begins: list[datetime], steps: Steps) -> Selection:
    """All steps alike."""
    return _selected(begins, (1 / len(begins),) * len(begins), steps)


def _selected(begins: list[datetime], weights: tuple[float, ...], steps: Steps) -> Selection:
    """Label the steps."""
    labels = tuple(begin.astimezone(UTC).strftime(steps.form) for begin in begins)
    return Selection(tuple(begins), labels, weights, steps.after(begins[-1]))
