"""Read speeds and lengths with their units, as people write them: 12kn, 90m, 300 ft."""

import re

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


def speed_m_s(text: str) -> float:
    """Read a speed, m/s, which must have a unit; raise ValueError with the remedy."""
    return _read(text, _SPEEDS, "a speed such as 12kn, 6.2m/s or 22km/h")


RANGE = ".."
"""Separates the lowest and the highest speed of a range."""


def speed_range_m_s(text: str) -> tuple[float, float]:
    """Read a range of speeds, m/s: 4kn..9kn or 4..9kn; raise ValueError with the remedy."""
    least, _, most = text.partition(RANGE)
    unit = found[2] if (found := _QUANTITY.fullmatch(most)) else None
    if unit and (bare := _QUANTITY.fullmatch(least)) and not bare[2]:
        least += unit
    low, high = speed_m_s(least), speed_m_s(most)
    if low <= 0:
        raise ValueError(f"{text.strip()!r} begins at a speed of 0 or less; give two above 0")
    if low > high:
        raise ValueError(f"{text.strip()!r} begins above its end; exchange the two speeds")
    return low, high


def length_m(text: str) -> float:
    """Read a length, m; without a unit it is in metres; raise ValueError with the remedy."""
    return _read(text, _LENGTHS, "a length such as 90m, 300ft or 0.5nm")


def _read(text: str, units: dict[str, float], remedy: str) -> float:
    """Return a number times the factor of its unit."""
    found = _QUANTITY.fullmatch(text)
    factor = units.get((found[2] or "").lower()) if found is not None else None
    if found is None or factor is None:
        raise ValueError(f"{text.strip()!r} is not understood; give {remedy}")
    return float(found[1].replace(",", ".")) * factor
