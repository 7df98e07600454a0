"""Read the times of a voyage: its months, or departure, latest arrival and range of speeds."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

from pipeline.errors import RequestError
from pipeline.findings.text import moment_text
from pipeline.scenario.season import departure_name, period
from pipeline.voyage.vessel_options import speed_range_m_s

_MONTH = re.compile(r"\d{4}-\d{2}", re.ASCII)
# Largest number of departures in the first sample of a window, and minimum time between two.
_MAX_DEPARTURES, _MIN_STEP = 25, timedelta(minutes=30)
# The planner adds departures until the best is known to this share of the window, or to an hour if
# that is shorter.
_PROVEN_SHARE, _MAX_PROVEN = 1 / 48, timedelta(hours=1)
_MINUTE = timedelta(minutes=1)


def read_months(texts: Sequence[str]) -> dict[str, str]:
    """Return the title of each month 'YYYY-MM', such as "July 2024", in the order given.

    Raises
    ------
    RequestError
        The message has a line for each text that is not a month or is given twice.
    """
    titles: dict[str, str] = {}
    faults = []
    for text in texts:
        if not _MONTH.fullmatch(text):
            faults.append(f"--month {text} is not a month; give it as 'YYYY-MM', such as 2024-07")
            continue
        if text in titles:
            faults.append(f"--month {text} is given twice; leave one out")
            continue
        try:
            titles[text] = f"{period(text).begin:%B %Y}"
        except ValueError as error:
            faults.append(f"--month {error}")
    if faults:
        raise RequestError(faults)
    return titles


@dataclass(frozen=True, slots=True)
class Departing:
    """Earliest departure, latest departure and latest arrival, UTC; the last two may be None.

    With a range of `speeds`, m/s, the vessel arrives in time from every departure of the window.
    """

    begin: datetime
    until: datetime | None = None
    arrive_by: datetime | None = None
    speeds: tuple[float, float] | None = None

    @property
    def passage(self) -> dict[str, Any]:
        """The keys of a season for departure, latest arrival and speeds."""
        passage: dict[str, Any] = {"departure": self.begin}
        if self.arrive_by is not None:
            passage["arrive_by"] = self.arrive_by
        if self.speeds is not None:
            passage["speed"] = dict(zip(("least", "most"), self.speeds, strict=True))
        return passage

    @property
    def window(self) -> dict[str, Any]:
        """The keys of a season for the departures to choose from, latest arrival and speeds."""
        if self.until is None:
            return self.passage
        window = self.until - self.begin
        step = max(_MIN_STEP, math.ceil(window / (_MAX_DEPARTURES - 1) / _MINUTE) * _MINUTE)
        departures = {
            "first": self.begin,
            "every": f"{step // _MINUTE}min",
            "count": window // step + 1,
        }
        if window % step:  # the end of the window is a departure to choose from, too
            departures["last"] = self.until
        when = self.passage | {"departures": departures}
        del when["departure"]
        return when

    def season(self, currents: list[str | list[str]], *, has_tide: bool) -> dict[str, Any]:
        """Return the [[seasons]] table of a voyage in changing currents.

        With a tide over the depths nothing is known of departures between those planned.
        """
        title, when = f"Departure {moment_text(self.begin)}", self.window
        if self.arrive_by is not None:
            title = f"Arrival by {moment_text(self.arrive_by)}"
        if self.until is not None:
            title = f"Departure from {moment_text(self.begin)} to {moment_text(self.until)}"
            within = min((self.until - self.begin) * _PROVEN_SHARE, _MAX_PROVEN)
            if self.arrive_by is None and not has_tide:
                when["to_within"] = f"{math.ceil(within / _MINUTE)}min"
        return {
            "name": departure_name(self.begin),
            "title": title,
            **when,
            "time_method": "changing",
            "currents": currents,
        }


def departing(depart: str, until: str, arrive_by: str, speeds: str = "") -> Departing | None:
    """Read --depart, --until, --arrive-by and a range of --speed; None without --depart.

    Raises
    ------
    RequestError
        One line for each fault.
    """
    faults: list[str] = []
    times = [
        zoned_time(option, text, faults)
        for option, text in (("--depart", depart), ("--until", until), ("--arrive-by", arrive_by))
    ]
    for option, text in (("--until", until), ("--arrive-by", arrive_by)):
        if text and not depart:
            faults.append(f"{option} needs --depart, the earliest departure; add --depart")
    speeds_m_s = _speeds(speeds, depart, arrive_by, faults)
    begin, *others = times
    for (option, text), time in zip(
        (("--until", until), ("--arrive-by", arrive_by)), others, strict=True
    ):
        if begin is not None and time is not None and time <= begin:
            faults.append(f"{option} {text} is not after --depart {depart}; give a later time")
    if faults:
        raise RequestError(faults)
    return None if begin is None else Departing(begin, others[0], others[1], speeds_m_s)


def _speeds(
    speeds: str, depart: str, arrive_by: str, faults: list[str]
) -> tuple[float, float] | None:
    """Read a range of speeds, m/s; add errors, also for missing options, to `faults`."""
    if not speeds:
        return None
    if not arrive_by:
        lacking = "--arrive-by" if depart else "--depart and --arrive-by"
        faults.append(
            f"--speed {speeds} is a range, to save fuel between the times --depart and "
            f"--arrive-by; add {lacking}, or give one speed"
        )
    try:
        return speed_range_m_s(speeds)
    except ValueError as error:
        faults.append(f"--speed {error}")
        return None


def zoned_time(option: str, text: str, faults: list[str]) -> datetime | None:
    """Read a time with a zone, and return it in UTC; add errors to `faults`."""
    if not text:
        return None
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        faults.append(
            f"{option} {text} is not a time; give date, time and zone, such as 2026-11-22T06:00Z"
        )
        return None
    if time.tzinfo is None:
        faults.append(f"{option} {text} has no zone; add it: {text}Z for UTC, or {text}+08:00")
        return None
    return time.astimezone(UTC)
