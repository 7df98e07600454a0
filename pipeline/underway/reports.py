"""Positions of a vessel from lines of NMEA 0183 (RMC) or JSON, however damaged.

A recommended minimum sentence is

    $GPRMC,hhmmss.ss,A,ddmm.mm,N,dddmm.mm,E,knots,course,ddmmyy,variation,E,mode,status*hh

with status V, mode N or empty fields where there is no fix, and `hh` the exclusive or of all bytes
between $ and *. RMC is the one sentence with date, time and position, so none of the others is read
and one expression does: a library brings its hundred sentences, each to be parsed and dropped, and
what is hard here, lines that are glued, cut or not text at all, it leaves to its caller.
"""

import json
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache, reduce
from operator import xor
from pathlib import Path
from typing import Literal

# Longer lines are no positions: NMEA 0183 allows 82 characters, a report of gpsd needs about 500.
_MAX_LINE = 4096
# Length of a file's end in which its last position is looked for, bytes: some hours of a receiver.
_TAIL = 1_000_000
_SENTENCE = re.compile(rb"(..RMC,([^*]*))\*([0-9A-Fa-f]{2})")
_FIELDS = re.compile(
    rb"(\d\d)(\d\d)(\d\d(?:\.\d*)?),A,(\d\d)(\d\d(?:\.\d*)?),([NS]),(\d{3})(\d\d(?:\.\d*)?),([EW]),"
    rb"[^,]*,[^,]*,(\d{6})(?:,.*)?"
)
# Places of status, latitude, longitude, date and mode among the fields after RMC.
_STATUS, _NEEDED, _MODE = 1, (0, 1, 2, 4, 8), 11
# The end of the last year that a date can have, s since 1970.
_LAST = datetime(9999, 12, 31, tzinfo=UTC).timestamp()
# The kind of gpsd's JSON that has a position, and the least mode in which it has one.
_GPSD, _GPSD_MODE = "TPV", 2


@dataclass(frozen=True, slots=True)
class Fix:
    """Where the vessel was: time (s since 1970, UTC), longitude and latitude (degrees)."""

    time: float
    lon: float
    lat: float


@dataclass(frozen=True, slots=True)
class Unread:
    """What has no position: a receiver without a fix, something else, or a line that is broken."""

    kind: Literal["void", "other", "broken"]
    reason: str = ""


class LineCutter:
    """Cuts a stream of bytes into lines, the same ones however the stream arrives."""

    def __init__(self) -> None:
        self._rest = b""

    def lines(self, chunk: bytes) -> list[bytes]:
        """Return the lines that a chunk completes, each cut to the longest that is read."""
        *whole, rest = (self._rest + chunk).split(b"\n")
        self._rest = rest[: _MAX_LINE + 1]
        return [line[: _MAX_LINE + 1] for line in whole]

    def last(self) -> list[bytes]:
        """Return what the stream ends with after its last line end, if there is anything."""
        return [self._rest] if self._rest else []


def last_fix(file: Path) -> Fix | None:
    """Return the last position in a file that grows; None if none is near its end.

    Raises
    ------
    OSError
        The file can't be read.
    """
    with file.open("rb") as stream:
        size = stream.seek(0, os.SEEK_END)
        stream.seek(max(0, size - _TAIL))
        cutter = LineCutter()
        lines = [*cutter.lines(stream.read(_TAIL)), *cutter.last()]
    # The first line may have been cut.
    whole = lines[1:] if size > _TAIL else lines
    fixes = [one for line in whole for one in reports(line) if isinstance(one, Fix)]
    return fixes[-1] if fixes else None


def reports(line: bytes) -> Iterator[Fix | Unread]:
    """Read a line: none, one or several reports."""
    is_whole, line = len(line) <= _MAX_LINE, line.strip()
    if not is_whole:
        yield Unread("broken", f"longer than {_MAX_LINE:,} bytes")
    elif line.startswith(b"{"):
        yield from _of_json(line)
    elif line:
        head, *sentences = line.split(b"$")
        # Before the $ may stand a tag block; a sentence for ships' radio begins with "!".
        if head and not head.startswith((b"\\", b"!")):
            yield Unread("broken", "neither a sentence of NMEA 0183 nor JSON")
        elif not sentences:
            yield Unread("other")
        for sentence in sentences:
            yield _of_sentence(sentence)


def _of_sentence(sentence: bytes) -> Fix | Unread:
    """Read a sentence without its $."""
    if sentence[2:6] != b"RMC,":
        is_whole = re.match(rb"[A-Z0-9]{4,},", sentence)
        return Unread("other") if is_whole else Unread("broken", "a sentence that is cut off")
    found = _SENTENCE.fullmatch(sentence.rstrip())
    if found is None:
        return Unread("broken", "an RMC sentence without a checksum at its end")
    summed, stated = reduce(xor, found[1]), int(found[3], 16)
    if summed != stated:
        return Unread("broken", f"the checksum is {summed:02X}, not {stated:02X} as stated")
    fields = found[2].split(b",")
    if len(fields) > max(_NEEDED) and (
        fields[_STATUS] == b"V"
        or fields[_MODE : _MODE + 1] == [b"N"]
        or not all(fields[at] for at in _NEEDED)
    ):
        return Unread("void")
    parts = _FIELDS.fullmatch(found[2])
    return _of_fields(parts) if parts else Unread("broken", "fields that RMC does not have")


def _of_fields(parts: re.Match[bytes]) -> Fix | Unread:
    """Read the fields of a sentence with a position."""
    hour, minute, second, lat_deg, lat_min, north, lon_deg, lon_min, east, date = parts.groups()
    midnight = _midnight(date)
    # The last second of a day may be a leap second.
    if midnight is None or int(hour) > 23 or int(minute) > 59 or float(second) >= 61:
        return Unread("broken", "no such date or time")
    if max(float(lat_min), float(lon_min)) >= 60:
        return Unread("broken", "60 minutes of arc or more")
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


def _checked(time: float, lon: float, lat: float) -> Fix | Unread:
    """Return a position that may be one."""
    if not (0 <= time < _LAST and abs(lat) <= 90 and abs(lon) <= 180):
        return Unread("broken", "no position on earth, or no time")
    return Fix(time, lon, lat)


def _of_json(line: bytes) -> Iterator[Fix | Unread]:
    """Read a line that begins as an object of JSON; more of them may follow on it."""
    try:
        rest = line.decode()
        while rest.startswith("{"):
            found, end = json.JSONDecoder().raw_decode(rest)
            yield _of_object(found)
            rest = rest[end:].strip()
    except (ValueError, RecursionError):
        yield Unread("broken", "JSON that can't be read")
    else:
        yield from reports(rest.encode())


def _of_object(found: dict[str, object]) -> Fix | Unread:
    """Read time, lon and lat; of gpsd's objects only those with a position."""
    if "class" in found and found["class"] != _GPSD:
        return Unread("other")
    mode = found.get("mode", _GPSD_MODE)
    values = [found.get(name) for name in ("time", "lon", "lat")]
    if (isinstance(mode, int) and mode < _GPSD_MODE) or all(one is None for one in values[1:]):
        return Unread("void")
    time, lon, lat = map(_number, (_seconds(values[0]), *values[1:]))
    if time is None or lon is None or lat is None:
        return Unread("broken", "JSON needs the numbers lon and lat, and time: ISO 8601 or seconds")
    return _checked(time, lon, lat)


def _number(value: object) -> float | None:
    """Return a number; None for anything else, a truth value or one beyond a float's range."""
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
