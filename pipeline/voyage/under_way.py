"""Plan the voyage of a finished run again from where the vessel is, as a run of its own.

The vessel's last position is read from lines of NMEA 0183 (RMC) or JSON, however damaged. A
recommended minimum sentence is

    $GPRMC,hhmmss.ss,A,ddmm.mm,N,dddmm.mm,E,knots,course,ddmmyy,variation,E,mode,status*hh

with status V, mode N or empty fields where there is no fix, and `hh` the exclusive or of all bytes
between $ and *. RMC alone has date, time and position, so no other sentence is read, and one
regular expression is enough. A library would parse a hundred kinds of sentences, which would all be
dropped. And it would leave the difficult part to its caller: lines that are glued together, cut, or
not text at all.
"""

import contextlib
import json
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import lru_cache, reduce
from operator import xor
from pathlib import Path
from typing import Any

from pipeline.errors import RequestError
from pipeline.findings.text import exact_moment_text
from pipeline.machine.paths import expanded
from pipeline.scenario.catalogue import read_toml
from pipeline.scenario.loading import parse_scenario, with_currents
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import departure_name, interval, named_departure
from pipeline.stages.under_way import FinishedSeason, finished_season
from pipeline.voyage.request import UnderWayRequest

# Number of characters of a run's name that are kept when a time is added; and the form of a time
# that an earlier replanning added.
_NAME = 45
_ADDED = re.compile(r"-at-\d{4}-\d{2}-\d{2}t\d{4}z$")
# Keys of a season that leave its times open; and its title, which may name the old departure.
_OPEN = ("departures", "to_within", "arrive_by", "title")


def under_way_scenario(
    request: UnderWayRequest, finished: FinishedSeason | None = None
) -> tuple[Scenario, tuple[str, ...]]:
    """Return the scenario of the voyage ahead, with notes on how the request was understood.

    `finished` are the results that the request names, if they have been read already. Raises
    RequestError if the results are damaged or of a plane, or the request does not go with them; one
    line for each fault.
    """
    finished = finished or finished_season(request.results, request.season)
    left = _departed(finished, request)
    file = expanded(finished.folder / "scenario.toml", "RESULTS")
    data = _table(read_toml(file), finished, request, left)
    notes = (request.at.note,) if request.at.note else ()
    if request.currents:
        data, left_out = with_currents(data, request.currents)
        notes = (*notes, *left_out)
    return parse_scenario(data, file.parent), notes


def _departed(finished: FinishedSeason, request: UnderWayRequest) -> datetime:
    """Return when the vessel left: as planned, or as given where the plan has no departure."""
    left = finished.departed(request.departed)
    if left is None:
        raise RequestError(
            "--departed is missing: the plan has no departure; give when the vessel left, as "
            "2026-11-22T06:00Z"
        )
    if request.time < left:
        raise RequestError(
            f"--time {exact_moment_text(request.time)} is before the departure, "
            f"{exact_moment_text(left)}; give the time of the position"
        )
    return left


def _table(
    data: dict[str, Any], finished: FinishedSeason, request: UnderWayRequest, left: datetime
) -> dict[str, Any]:
    """Return the scenario's table for the rest of the voyage."""
    names = [one["name"] for one in finished.scenario["seasons"]]
    try:
        season = data["seasons"][names.index(finished.season["name"])]
    except (KeyError, IndexError):
        raise RequestError(
            f"--season {finished.season['name']!r} goes on from an anchorage: plan from here by "
            "renew go"
        ) from None
    if "speed" in season:
        raise RequestError(
            f"--season {finished.season['name']!r} chose its speeds, which can't be chosen again "
            "under way: plan from here by renew go --speed"
        )
    named = named_departure(finished.season["name"]) is not None
    again = {key: one for key, one in season.items() if key not in _OPEN}
    again |= {
        "name": departure_name(request.time) if named else finished.season["name"],
        "departure": request.time,
    }
    under_way = {
        "results": str(finished.folder.absolute()),
        "season": finished.season["name"],
        "departed": left,
        "same_currents": not request.currents,
    }
    if request.heading_deg is not None:
        under_way["heading_deg"] = request.heading_deg
    if "endurance" in data.get("havens", {}):
        rest = _endurance_left(data["havens"]["endurance"], left, request.time)
        data = {**data, "havens": {**data["havens"], "endurance": rest}}
    place = request.at
    first = _ADDED.sub("", data["name"])
    start = data["start"]
    title = data.get("title") or first
    return data | {
        "name": request.name or f"{first[:_NAME].rstrip('-_')}-at-{departure_name(request.time)}",
        "title": f"{title.partition(', planned again ')[0]}, planned again "
        f"{exact_moment_text(request.time)}",
        "start": [place.lon + 360.0 * round((start[0] - place.lon) / 360), place.lat],
        "seasons": [again],
        "under_way": under_way,
    }


def _endurance_left(endurance: str, left: datetime, now: datetime) -> str:
    """Return what is left of an endurance that counts from the departure, in whole minutes."""
    minutes = (interval(endurance) - (now - left)) // timedelta(minutes=1)
    if minutes < 1:
        raise RequestError(
            f"--time {exact_moment_text(now)} is beyond havens.endurance = {endurance!r} from the "
            f"departure, {exact_moment_text(left)}; check both"
        )
    return f"{minutes}min"


