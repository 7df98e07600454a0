"""Plausibility of a current that changes, each of its fields looked at; a steady one has one."""

from collections.abc import Iterable, Sequence

from pipeline.sources.quality.field import Field, LandMask
from pipeline.sources.quality.plausibility import (
    Assessment,
    assess_directions,
    assess_position,
    assess_speeds,
)

# Largest number of times that a message names.
_MAX_TIMES = 3


def assess_series(
    fields: Iterable[Field], labels: Sequence[str], mask: LandMask, limit_m_s: float
) -> Assessment:
    """Assess the speeds, directions and gaps of fields on one grid, and the first one's position.

    They are taken one after the other, as all of them may not fit in memory. `labels` are their
    times in writing; of a single field it is not used.
    """
    first: Field | None = None
    speeds: list[Assessment] = []
    directions: list[Assessment] = []
    changed: dict[str, int] = {}
    for label, field in zip(labels, fields, strict=True):
        first = first or field
        speeds.append(assess_speeds(field, limit_m_s))
        directions.append(Assessment() if speeds[-1].faults else assess_directions(field))
        if cells := int((field.gap != first.gap).sum()):
            changed[label] = cells
    assessment = _at_times(speeds, labels)
    if first is not None and not assessment.faults:
        assessment += assess_position(first, mask) + _at_most_times(directions)
    return assessment + _assess_changed_gaps(changed, labels)


def _at_times(each: Sequence[Assessment], labels: Sequence[str]) -> Assessment:
    """What is wrong at the times of some fields, each with its time."""
    if len(each) == 1:
        return each[0]
    times = list(zip(each, labels, strict=True))
    faults = [f"at {label} {fault}" for one, label in times for fault in one.faults]
    warnings = [f"at {label} {warning}" for one, label in times for warning in one.warnings]
    return Assessment(_first_few(faults), _first_few(warnings))


def _at_most_times(each: Sequence[Assessment]) -> Assessment:
    """What is wrong with the directions of some fields, if it is so at most of their times.

    Water that is just turning may look as if it ran the wrong way.
    """
    wrong = [one for one in each if one.faults]
    doubtful = [one for one in each if one.warnings]
    for some in (wrong, doubtful):
        if 2 * len(some) > len(each):
            return some[0]
    return Assessment()


def _first_few(messages: Sequence[str]) -> tuple[str, ...]:
    """The first messages, and how many more there are."""
    more = len(messages) - _MAX_TIMES
    return (*messages[:_MAX_TIMES], *([f"and so at {more} other times"] if more > 0 else []))


def _assess_changed_gaps(changed: dict[str, int], labels: Sequence[str]) -> Assessment:
    """Whether all fields have data in the same cells; `changed` are cells that differ, by time."""
    faults = [
        f"{cells} cells have data either at {label} or at {labels[0]}, not at both: its land and "
        "its gaps must be the same at all times"
        for label, cells in changed.items()
    ]
    return Assessment(_first_few(faults))
