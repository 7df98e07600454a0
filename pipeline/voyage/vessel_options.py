"""Read speeds and lengths with units, and the vessel of a voyage."""

import math
import re
from dataclasses import dataclass
from typing import Any

from pipeline.errors import Faults, RequestError
from pipeline.machine.paths import expanded, unreadable_reason
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.strict import looks_like_path, near_miss, validated

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
# Exponent of the fuel law of a vessel that is given by figures: the propeller law of displacement
# hulls, because its engine is not known.
_FUEL_EXPONENT = 3.0
_REMEDY = (
    "give --vessel NAME (`renew list`), --vessel FILE, or its figures: --speed 12kn --length 90m "
    "--turning-circle 400m"
)


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
        raise ValueError(
            f"{text.strip()!r} begins at a speed of 0 or less; give two speeds above 0"
        )
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


@dataclass(frozen=True, slots=True)
class VesselFigures:
    """A vessel's speed and dimensions as typed; "" stands for a value that was not given.

    The turning circle is given by its diameter, as in a ship's trial manoeuvres.
    """

    speed: str = ""
    length: str = ""
    turning_circle: str = ""
    draught: str = ""

    def given(self) -> list[str]:
        """Return the names of the given options."""
        return [f"--{name.replace('_', '-')}" for name in self.__slots__ if getattr(self, name)]


def vessel_spec(named: str, figures: VesselFigures) -> VesselSpec:
    """Return the vessel given by a name of the catalogue, a file's path or figures.

    Raises
    ------
    RequestError
        None or several of these are given, or one has faults; the message has a line for each.
    """
    if not named:
        return _from_figures(figures)
    faults = Faults()
    read = _from_file if looks_like_path(named) else _from_catalogue
    vessel = faults.collect(lambda: read(named))
    if given := figures.given():
        faults.lines.append(
            f"--vessel {named} and {', '.join(given)} both describe the vessel; leave one out"
        )
        _figures(figures, faults.lines)
    if vessel is None or faults.lines:
        raise RequestError(faults.lines)
    return vessel


def _from_catalogue(name: str) -> VesselSpec:
    """Return a vessel of the catalogue."""
    known = catalogue.names("vessels")
    if name not in known:
        hint = "write a file as a path: './my-vessel.toml'"
        raise RequestError(
            [f"--vessel {name!r} is not in the catalogue: {near_miss(name, known)}; {hint}"]
        )
    return catalogue.vessel(name)


def _from_file(path: str) -> VesselSpec:
    """Return the vessel in a TOML file with the keys of a [vessel] table."""
    file = expanded(path, "--vessel")
    if reason := unreadable_reason(file):
        raise RequestError(f"--vessel {path} {reason}; `renew show usv-7m` prints one")
    data = catalogue.read_toml(file)
    data.pop("schema_version", None)
    return validated(VesselSpec, data, lambda line: f"--vessel {path}: {line}")


def _from_figures(figures: VesselFigures) -> VesselSpec:
    """Return the vessel given by figures; its turn rate is speed divided by turning radius."""
    faults: list[str] = []
    needed = ("speed", "length", "turning_circle")
    lacking = [f"--{name.replace('_', '-')}" for name in needed if not getattr(figures, name)]
    if lacking:
        which = "no vessel" if not figures.given() else f"the vessel lacks {', '.join(lacking)}"
        faults.append(f"{which}; {_REMEDY}")
    data = _figures(figures, faults)
    if faults:
        raise RequestError(faults)
    circle_m = data.pop("turning_circle_m")
    radius_m = circle_m / 2
    data["turn_rate_deg_s"] = math.degrees(data["speed_m_s"] / radius_m)
    data["fuel_exponent"] = _FUEL_EXPONENT
    data["origin"] = f"Figures of the request; turning circle {circle_m:g} m; propeller law"
    return validated(VesselSpec, data)


def _figures(figures: VesselFigures, faults: list[str]) -> dict[str, Any]:
    """Read the figures that were given, in SI units; add errors to `faults`."""
    given: dict[str, Any] = {}
    readers = (
        ("speed_m_s", "--speed", figures.speed, speed_m_s),
        ("length_m", "--length", figures.length, length_m),
        ("draught_m", "--draught", figures.draught, length_m),
        ("turning_circle_m", "--turning-circle", figures.turning_circle, length_m),
    )
    for key, option, text, reader in readers:
        if not text:
            continue
        try:
            given[key] = reader(text)
        except ValueError as error:
            faults.append(f"{option} {error}")
        else:
            if given[key] <= 0:
                faults.append(f"{option} {text} is not above 0; give a larger figure")
    return given


def read_clearance_m(text: str) -> float | None:
    """Read the clearance, true metres; return None if it was left out."""
    if not text:
        return None
    try:
        metres = length_m(text)
    except ValueError as error:
        raise RequestError(f"--clearance {error}") from None
    if metres < 0:
        raise RequestError(f"--clearance {text} is below 0; give metres, 0 or more")
    return metres
