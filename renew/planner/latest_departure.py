"""Find the latest departure that arrives in time: a later departure never arrives earlier (FIFO).

The arrival usually rises as fast as the departure. The next guess assumes that it does exactly, and
is kept between a departure known to be in time and one known to be late.
"""

import math
from collections.abc import Callable

from renew._types import FloatArray
from renew.errors import ArrivalError, Moment, Text
from renew.planner.departures import Sailing, Sailings
from renew.voyage.voyage import Voyage

# Largest early arrival, as a share of the time under way, and largest number of departures that
# are planned to reach it.
_EARLY, _MAX_PLANS = 1e-3, 40
# For remedies: number of halvings; the highest speed, in multiples of the vessel's; and the largest
# advance of the departure, in durations of the voyage.
_HALVINGS, _FASTEST, _EARLIEST = 12, 4.0, 4.0


def latest_departure(sailings: Sailings, earliest: float, arrive_by: float) -> Sailing:
    """Return nearly the latest sailing from `earliest` on that reaches the goal by a time (s).

    Raises ArrivalError, with remedies, if the earliest departure is already too late.
    """
    best = sailings.sailing(earliest)
    if best.found is None:
        raise best.error
    if best.arrival > arrive_by:
        raise too_late_error(best, arrive_by)
    voyage = best.planner.problem.voyage
    too_late = min(arrive_by, voyage.current.span[1])
    late_by = math.inf
    for _ in range(_MAX_PLANS):
        early_by, tolerance = arrive_by - best.arrival, _EARLY * best.duration
        room = too_late - best.departure
        if early_by <= tolerance or room <= tolerance:
            break
        guess = best.departure + early_by - tolerance / 2
        if guess >= too_late:
            # Between the two, as if the arrival rose linearly; or halfway.
            share = early_by / (early_by + late_by) if late_by < math.inf else 0.5
            guess = best.departure + min(max(share, 0.1), 0.9) * room
        tried = sailings.sailing(guess)
        if tried.arrival <= arrive_by:
            best = tried
        else:
            too_late, late_by = guess, tried.arrival - arrive_by
    return best


def too_late_error(
    first: Sailing, arrive_by: float, faster: str = "take a vessel that makes {} m/s"
) -> ArrivalError:
    """Return the error for an arrival that is too early, with a sufficient speed and departure.

    Both remedies are found along the sailing's path, so they are nearly exact. `faster` is the text
    of the remedy by speed.
    """
    voyage = first.planner.problem.voyage
    path = first.found.path if first.found else voyage.start[None]
    remedies = [Text("allow that time"), *_earlier(voyage, path, first.duration, arrive_by)]
    remedies += _faster(voyage, path, arrive_by, faster)
    return ArrivalError(
        "arrive_by = {0} can't be made: a departure at {1} arrives at {2} at the earliest. Either "
        "{3}",
        Moment(arrive_by),
        Moment(voyage.departure),
        Moment(first.arrival),
        Text.joined(", or ", remedies),
    )


def _earlier(voyage: Voyage, path: FloatArray, duration: float, arrive_by: float) -> list[Text]:
    """Return a text with the latest departure at which a path is in time, or nothing."""

    def is_in_time(earlier: float) -> bool:
        arrivals = voyage.leaving(voyage.departure - earlier).arrivals(path)
        return bool(arrivals[-1] <= arrive_by)

    most = min(voyage.departure - voyage.current.span[0], _EARLIEST * duration)
    found = _least(is_in_time, 0.0, most)
    return [] if found is None else [Text("leave at {0}", (Moment(voyage.departure - found),))]


def _faster(voyage: Voyage, path: FloatArray, arrive_by: float, text: str) -> list[Text]:
    """Return a text with the least speed at which a path is in time, or nothing."""

    def is_in_time(speed: float) -> bool:
        return bool(voyage.at_speed(speed).arrivals(path)[-1] <= arrive_by)

    speed = voyage.vessel.speed
    found = _least(is_in_time, speed, _FASTEST * speed)
    return [] if found is None else [Text(text.format(_rounded_up(found)))]


def _rounded_up(speed: float) -> str:
    """Write a speed to three digits, rounded up, so that it is still sufficient."""
    step = 10.0 ** (math.floor(math.log10(speed)) - 2)
    return f"{math.ceil(speed / step) * step:.3g}"


def _least(is_enough: Callable[[float], bool], low: float, high: float) -> float | None:
    """Return the least sufficient value, if every larger one is sufficient; else None."""
    if high <= low or not is_enough(high):
        return None
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if is_enough(middle) else (middle, high)
    return high
