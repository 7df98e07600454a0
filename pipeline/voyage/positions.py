"""Read positions as people write them: decimals or minutes, with N, S, E or W before or after."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from pipeline.errors import RequestError

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

    @property
    def key(self) -> list[float] | dict[str, object]:
        """The position as in a scenario's `via`."""
        place = [self.lon, self.lat]
        return {"at": place, "wait": self.wait} if self.wait else place


@dataclass(frozen=True, slots=True)
class _Coordinate:
    """One coordinate, degrees, and the letter of its hemisphere or ""."""

    degrees: float
    letter: str

    @property
    def axis(self) -> str:
        """`lon` or `lat` according to the letter, or "" without one."""
        return _AXIS.get(self.letter, "")


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
        return read_position(given if isinstance(given, str) else f"{given[0]!r},{given[1]!r}")
    except ValueError as error:
        raise ValueError(f"= {error}") from None


def read_stop(given: str | tuple[float, float]) -> Position:
    """Read a point on the way; an anchorage is 'POSITION wait 6h'."""
    text = given if isinstance(given, str) else f"{given[0]!r},{given[1]!r}"
    place, wait = (part.strip() for part in text.partition(" wait ")[::2])
    return replace(read_position(place), wait=wait)


def continued(place: Position, lon: float) -> Position:
    """Return a position with the longitude that is nearest to another, also beyond 180 degrees."""
    return replace(place, lon=place.lon + 360 * round((lon - place.lon) / 360))


def joined(start: Position, goal: Position) -> tuple[Position, Position]:
    """Return start and goal; the goal continues beyond 180 degrees if the way across is shorter."""
    goal = continued(goal, start.lon)
    turn = 360 if min(start.lon, goal.lon) < _WESTERNMOST else 0
    return replace(start, lon=start.lon + turn), replace(goal, lon=goal.lon + turn)


def read_position(text: str) -> Position:
    """Read one position.

    Without letters of hemispheres, longitude comes first unless only the other order is possible.

    Raises
    ------
    ValueError
        The text can't be read; the message has the text, the reason and the remedy.
    """
    shown = text.strip()
    try:
        first, second = _coordinates(_normalised(text))
        return _ordered(first, second, shown)
    except ValueError as error:
        raise ValueError(f"{shown!r} {error}") from None


def _normalised(text: str) -> str:
    """Return a text with standard signs, capital letters and decimal points."""
    plain = text.strip().translate(_SPELLINGS).replace("''", '"').upper()
    if _LETTERS.search(plain):
        plain = _HYPHEN.sub(" ", plain)
    return _DECIMAL_COMMAS.sub(r"\1.\2.\3", plain)


def _ordered(first: _Coordinate, second: _Coordinate, shown: str) -> Position:
    """Return the position, after deciding by hemisphere or size which coordinate is longitude."""
    axes = (first.axis, second.axis)
    if any(axes) and set(axes) != {"lon", "lat"}:
        raise ValueError("needs one of N and S, and one of E and W, or none of them")
    is_swapped = axes[0] == "lat"
    note = ""
    either_order = not any(axes) and max(abs(first.degrees), abs(second.degrees)) <= 90
    if not any(axes) and abs(second.degrees) > 90 >= abs(first.degrees):
        is_swapped = True
        note = (
            f"{shown!r} was read as latitude, longitude: {second.degrees:g} can only be a longitude"
        )
    elif either_order:
        note = (
            f"{shown!r} was read as longitude {first.degrees:g}, latitude {second.degrees:g}; "
            "the other way round it would be water, too: write N or S and E or W to make it clear"
        )
    lon, lat = (second, first) if is_swapped else (first, second)
    if abs(lat.degrees) > 90:
        raise ValueError(f"has the latitude {lat.degrees:g}; give one from -90 to 90 degrees")
    if not -180 <= lon.degrees <= 360:
        raise ValueError(f"has the longitude {lon.degrees:g}; give one from -180 to 360 degrees")
    return Position(lon.degrees, lat.degrees, note, either_order)


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
    return _Coordinate(-size if is_negative else size, letter)


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
