"""When to leave, in sentences: the best departure, what it saves, and how sure that is."""

import math
from datetime import timedelta

import numpy as np

from pipeline.formats.shared.text import exact_moment_text, hours, moment_text, percent
from pipeline.model import DepartureChoice

AS_GOOD = 0.01
"""Share of the least fuel by which a departure counts as good as the best one."""


def departure_text(choice: DepartureChoice) -> tuple[str, ...]:
    """Say in sentences when to leave."""
    if choice.arrive_by is not None:
        leave, by = exact_moment_text(choice.chosen), moment_text(choice.arrive_by)
        taking = hours(choice.least_s)
        return (f"Leave at {leave}, as late as will do, to be there by {by}, after {taking}.",)
    count = int(np.isfinite(choice.fuels).sum())
    first, last = (_moment(choice, at) for at in choice.departures_s[[0, -1]])
    best = (
        f"Leave at {moment_text(choice.chosen)}: of {count} departures planned from {first} "
        f"to {last} {_merit(choice)}."
    )
    sentences = [best]
    most = float(choice.fuels[np.isfinite(choice.fuels)].max())
    if count > 1:
        worst = int(np.where(np.isfinite(choice.fuels), choice.fuels, -np.inf).argmax())
        sentences.append(
            f"The dearest, at {_moment(choice, choice.departures_s[worst])}, needs "
            f"{percent(most / float(choice.fuels.min()) - 1)} more."
        )
        begin, end = choice.good_window(AS_GOOD)
        if end > begin:
            sentences.append(
                f"From {_moment(choice, begin)} to {_moment(choice, end)} all that were planned "
                f"need at most {percent(AS_GOOD, 0)} more than the best."
            )
    shut = len(choice.fuels) - count
    if shut:
        at = next(i for i, reason in enumerate(choice.reasons) if reason)
        sentences.append(
            f"{shut} of the departures planned can't be sailed; that at "
            f"{_moment(choice, choice.departures_s[at])}: {choice.reasons[at]}."
        )
    sentences.append(_proof(choice))
    return tuple(sentences)


def _merit(choice: DepartureChoice) -> str:
    """Say what the best departure is best in."""
    lasts = hours(choice.least_s)
    if choice.has_speeds:
        return (
            f"it needs the least fuel to be there in time, at speeds chosen for {lasts} under way"
        )
    return f"it is under way for the least time, {lasts}, and needs the least fuel"


def _proof(choice: DepartureChoice) -> str:
    """Say what is shown of departures between those that were planned."""
    if choice.has_speeds:
        return "Nothing is known of departures between these, as speeds are chosen at each."
    if not math.isfinite(choice.unproven_s):
        return (
            "Nothing is known of departures between these: the current is as strong as the vessel "
            "in places, or an area is shut for some hours."
        )
    return (
        "To within the paths' own error no other departure in this window takes less time by "
        f"more than {hours(choice.unproven_s)}, as a later departure on the same water never "
        "arrives earlier. What is finer than that was searched, not shown."
    )


def _moment(choice: DepartureChoice, seconds: float) -> str:
    """Write a time of the choice's clock as a date."""
    return moment_text(choice.first + timedelta(seconds=float(seconds)))
