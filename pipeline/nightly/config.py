"""The request of a night: one strict TOML file; every fault is reported with file and line."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from pipeline.errors import Fault, RequestError
from pipeline.machine.paths import expanded, folder_to_write, shown, unreadable_reason
from pipeline.scenario import catalogue, strict
from pipeline.scenario.season import Count, Interval, interval

_TIME = re.compile(r"(?:[01]\d|2[0-3]):[0-5]\dZ", re.ASCII)
_DAY = timedelta(days=1)
# Folder of results, relative to the working directory, if neither the file nor --output names one.
_DEFAULT_OUTPUT = Path("outputs/nightly")
_MEMBERS = Annotated[
    tuple[str, ...], BeforeValidator(lambda given: (given,) if isinstance(given, str) else given)
]

_HEADER = re.compile(r"^\s*(\[\[?)\s*([\w.\-]+)\s*\]\]?\s*(?:#.*)?$")
_KEY = re.compile(r"^\s*([\w\-]+)\s*=")


def _time_of_day(text: str) -> str:
    """Return the text, or raise ValueError if it is not a time of day in UTC."""
    if not _TIME.fullmatch(text):
        raise strict.RemediedError(f"= {text!r} is not a time of day in UTC; give it as '06:00Z'")
    return text


class DepartureSpec(strict.StrictModel):
    """`count` departures, the first at `first`, with the interval `every` between them."""

    first: Annotated[str, AfterValidator(_time_of_day)]
    every: Interval = "1d"
    count: Count = 1

    def departures(self) -> "tuple[Departure, ...]":
        """Return all departures."""
        hours, minutes = map(int, self.first.removesuffix("Z").split(":"))
        first, step = timedelta(hours=hours, minutes=minutes), interval(self.every)
        return tuple(Departure(first, i * step) for i in range(self.count))


@dataclass(frozen=True, slots=True)
class Departure:
    """A departure: the time of day of the first departure, and the delay after that."""

    time_of_day: timedelta
    later: timedelta

    @property
    def name(self) -> str:
        """Name, equal every night: 0600Z, or 0000Z+1 on the day after the first departure."""
        days, rest = divmod(self.time_of_day + self.later, _DAY)
        minutes = rest // timedelta(minutes=1)
        return f"{minutes // 60:02}{minutes % 60:02}Z" + (f"+{days}" if days else "")

    def after(self, reference: datetime) -> datetime:
        """Return the departure, given the reference time (aware, UTC) of the night's currents."""
        midnight = reference.replace(hour=0, minute=0, second=0, microsecond=0)
        first = midnight + self.time_of_day
        return (first if first >= reference else first + _DAY) + self.later


def _lines_of_keys(text: str) -> dict[str, int]:
    """Return the line (from 1) of each table and of each key that begins a line of a TOML file."""
    lines, counts, table = dict[str, int](), dict[str, int](), ""
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _HEADER.match(line):
            table = header[2]
            if header[1] == "[[":
                counts[table] = counts.get(table, -1) + 1
                table = f"{table}[{counts[table]}]"
            lines.setdefault(table, number)
        elif key := _KEY.match(line):
            lines.setdefault(f"{table}.{key[1]}" if table else key[1], number)
    return lines


def _located(lines: Mapping[str, int], fault: Fault, file: str) -> Fault:
    """Prepend the file and a line to a fault: that of its key or, without one, of its table."""
    place = fault.place
    while place and place not in lines:
        place = place.rpartition("." if "." in place else "[")[0]
    before, after = fault.around
    return Fault(f"line {lines.get(place, 1)}: {before}{fault.place}", after, f"{file}, ")


class CaseSpec(strict.StrictModel):
    """One [[cases]] table: a scenario, and the lists whose combinations are its cases."""

    scenario: strict.PathAsGiven
    seasons: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    pairs: strict.PathAsGiven | None = None
    vessels: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    departures: DepartureSpec | None = None
    members: Annotated[_MEMBERS, Field(min_length=1)] | None = None
    currents: Annotated[tuple[str, ...], Field(min_length=1)] | None = None


class NightSpec(strict.StrictModel):
    """The keys of a night's file."""

    schema_version: Literal[1] = 1
    output: str | None = None
    keep: strict.Integer = Field(default=14, ge=1, le=100_000)
    limit_hours: strict.Positive = Field(default=6.0, le=1000)
    look_percent: strict.NonNegative = 3.0
    stale_hours: strict.Positive = 36.0
    workers: strict.Integer | None = Field(default=None, ge=1, le=1024)
    # With 0.5 GB a worker can load its libraries and plan in a plane; a chart needs more.
    memory_gb: Annotated[strict.Number, Field(ge=0.5)] = 2.0
    cases: tuple[CaseSpec, ...] = Field(min_length=1)


@dataclass(frozen=True)
class NightConfig:
    """A file's values, its path, the lines of its keys, and the folder of all cycles."""

    spec: NightSpec
    path: Path
    lines: Mapping[str, int]
    output: Path

    def here(self, path: str) -> str:
        """Return a path that begins in this file's folder."""
        return path if path.startswith(("~", "/")) else str(self.path.parent / path)

    def located(self, key: str, text: str) -> Fault:
        """Return a fault of a key, with file and line before it."""
        return _located(self.lines, Fault(key, text), self.path.name)


def load_config(file: Path | None = None, output: Path | None = None) -> NightConfig:
    """Load a night's file, by default the one that comes with RENEW: two scenarios, run offline.

    `output` is the folder of all cycles, in place of the one in the file. Raises RequestError if
    the file is missing, not TOML, or invalid: one line for each fault.
    """
    path = catalogue.root() / "nightly.toml" if file is None else expanded(file, "--config")
    if reason := unreadable_reason(path):
        raise RequestError(f"--config: {shown(path)} {reason}; give a TOML file")
    if path.is_dir():
        raise RequestError(f"--config: {shown(path)} is a folder; name the TOML file in it")
    data = catalogue.read_toml(path)
    lines = _lines_of_keys(path.read_text(encoding="utf-8"))
    spec = strict.validated(NightSpec, data, lambda fault: _located(lines, fault, path.name))
    if output is None and spec.output is not None:
        folder = folder_to_write(path.parent / spec.output, "output")
    else:
        folder = folder_to_write(output or _DEFAULT_OUTPUT, "--output")
    return NightConfig(spec, path, lines, folder)
