"""Read what is typed for an option: speeds, lengths, times, months, files, vessels.

Each reader takes a text, or a value that is typed already, and raises ValueError or RequestError
with the text, the reason and the remedy. `pipeline/voyage/positions.py` reads positions.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.machine.paths import NOT_THERE, expanded, resolved, shown, unreadable_reason
from pipeline.texts import in_years
from pipeline.voyage.table import each

if TYPE_CHECKING:
    from pipeline.scenario.catalogue import VesselSpec

# A comma before three figures may part thousands, as in 1,200: it is not read as a decimal one.
_QUANTITY = re.compile(
    r"\s*(?![+-]?[1-9]\d*,\d{3}(?!\d))([+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+))\s*([^\d\s].*?)?\s*"
)
# A knot, m/s: a nautical mile of 1852 m per hour.
_KNOT = 1852 / 3600
_SPEEDS = {
    **dict.fromkeys(("kn", "kt", "kts", "knot", "knots"), _KNOT),
    **dict.fromkeys(("m/s", "ms-1"), 1.0),
    **dict.fromkeys(("km/h", "kmh", "kph"), 1 / 3.6),
    **dict.fromkeys(("mph", "mi/h"), 1609.344 / 3600),
}
_LENGTHS = {
    **dict.fromkeys(("", "m", "metre", "metres", "meter", "meters"), 1.0),
    "km": 1000.0,
    **dict.fromkeys(("ft", "feet", "foot", "'"), 0.3048),
    **dict.fromkeys(("nm", "nmi"), 1852.0),
}
RANGE = ".."
"""Separates the lowest and the highest speed of a range."""
_MONTH = re.compile(r"\d{4}-(0[1-9]|1[0-2])", re.ASCII)


def _read(text: str, units: dict[str, float], remedy: str) -> float:
    """Read a number with its unit; return it in m or m/s."""
    matched = _QUANTITY.fullmatch(text)
    factor = units.get((matched[2] or "").lower()) if matched is not None else None
    if matched is None or factor is None:
        raise ValueError(f"{text.strip()!r} is not understood; give {remedy}")
    return float(matched[1].replace(",", ".")) * factor


def _positive(text: str, reader: Callable[[str], float]) -> float:
    """Read a figure above 0."""
    figure = reader(text)
    if figure <= 0:
        raise ValueError(f"{text} is not above 0; give a larger figure")
    return figure


speed_m_s = partial(_read, units=_SPEEDS, remedy="a speed such as 12kn, 6.2m/s, 22km/h or 14mph")
"""Read a speed, m/s, which must have a unit."""
length_m = partial(_read, units=_LENGTHS, remedy="a length such as 90m, 300ft or 0.5nm")
"""Read a length, m; without a unit it is in metres."""
dimension_m = partial(_positive, reader=length_m)
"""Read a dimension of a vessel, m."""
above_0_m_s = partial(_positive, reader=speed_m_s)
"""Read a speed above 0, m/s."""


def speed_or_range(given: str | tuple[float, float]) -> float | tuple[float, float]:
    """Read a vessel's speed, m/s, or the lowest and the highest one to choose from.

    A range is a pair in m/s, or a text: 4kn..9kn or 4..9kn.
    """
    if not isinstance(given, str):
        (low, high), text = given, f"{given[0]!r}m/s{RANGE}{given[1]!r}m/s"
    elif RANGE not in given:
        return above_0_m_s(given)
    else:
        text = given.strip()
        least, _, most = given.partition(RANGE)
        unit = matched[2] if (matched := _QUANTITY.fullmatch(most)) else None
        if unit and (bare := _QUANTITY.fullmatch(least)) and not bare[2]:
            least += unit
        low, high = speed_m_s(least), speed_m_s(most)
    if not low > 0:
        raise ValueError(f"{text!r} begins at a speed of 0 or less; give two speeds above 0")
    if not low <= high:
        raise ValueError(f"{text!r} begins above its end; exchange the two speeds")
    return low, high


def read_clearance_m(given: str | float) -> float:
    """Read a distance from no-go areas, true metres."""
    metres = length_m(given) if isinstance(given, str) else given
    if metres < 0:
        raise ValueError(f"{given} is below 0; give metres, 0 or more")
    return metres


def read_padding_m(given: str | float) -> str | float:
    """Read a padding: 'adaptive', 'triangle' or 'none', or true metres."""
    if (word := str(given).lower()) in ("adaptive", "triangle", "none"):
        return word
    return read_clearance_m(given)


def read_shortfall(given: str) -> str:
    """Read what to do where no way keeps the padding."""
    if given not in ("refuse", "least"):
        raise ValueError(f"{given!r} is not understood; give 'refuse' or 'least'")
    return given


def zoned_time(given: str | datetime) -> datetime:
    """Read a time with a zone, and return it in UTC."""
    try:
        time = datetime.fromisoformat(given) if isinstance(given, str) else given
        if time.tzinfo is not None:
            return in_years(time).astimezone(UTC)
    except (ValueError, OverflowError):
        raise ValueError(
            f"{given} is not a time of the years 1700 to 2199; give date, time and zone, such as "
            "2026-11-22T06:00Z"
        ) from None
    text = time.isoformat(timespec="minutes")
    raise ValueError(f"{given} has no zone; add it: {text}Z for UTC, or {text}+08:00")


def read_interval(text: str) -> str:
    """Read a time that something lasts, which a scenario has as a text."""
    from pipeline.scenario.season import interval

    interval(text)
    return text


def read_months(texts: Sequence[str]) -> tuple[str, ...]:
    """Read months 'YYYY-MM'; each may be given once."""
    from pipeline.scenario.season import period  # loads for a tenth of a second

    faults = []
    for i, text in enumerate(texts):
        if not _MONTH.fullmatch(text):
            faults.append(f"{text} is not a month; give it as 'YYYY-MM', such as 2024-07")
        elif text in texts[:i]:
            faults.append(f"{text} is given twice; leave one out")
        else:
            try:
                period(text)
            except ValueError as error:
                faults.append(str(error))
    if faults:
        raise ValueError(*faults)
    return tuple(texts)


def readable(remedy: str) -> Callable[[str | Path], Path]:
    """Return a reader of paths; `remedy` says what to give in place of a file that is missing."""

    def read(path: str | Path) -> Path:
        file = resolved(path, "")
        if reason := unreadable_reason(file):
            hint = f"; {remedy}" if reason == NOT_THERE else ""
            raise ValueError(f"= '{shown(file)}' {reason}{hint}")
        return file

    return read


# What stands behind a file's path, "rocks.geojson,radius=50m": how it is read, and its key in a
# scenario.
_FACTS: Mapping[str, tuple[Callable[[str], Any], str]] = {
    "layer": (str, "layer"),
    "crs": (str, "crs"),
    "radius": (dimension_m, "radius_m"),
    "accuracy": (dimension_m, "accuracy_m"),
    "positive": (str, "positive"),
}
VECTOR_FACTS = ("layer", "crs", "radius", "accuracy")
"""What may be said of a vector file."""


def described_file(remedy: str, facts: Sequence[str] = VECTOR_FACTS) -> Callable[[Any], Any]:
    """Return a reader of a file and some facts about it, which gives a scenario's table.

    `remedy` is as for `readable`.
    """
    check = readable(remedy)

    def read(given: str | Path) -> dict[str, Any]:
        path, *pieces = re.split(rf",(?=(?:{'|'.join(_FACTS)})=)", str(given))
        table: dict[str, Any] = {}
        for name, _, text in (piece.partition("=") for piece in pieces):
            if name not in facts:
                raise ValueError(f"{given}: give no {name}, but {', '.join(facts)}")
            value, key = _FACTS[name]
            table[key] = value(text)
        return {"path": str(check(path)), **table}

    return read


def read_charts(given: str | Path | Sequence[str | Path]) -> tuple[dict[str, Any], ...]:
    """Read charts: names of the catalogue, and files with facts about them, as tables."""
    from pipeline.scenario import catalogue

    known = catalogue.names("sources")
    file = described_file("give a vector file, a folder of S-57 cells, or osm-land")
    texts = [given] if isinstance(given, str | Path) else given
    return each(lambda one: {"name": str(one)} if str(one) in known else file(one))(texts)


def read_currents(given: Sequence[str | Path]) -> tuple[str, ...]:
    """Read sources of the catalogue and paths of files; patterns are looked up later."""
    from pipeline.scenario.loading import require_currents

    currents = tuple(map(str, given))
    require_currents(currents, "")
    return currents


def read_variables(given: str | Sequence[str]) -> tuple[str, str]:
    """Read the names of two variables: "water_u,water_v"."""
    names = given.replace(",", " ").split() if isinstance(given, str) else list(given)
    if len(names) != 2:
        raise ValueError(f"{' '.join(names)!r} is not two names; give them as water_u,water_v")
    return names[0], names[1]


def read_station(given: str | Path) -> str:
    """Read a station's name in the catalogue, or the path of its file."""
    from pipeline.scenario import catalogue

    text = str(given)
    return text if text in catalogue.stations() else str(resolved(Path(text), ""))