# Longer lines are no positions: NMEA 0183 allows 82 characters, a report of gpsd needs about 500.
_MAX_LINE = 4096
# Length of a file's end in which its last position is looked for, bytes: some hours of a receiver.
_TAIL = 1_000_000
_SENTENCE = re.compile(rb"(..RMC,([^*]*))\*([0-9A-Fa-f]{2})")
_FIELDS = re.compile(
    rb"(\d\d)(\d\d)(\d\d(?:\.\d*)?),A,(\d\d)(\d\d(?:\.\d*)?),([NS]),(\d{3})(\d\d(?:\.\d*)?),([EW]),"
    rb"[^,]*,[^,]*,(\d{6})(?:,.*)?"
)
# Place of the mode among the fields after RMC.
_MODE = 11
# The end of the last year that a date can have, s since 1970.
_LAST = datetime(9999, 12, 31, tzinfo=UTC).timestamp()
# The kind of gpsd's JSON that has a position.
_GPSD = "TPV"
# Least mode of such an object with a position.
_GPSD_MODE = 2


@dataclass(frozen=True, slots=True)
class Fix:
    """Where the vessel was: time (s since 1970, UTC), longitude and latitude (degrees)."""

    time: float
    lon: float
    lat: float


def last_fix(file: Path) -> Fix | None:
    """Return the last position in a file that grows; None if none is near its end.

    Raises OSError if the file can't be read.
    """
    with file.open("rb") as stream:
        size = stream.seek(0, os.SEEK_END)
        stream.seek(max(0, size - _TAIL))
        lines = stream.read(_TAIL).split(b"\n")
    # The first line may have been cut.
    whole = lines[1:] if size > _TAIL else lines
    fixes = [one for line in whole for one in positions(line)]
    return fixes[-1] if fixes else None


def positions(line: bytes) -> Iterator[Fix]:
    """Yield the positions in a line: none, one or several."""
    line = line.strip()
    if len(line) > _MAX_LINE:
        return
    if line.startswith(b"{"):
        yield from _of_json(line)
        return
    for sentence in line.split(b"$")[1:]:
        if (fix := _of_sentence(sentence)) is not None:
            yield fix


def _of_sentence(sentence: bytes) -> Fix | None:
    """Read a sentence without its $."""
    found = _SENTENCE.fullmatch(sentence.rstrip())
    if found is None or reduce(xor, found[1]) != int(found[3], 16):
        return None
    parts = _FIELDS.fullmatch(found[2])
    has_fix = found[2].split(b",")[_MODE : _MODE + 1] != [b"N"]
    return _of_fields(parts) if parts and has_fix else None


def _of_fields(parts: re.Match[bytes]) -> Fix | None:
    """Read the fields of a sentence with a position."""
    hour, minute, second, lat_deg, lat_min, north, lon_deg, lon_min, east, date = parts.groups()
    midnight = _midnight(date)
    # The last second of a day may be a leap second.
    if midnight is None or int(hour) > 23 or int(minute) > 59 or float(second) >= 61:
        return None
    if max(float(lat_min), float(lon_min)) >= 60:
        return None
    lat = (int(lat_deg) + float(lat_min) / 60) * (1 if north == b"N" else -1)
    lon = (int(lon_deg) + float(lon_min) / 60) * (1 if east == b"E" else -1)
    return _checked(midnight + int(hour) * 3600 + int(minute) * 60 + float(second), lon, lat)


@lru_cache(maxsize=8)
def _midnight(date: bytes) -> float | None:
    """Return the begin of a day ddmmyy, s since 1970; years are those of this century."""
    try:
        return datetime(2000 + int(date[4:]), int(date[2:4]), int(date[:2]), tzinfo=UTC).timestamp()
    except ValueError:
        return None


def _checked(time: float, lon: float, lat: float) -> Fix | None:
    """Return a position; None if its time, latitude or longitude is impossible."""
    is_one = 0 <= time < _LAST and abs(lat) <= 90 and abs(lon) <= 180
    return Fix(time, lon, lat) if is_one else None


def _of_json(line: bytes) -> Iterator[Fix]:
    """Read a line that begins with an object of JSON; more objects may follow on the line."""
    with contextlib.suppress(ValueError, RecursionError):
        rest = line.decode()
        while rest.startswith("{"):
            found, end = json.JSONDecoder().raw_decode(rest)
            if (fix := _of_object(found)) is not None:
                yield fix
            rest = rest[end:].strip()
        yield from positions(rest.encode())


def _of_object(found: dict[str, object]) -> Fix | None:
    """Read time, lon and lat; of gpsd's objects only those with a position."""
    mode = found.get("mode", _GPSD_MODE)
    if found.get("class", _GPSD) != _GPSD or (isinstance(mode, int) and mode < _GPSD_MODE):
        return None
    time, lon, lat = map(_number, (_seconds(found.get("time")), found.get("lon"), found.get("lat")))
    return None if time is None or lon is None or lat is None else _checked(time, lon, lat)


def _number(value: object) -> float | None:
    """Return a number; None for a number beyond a float's range, a truth value and all else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value)
    except OverflowError:
        return None


def _seconds(time: object) -> object:
    """Return a time with its zone in s since 1970; anything else as it is."""
    if not isinstance(time, str):
        return time
    try:
        read = datetime.fromisoformat(time)
        return None if read.tzinfo is None else read.timestamp()
    except (ValueError, OverflowError):
        return None
