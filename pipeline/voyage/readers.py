"""Read what is typed for an option: positions, speeds, lengths, times, months, files, vessels.

Each reader takes a text, or a value that is typed already, and raises ValueError or RequestError
with the text, the reason and the remedy. Positions are read as people write them: in decimals or
minutes, with N, S, E or W before or after.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.errors import RequestError
from pipeline.machine.paths import NOT_THERE, expanded, resolved, shown, unreadable_reason

if TYPE_CHECKING:
    from pipeline.scenario.catalogue import VesselSpec

EXAMPLES = "'120.30,12.80' (longitude first), '12.80N 120.30E' or '12°48'N 120°18'E'"
_NUMBER = r"[+-]?\d+(?:\.\d*)?|[+-]?\.\d+"
_TOKENS = re.compile(rf"(?P<number>{_NUMBER})|(?P<letter>[NSEW])|(?P<comma>[,;])|(?P<unit>[°'\"])")
# Other characters for minus, and for the signs of degrees, minutes and seconds.
_SPELLINGS = str.maketrans(
    dict.fromkeys("−–", "-")
    | dict.fromkeys("º˚", "°")
    | dict.fromkeys("′’`\N{LEFT SINGLE QUOTATION MARK}\N{MODIFIER LETTER PRIME}", "'")
    | dict.fromkeys("″”“ʺ", '"')
)
# A hyphen between two numbers, as in "6-08S": on nautical charts it separates degrees and minutes.
_HYPHEN = re.compile(r"(?<=\d)-(?=\d)")
_LETTERS = re.compile(r"[NSEW]")
# Two commas between digits, with other characters between: decimal commas, as in "120,30 12,80".
_DECIMAL_COMMAS = re.compile(r"^([^,]*\d),(\d[^,]*(?:;|\s)[^,]*\d),(\d[^,]*)$")
# If start or goal lies west of this longitude, 360 degrees are added to both: longitudes in a
# scenario begin at -180, and the region needs room west of start and goal.
_WESTERNMOST = -160.0
_AXIS = {"N": "lat", "S": "lat", "E": "lon", "W": "lon"}


@dataclass(frozen=True, slots=True)
class Position:
    """A position in degrees; `note` is "" or says how a text without letters was understood.

    `either_order` is True if the two figures may also be a latitude and a longitude. At an
    anchorage the vessel may `wait` for an interval, such as '6h'.
    """

    lon: float
    lat: float
    note: str = ""
    either_order: bool = False
    wait: str = ""


# A coordinate, degrees, and the letter of its hemisphere, "" if it has none.
_Coordinate = tuple[float, str]


def halves(words: Sequence[str]) -> tuple[str, str]:
    """Return the texts of start and goal from the arguments of a command line, half for each.

    Raises
    ------
    RequestError
        The number of arguments is odd or 0.
    """
    if len(words) < 2 or len(words) % 2:
        given = " ".join(word.strip() for word in words)
        raise RequestError(
            f"{given!r} is not a start and a goal: give two positions, such as {EXAMPLES}, each in "
            "quotes where it has spaces"
        )
    half = len(words) // 2
    return " ".join(words[:half]), " ".join(words[half:])


def read_end(given: str | tuple[float, float]) -> Position:
    """Read start or goal: a text, or (lon, lat) in degrees; ValueError if it can't be read."""
    try:
        return read_position(given)
    except ValueError as error:
        raise ValueError(f"= {error}") from None


def read_stop(given: str | tuple[float, float]) -> Position:
    """Read a point on the way; an anchorage is 'POSITION wait 6h'."""
    if not isinstance(given, str):
        return read_position(given)
    place, wait = (part.strip() for part in given.partition(" wait ")[::2])
    return replace(read_position(place), wait=wait)


def continued(place: Position, lon: float) -> Position:
    """Return a position with the longitude that is nearest to another, also beyond 180 degrees."""
    return replace(place, lon=place.lon + 360 * round((lon - place.lon) / 360))


def joined(start: Position, goal: Position) -> tuple[Position, Position]:
    """Return start and goal; the goal continues beyond 180 degrees if the way across is shorter."""
    goal = continued(goal, start.lon)
    turn = 360 if min(start.lon, goal.lon) < _WESTERNMOST else 0
    return replace(start, lon=start.lon + turn), replace(goal, lon=goal.lon + turn)