def read_members(text: str) -> dict[str, Any]:
    """Read the members of a current: its files, one of their dimensions, or a speed of eddies.

    Return the table of a scenario's season.
    """
    given = text.strip()
    if given.isidentifier():
        return {"along": given}
    try:
        return {"spread": speed_m_s(given)}
    except ValueError as error:
        raise ValueError(
            f"= {given!r}: {error}, 'files', or a dimension such as 'realization'"
        ) from None


def read_name(text: str) -> str:
    """Read the name of a scenario."""
    from pydantic import TypeAdapter, ValidationError

    from pipeline.scenario.strict import Name

    try:
        return TypeAdapter(Name).validate_python(text)
    except ValidationError:
        raise ValueError(
            f"= {text!r} is not a name: use up to 64 lower-case letters, digits, '-' and '_'"
        ) from None


def read_vessel(given: "str | VesselSpec") -> "VesselSpec":
    """Read a vessel by its name in the catalogue, or by the path of a file with a vessel's keys."""
    from pipeline.scenario import catalogue
    from pipeline.scenario.strict import looks_like_path, near_miss

    if not isinstance(given, str):
        return given
    if looks_like_path(given):
        file = expanded(given, "")
        if reason := unreadable_reason(file):
            raise ValueError(f"{given} {reason}; `renew show usv-7m` prints one")
        return catalogue.vessel_of_file(file, given)
    known = catalogue.names("vessels")
    if given not in known:
        hint = "write a file as a path: './my-vessel.toml'"
        raise ValueError(f"{given!r} is not in the catalogue: {near_miss(given, known)}; {hint}")
    return catalogue.vessel(given)
