"""Read positions as people write and paste them.

In decimals, minutes or seconds, with N, S, E or W before or after, or with the words for them; as
notices to mariners, plotters, GNSS receivers, standards (ISO 6709, RFC 5870, RFC 7946, WKT) and
the addresses of maps write them. What can be read in two ways is asked about, not guessed.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from urllib.parse import unquote

from pipeline.errors import RequestError

EXAMPLES = "'120.30,12.80' (longitude first), '12.80N 120.30E' or '12°48'N 120°18'E'"
_NUMBER = r"[+-]?\d+(?:\.\d*)?|[+-]?\.\d+"
_TOKENS = re.compile(
    rf"(?P<number>{_NUMBER})|(?P<letter>[NSEWXY])|(?P<comma>[,;])|(?P<unit>[°'\"])"
)
# Other characters for minus, for the signs of degrees, minutes and seconds, and between figures.
_SPELLINGS = str.maketrans(
    dict.fromkeys("−–—", "-")
    | dict.fromkeys("º˚", "°")
    | dict.fromkeys("′’`\N{LEFT SINGLE QUOTATION MARK}\N{MODIFIER LETTER PRIME}", "'")
    | dict.fromkeys("″”“ʺ", '"')
    | dict.fromkeys("/|&", " , ")
    | dict.fromkeys("()[]{}", " ")
)
_LAT = rf"(?P<lat>{_NUMBER})"
_LON = rf"(?P<lon>{_NUMBER})"
# Notations whose standard says which figure is the latitude, in capitals. In the address of a map
# a marked place comes before the middle of what is shown, which panels beside a place push away.
_STANDARDS = tuple(
    re.compile(pattern)
    for pattern in (
        rf"(?:SRID=4326;)?POINT *(?:ZM?|M)? *\( *{_LON} +{_LAT}(?: +[\d.+-]+)* *\)",
        rf'.*"COORDINATES"\s*:\s*\[\s*{_LON}\s*,\s*{_LAT}\s*[],].*',
        rf"GEO:{_LAT},{_LON}(?:[,;?].*)?",
        rf"HTTPS?://.*!3D{_LAT}!4D{_LON}.*",
        rf"HTTPS?://.*[?&]MLAT={_LAT}&MLON={_LON}.*",
        rf"HTTPS?://.*[?&](?:Q|QUERY|LL|DESTINATION)={_LAT},\s*{_LON}.*",
        rf"HTTPS?://.*#MAP=[\d.]+/{_LAT}/{_LON}.*",
        rf"HTTPS?://(?!.*/PLACE/).*/@{_LAT},{_LON},.*",
    )
)
# ISO 6709: two digits of degrees of latitude, three of longitude, each after its sign.
_ISO_6709 = re.compile(
    r"([+-])(\d\d(?:\d\d){0,2}(?:\.\d+)?)([+-])(\d{3}(?:\d\d){0,2}(?:\.\d+)?)(?:[+-][\d.]+)?(?:CRS.*)?/?"
)


def _word(*words: str) -> str:
    """Return the pattern of a word that no letter precedes or follows."""
    return rf"(?<![^\W\d_])(?:{'|'.join(words)})(?![^\W\d_])\.?"


# What is written in other ways, in capitals, in the order in which it is replaced. X and Y stand
# for the words longitude and latitude, after which a figure may have a sign.
_OTHER_WAYS = tuple(
    (re.compile(pattern), by)
    for pattern, by in (
        (rf"[\"']?{_word('LAT', 'LATITUDE')}[\"']?\s*[:=]?", " Y "),
        (rf"[\"']?{_word('LON', 'LONG', 'LNG', 'LONGITUDE')}[\"']?\s*[:=]?", " X "),
        (_word("NORTH", "NORD", "NORTE"), "N"),
        (_word("SOUTH", "SÜD", "SUD", "SUR", "SUL"), "S"),
        (_word("EAST", "EST", "ESTE", "LESTE", "OST"), "E"),
        (_word("WEST", "OUEST", "OESTE", "OVEST"), "W"),
        (_word("DEG", "DEGREES?", "D"), "°"),
        (_word("MIN", "MINUTES?", "M"), "'"),
        (_word("SEC", "SECONDS?"), '"'),
        (r"(?<=')(\s*[\d.]+)\s*S(?=\s*[NSEW])", r'\1"'),  # 12d48m00sN
        (r"'\s*[·.](\d+)", r".\1'"),  # 50°43'·25N in notices to mariners
        (r"(?<=\d):(?=\d)", " "),  # 54:19:12N
        (r"(?<=[NSEW])\.(?!\d)", ""),
        (r"^([^NSEW]*[\d°'\"]\s*[NSEW])(?:\s+-\s+|\+)(?=\d)", r"\1 "),
    )
)
# Figures without a gap: DDMM.m and DDMMSS.s of latitude, DDDMM.m and DDDMMSS.s of longitude.
_PACKED = r"({degrees})([0-5]\d)([0-5]\d)?(\.\d*)?(?![\d.])"
_LETTERS_BEFORE = r"(?<=[{letters}])\s*{0}"
_LETTERS_AFTER = r"(?<![\d.]){0}(?=\s*,?\s*[{letters}])"
# A comma before the letter, as NMEA 0183 has it: 4807.038,N.
_COMMA_BEFORE = re.compile(r"(?<=\d),(?=[NSEW])")
# A hyphen between two numbers, as in "6-08S": on nautical charts it separates degrees and minutes.
_HYPHEN = re.compile(r"(?<=\d)-(?=\d)")
_LETTERS = re.compile(r"[NSEW]")
# A comma between two digits is a decimal comma where letters part the figures.
_COMMA = re.compile(r"(?<=\d),(?=\d)")
# Without letters, two commas between digits, with other characters between, are decimal commas, as
# in "120,30 12,80".
_DECIMAL_COMMAS = re.compile(r"^([^,]*\d),(\d[^,]*(?:;|\s)[^,]*\d),(\d[^,]*)$")
# If start or goal lies west of this longitude, and neither east of Greenwich, 360 degrees are added
# to both: longitudes in a scenario begin at -180, and the region needs room west of them.
_WESTERNMOST = -160.0
_AXIS = {"N": "lat", "S": "lat", "E": "lon", "W": "lon", "X": "lon", "Y": "lat"}


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

    Raises RequestError if the number of arguments is odd or 0.
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
    west, east = sorted((start.lon, goal.lon))
    turn = 360 * (west < _WESTERNMOST and east <= 0) - 360 * (east > 360)
    return replace(start, lon=start.lon + turn), replace(goal, lon=goal.lon + turn)


def read_position(given: str | tuple[float, float]) -> Position:
    """Read one position: a text, or two numbers, degrees.

    Without letters of hemispheres, longitude comes first unless only the other order is possible.
    Raises ValueError if it can't be read; the message has the text, the reason and the remedy.
    """
    text = given.strip() if isinstance(given, str) else f"{given[0]!r},{given[1]!r}"
    try:
        if not isinstance(given, str):
            return _ordered((float(given[0]), ""), (float(given[1]), ""), text)
        typed = unquote(text).upper()
        for standard in _STANDARDS:
            if found := standard.fullmatch(typed):
                return _ordered((float(found["lon"]), "X"), (float(found["lat"]), "Y"), text)
        return _ordered(*_coordinates(_plain(typed)), text)
    except ValueError as error:
        raise ValueError(f"{text!r} {error}") from None


def _plain(typed: str) -> str:
    """Return a text in capitals with the signs, letters and gaps that `_coordinates` knows."""
    if found := _ISO_6709.fullmatch(typed):
        north, lat, east, lon = found.groups()
        typed = f"{lat}{'SN'[north == '+']} {lon}{'WE'[east == '+']}"
    plain = typed.translate(_SPELLINGS).replace("''", '"').strip()
    for pattern, by in _OTHER_WAYS:
        plain = pattern.sub(by, plain)
    if re.search(_word("O"), plain):
        raise ValueError(
            "has the letter O: it is east (Ost) in German, and west in French, Spanish, Italian "
            "and Portuguese; write E or W"
        )
    if _LETTERS.search(plain):
        if re.search(r"\d\s*/\s*\d", typed):
            raise ValueError("has a fraction; give decimals, such as 12.5N")
        plain = _COMMA_BEFORE.sub("", re.sub("[XY]", "", plain)).strip()
        plain = _COMMA.sub(".", _HYPHEN.sub(" ", plain))
        form = _LETTERS_BEFORE if plain[0] in _AXIS else _LETTERS_AFTER
        for degrees, letters in ((r"\d\d", "NS"), (r"\d{3}", "EW")):
            packed = form.format(_PACKED.format(degrees=degrees), letters=letters)
            plain = re.sub(
                packed,
                lambda one: " ".join(filter(None, one.group(1, 2, 3))) + (one[4] or ""),
                plain,
            )
    return _DECIMAL_COMMAS.sub(r"\1.\2.\3", plain)


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
    units = [
        (sum(before.lastgroup == "number" for before in tokens[:at]), token[0])
        for at, token in enumerate(tokens)
        if token.lastgroup == "unit"
    ]
    letter = "".join(token[0] for token in tokens if token.lastgroup == "letter")
    if not 1 <= len(numbers) <= 3:
        raise ValueError(f"is not a pair of coordinates; write it like {EXAMPLES}")
    if not set(units) <= {(1, "°"), (2, "'"), (3, '"')} or len(units) > len(numbers):
        raise ValueError("has its signs of degrees, minutes and seconds (° ' \") in another order")
    if letter in {"N", "S", "E", "W"} and numbers[0][0] in "+-":
        raise ValueError(f"has both a sign and {letter}; leave one of them out")
    if any(number[0] in "+-" for number in numbers[1:]):
        raise ValueError("has a sign before minutes or seconds; give it before the degrees")
    if any("." in number for number in numbers[:-1]):
        raise ValueError("has a fraction before the last of degrees, minutes and seconds; drop one")
    if letter and "letter" not in {tokens[0].lastgroup, tokens[-1].lastgroup}:
        raise ValueError(f"has {letter} among its figures; give it before or after them")
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