def read_position(given: str | tuple[float, float]) -> Position:
    """Read one position: a text, or two numbers, degrees.

    Without letters of hemispheres, longitude comes first unless only the other order is possible.

    Raises
    ------
    ValueError
        It can't be read; the message has the text, the reason and the remedy.
    """
    text = given.strip() if isinstance(given, str) else f"{given[0]!r},{given[1]!r}"
    try:
        if not isinstance(given, str):
            return _ordered((float(given[0]), ""), (float(given[1]), ""), text)
        plain = text.translate(_SPELLINGS).replace("''", '"').upper()
        if _LETTERS.search(plain):
            plain = _HYPHEN.sub(" ", plain)
        return _ordered(*_coordinates(_DECIMAL_COMMAS.sub(r"\1.\2.\3", plain)), text)
    except ValueError as error:
        raise ValueError(f"{text!r} {error}") from None


def _ordered(first: _Coordinate, second: _Coordinate, text: str) -> Position:
    """Return the position, after deciding by hemisphere or size which coordinate is longitude."""
    (x, letter), (y, other_letter) = first, second
    axes = _AXIS.get(letter), _AXIS.get(other_letter)
    if any(axes) and set(axes) != {"lon", "lat"}:
        raise ValueError("needs one of N and S, and one of E and W, or none of them")
    is_swapped = axes[0] == "lat"
    note = ""
    either_order = not any(axes) and max(abs(x), abs(y)) <= 90
    if not any(axes) and abs(y) > 90 >= abs(x):
        is_swapped = True
        note = f"{text!r} was read as latitude, longitude: {y:g} can only be a longitude"
    elif either_order:
        note = (
            f"{text!r} was read as longitude {x:g}, latitude {y:g}; "
            "the other way round it would be water, too: write N or S and E or W to make it clear"
        )
    lon, lat = (y, x) if is_swapped else (x, y)
    if not abs(lat) <= 90:
        raise ValueError(f"has the latitude {lat:g}; give one from -90 to 90 degrees")
    if not -180 <= lon <= 360:
        raise ValueError(f"has the longitude {lon:g}; give one from -180 to 360 degrees")
    return Position(lon, lat, note, either_order)


def _coordinates(text: str) -> tuple[_Coordinate, _Coordinate]:
    """Split a normalised text into its two coordinates."""
    tokens = list(_TOKENS.finditer(text))
    if _TOKENS.sub("", text).strip():
        raise ValueError(f"is not a position; write it like {EXAMPLES}")
    letters = [token for token in tokens if token.lastgroup == "letter"]
    parts: list[list[re.Match[str]]]
    if letters:
        if len(letters) != 2:
            raise ValueError("needs one of N and S, and one of E and W, or none of them")
        is_before = tokens[0].lastgroup == "letter"
        middle = tokens.index(letters[1]) if is_before else tokens.index(letters[0]) + 1
        parts = [tokens[:middle], tokens[middle:]]
    else:
        parts = _halves(tokens)
    first, second = (_coordinate(part) for part in parts)
    return first, second


def _halves(tokens: list[re.Match[str]]) -> list[list[re.Match[str]]]:
    """Split tokens without letters at the comma, or between equal counts of numbers."""
    commas = [i for i, token in enumerate(tokens) if token.lastgroup == "comma"]
    if len(commas) == 1:
        return [tokens[: commas[0]], tokens[commas[0] + 1 :]]
    numbers = [i for i, token in enumerate(tokens) if token.lastgroup == "number"]
    if commas or not numbers or len(numbers) % 2:
        raise ValueError(f"is not a pair of coordinates; write it like {EXAMPLES}")
    middle = numbers[len(numbers) // 2]
    return [tokens[:middle], tokens[middle:]]


def _coordinate(tokens: list[re.Match[str]]) -> _Coordinate:
    """Read degrees, minutes and seconds of one coordinate, with its hemisphere."""
    numbers = [token[0] for token in tokens if token.lastgroup == "number"]
    units = [token[0] for token in tokens if token.lastgroup == "unit"]
    letter = "".join(token[0] for token in tokens if token.lastgroup == "letter")
    if not 1 <= len(numbers) <= 3:
        raise ValueError(f"is not a pair of coordinates; write it like {EXAMPLES}")
    if units != ["°", "'", '"'][: len(units)] or len(units) > len(numbers):
        raise ValueError("has its signs of degrees, minutes and seconds (° ' \") in another order")
    if letter and numbers[0][0] in "+-":
        raise ValueError(f"has both a sign and {letter}; leave one of them out")
    if any(number[0] in "+-" for number in numbers[1:]):
        raise ValueError("has a sign before minutes or seconds; give it before the degrees")
    if any("." in number for number in numbers[:-1]):
        raise ValueError("has a fraction before the last of degrees, minutes and seconds; drop one")
    values = [abs(float(number)) for number in numbers]
    if any(value >= 60 for value in values[1:]):
        raise ValueError(f"has {max(values[1:]):g} minutes or seconds; give less than 60")
    size = sum(value / 60**power for power, value in enumerate(values))
    is_negative = numbers[0].startswith("-") or letter in {"S", "W"}
    return -size if is_negative else size, letter


def voyage_name(start: Position, goal: Position) -> str:
    """Return the name of a voyage, made of the degrees and minutes of start and goal."""
    return f"{_short(start)}-to-{_short(goal)}"


def _short(position: Position) -> str:
    """Return a position as part of a name: 12n48-120e18."""
    lon = (position.lon + 180) % 360 - 180
    parts = []
    for degrees, letters in ((position.lat, "ns"), (lon, "ew")):
        minutes = round(abs(degrees) * 60)
        parts.append(f"{minutes // 60}{letters[degrees < 0]}{minutes % 60:02d}")
    return "-".join(parts)


def spelled(position: Position) -> str:
    """Return a position for a title: 12.80 N 120.30 E."""
    lon = (position.lon + 180) % 360 - 180
    return f"{abs(position.lat):.2f} {'NS'[position.lat < 0]} {abs(lon):.2f} {'EW'[lon < 0]}"


_QUANTITY = re.compile(r"\s*([+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+))\s*([^\d\s].*?)?\s*")
# A knot, m/s: a nautical mile of 1852 m per hour.
_KNOT = 1852 / 3600
_SPEEDS = {
    **dict.fromkeys(("kn", "kt", "kts", "knot", "knots"), _KNOT),
    **dict.fromkeys(("m/s", "ms-1"), 1.0),
    **dict.fromkeys(("km/h", "kmh", "kph"), 1 / 3.6),
}
_LENGTHS = {
    **dict.fromkeys(("", "m", "metre", "metres", "meter", "meters"), 1.0),
    "km": 1000.0,
    **dict.fromkeys(("ft", "feet", "foot", "'"), 0.3048),
    **dict.fromkeys(("nm", "nmi"), 1852.0),
}
RANGE = ".."
"""Separates the lowest and the highest speed of a range."""
_MONTH = re.compile(r"\d{4}-\d{2}", re.ASCII)


def speed_m_s(text: str) -> float:
    """Read a speed, m/s, which must have a unit."""
    return _read(text, _SPEEDS, "a speed such as 12kn, 6.2m/s or 22km/h")


def speed_or_range(given: str | tuple[float, float]) -> float | tuple[float, float]:
    """Read a vessel's speed, m/s, or the lowest and the highest one to choose from.

    A range is a pair in m/s, or a text: 4kn..9kn or 4..9kn.
    """
    if not isinstance(given, str):
        (low, high), text = given, f"{given[0]!r}m/s{RANGE}{given[1]!r}m/s"
    elif RANGE not in given:
        return _positive(given, speed_m_s)
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


def length_m(text: str) -> float:
    """Read a length, m; without a unit it is in metres."""
    return _read(text, _LENGTHS, "a length such as 90m, 300ft or 0.5nm")


def dimension_m(text: str) -> float:
    """Read a dimension of a vessel, m."""
    return _positive(text, length_m)


def _positive(text: str, reader: Callable[[str], float]) -> float:
    """Read a figure above 0."""
    figure = reader(text)
    if figure <= 0:
        raise ValueError(f"{text} is not above 0; give a larger figure")
    return figure


def read_clearance_m(given: str | float) -> float:
    """Read a distance from no-go areas, true metres."""
    metres = length_m(given) if isinstance(given, str) else given
    if metres < 0:
        raise ValueError(f"{given} is below 0; give metres, 0 or more")
    return metres


def _read(text: str, units: dict[str, float], remedy: str) -> float:
    """Read a number with its unit; return it in m or m/s."""
    matched = _QUANTITY.fullmatch(text)
    factor = units.get((matched[2] or "").lower()) if matched is not None else None
    if matched is None or factor is None:
        raise ValueError(f"{text.strip()!r} is not understood; give {remedy}")
    return float(matched[1].replace(",", ".")) * factor


def zoned_time(given: str | datetime) -> datetime:
    """Read a time with a zone, and return it in UTC."""
    try:
        time = datetime.fromisoformat(given) if isinstance(given, str) else given
    except ValueError:
        raise ValueError(
            f"{given} is not a time; give date, time and zone, such as 2026-11-22T06:00Z"
        ) from None
    if time.tzinfo is None:
        text = time.isoformat() if isinstance(given, datetime) else given
        raise ValueError(f"{text} has no zone; add it: {text}Z for UTC, or {text}+08:00")
    return time.astimezone(UTC)


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
    if text in catalogue.stations():
        return text
    return str(resolved(Path(text), ""))


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
