"""Quantities as text, values for JSON, templates, and the system's errors."""

import errno
import json
import math
import shutil
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup, escape

from pipeline.model import Case, ReplanFigures, RouteMetrics, Zone
from pipeline.scenario.season import named_departure
from renew.errors import Duration, Moment, Text, in_seconds

if TYPE_CHECKING:
    from jinja2 import Environment


ABSENT = "–"
USEFUL_GAP = 1.0
"""Optimality gap above which a lower bound on fuel is of no use."""
# Distance, metres, from which kilometres are given with one decimal.
_ONE_DECIMAL_FROM_M = 100_000.0
# Distance, metres, from which kilometres are given, with two decimals.
_KILOMETRES_FROM_M = 1_000.0
_DAY_S = 86_400.0
_HOUR_S = 3_600.0
_MINUTE_S = 60.0
# From this number of Wh, kWh are given.
_KWH_FROM_WH = 10_000.0
# A difference below this part of the last decimal place counts as the value's own rounding error.
_EXACT = 1e-6


def number(value: float | None, digits: int = 4) -> str:
    """Format a number to significant digits without exponent, with thousands separators: 1,235."""
    if value is None or not math.isfinite(value):
        return ABSENT
    # Magnitude of the rounded value: 99.996 becomes 100.0.
    magnitude = int(f"{value:.{digits - 1}e}".partition("e")[2])
    return f"{value:,.{max(0, digits - 1 - magnitude)}f}"


def count(number_of: int, one: str, many: str) -> str:
    """Format a count with its noun: 1 class, 2,107 classes."""
    return f"{number_of:,} {one if number_of == 1 else many}"


def plain(value: float) -> str:
    """Format a number from a configuration without trailing zeros: 2, 0.5, 1,000."""
    return f"{value:,.6g}"


def duration(seconds: float) -> str:
    """Format a duration to the minute: 3 h 54 min."""
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes:02d} min"


def distance(metres: float | None) -> str:
    """Format true metres: 712.1 km, 3.46 km, 820.4 m, 12.6 m."""
    if metres is None or not math.isfinite(metres):
        return ABSENT
    if metres >= _ONE_DECIMAL_FROM_M:
        return f"{metres / 1000:,.1f} km"
    if metres >= _KILOMETRES_FROM_M:
        return f"{metres / 1000:.2f} km"
    return f"{number(metres, 4 if metres >= 100 else 3)} m"


def clearance(metres: float | None) -> str:
    """Format true metres of clearance to three digits, rounded down: 3.46 km, 820 m, 12.6 m."""
    if metres is None or not math.isfinite(metres):
        return ABSENT
    unit = 1000.0 if metres >= _KILOMETRES_FROM_M else 1.0
    return f"{number(_digits_down(metres / unit, 3), 3)} {'km' if unit > 1 else 'm'}"


def rounded_down(value: float, decimals: int) -> float:
    """Round a lower limit down, so that it stays a lower limit."""
    return float(np.floor(value * 10.0**decimals + _EXACT) / 10.0**decimals)


def rounded_up(value: float, decimals: int) -> float:
    """Round an upper limit up, so that it stays an upper limit."""
    # Adding 0 turns -0 into 0.
    return float(np.ceil(value * 10.0**decimals - _EXACT) / 10.0**decimals) + 0.0


def _digits_down(value: float, digits: int) -> float:
    """Round a lower limit down to significant digits, but never further than to whole numbers."""
    magnitude = math.floor(math.log10(value)) if 0 < value < math.inf else 0
    return rounded_down(value, max(0, digits - 1 - magnitude))


def speed_range(slowest: float, fastest: float) -> tuple[str, str]:
    """Format two speeds to two decimals, the lower one rounded up and the higher one down.

    If no number with two decimals lies between them, both texts are the lower speed, unrounded.
    """
    low, high = rounded_up(slowest, 2), rounded_down(fastest, 2)
    return (f"{low:.2f}", f"{high:.2f}") if low < high else (plain(slowest), plain(slowest))


def fuel(value: float, of: RouteMetrics | ReplanFigures, *, least: bool = False) -> str:
    """Format fuel for readers to four digits: 755.0 Wh, 12.31 kWh, 98.21 % of still water.

    The `least` that is needed is rounded down.
    """
    size, unit = fuel_unit(value, of)
    shown = value * size
    if not math.isfinite(shown):
        return ABSENT
    return f"{number(_digits_down(shown, 4) if least else shown)} {unit}"


def fuel_unit(most: float, of: RouteMetrics | ReplanFigures) -> tuple[float, str]:
    """Return what a unit of a route's fuel is in the unit for readers, for up to `most`; its name.

    Without the vessel's power it is a share: the fuel may be any number.
    """
    size, unit = of.fuel_unit
    if unit == "Wh" and most * size >= _KWH_FROM_WH:
        return size / 1000, "kWh"
    return size, unit


def box(bounds: Sequence[float]) -> str:
    """Write west, south, east and north in degrees: 178.5 E to 179.5 W, 17.29 to 15.88 S."""
    west, south, east, north = bounds
    return f"{_span(west, east, 'EW')}, {_span(south, north, 'NS')}"


def _span(least: float, most: float, letters: str) -> str:
    """Write two coordinates, once with the letter of their hemisphere if both lie in it."""
    # On a chart across 180 degrees, longitudes continue beyond 180.
    turned = [one if letters == "NS" else (one + 180) % 360 - 180 for one in (least, most)]
    (first, begin), (second, end) = [(abs(one), letters[one < 0]) for one in turned]
    return f"{first:g}{f' {begin}' if begin != end else ''} to {second:g} {end}"


def hours(seconds: float) -> str:
    """Format a duration in hours, minutes or seconds."""
    if not math.isfinite(seconds):
        return ABSENT
    if seconds >= _HOUR_S:
        return f"{seconds / _HOUR_S:,.1f} h"
    if seconds >= 2 * _MINUTE_S:
        return f"{seconds / _MINUTE_S:.1f} min"
    return f"{seconds:.1f} s"


def at_most_hours(seconds: float) -> str:
    """Format a duration as `hours` does, rounded up: it is the longest that is possible."""
    unit = _HOUR_S if seconds >= _HOUR_S else _MINUTE_S if seconds >= 2 * _MINUTE_S else 1.0
    return hours(rounded_up(seconds / unit, 1) * unit)


def days(seconds: float) -> str:
    """Format a duration in days and hours: 8 d 6 h; empty below two days."""
    if not math.isfinite(seconds) or seconds < 2 * _DAY_S:
        return ""
    whole, rest = divmod(round(seconds / _HOUR_S), 24)
    return f"{whole} d {rest} h"


def percent(share: float, digits: int = 1) -> str:
    """Format a share as a percentage: 2.3 %."""
    return f"{100 * share:.{digits}f} %" if math.isfinite(share) else ABSENT


def part(share: float) -> str:
    """Format a share of a way: 2.3 %, or none, so that nobody looks for a part that is not."""
    return percent(share) if share else "none"


def at_least_percent(share: float) -> str:
    """Format a share as a percentage, rounded down: at least 2.3 %."""
    return percent(rounded_down(100 * share, 1) / 100)


def at_most_percent(share: float) -> str:
    """Format a share as a percentage, rounded up: at most 2.4 %."""
    return percent(rounded_up(100 * share, 1) / 100)


def share(value: float) -> str:
    """Format a share as a percentage of three digits: 96.6 %, 101 %."""
    return f"{number(100 * value, 3)} %" if math.isfinite(value) else ABSENT


def gap_figure(share: float) -> str:
    """Format an optimality gap, rounded up: 4.9 %, or "no useful bound"."""
    return "no useful bound" if share > USEFUL_GAP else at_most_percent(share)


def capitalised(text: str) -> str:
    """Begin a text with a capital, unless its first word is the name of a file."""
    is_file = not {*text.partition(" ")[0].rstrip(".,:;")}.isdisjoint("._/")
    return text if is_file else f"{text[:1].upper()}{text[1:]}"


def speed_over_ground(metrics: RouteMetrics) -> float:
    """Return the mean speed over ground, m/s; NaN without a duration."""
    return metrics.length_m / metrics.duration_s if metrics.duration_s > 0 else math.nan


def route_summary(metrics: RouteMetrics) -> str:
    """Say a route's way, length, duration and clearance: "west of Palawan, 689.5 km, ..."."""
    parts = [metrics.way] if metrics.way else []
    parts += [distance(metrics.length_m), hours(metrics.duration_s)]
    if metrics.has_land:
        parts.append(f"{clearance(metrics.clearance_m)} or more from {metrics.no_go_name}")
    return f"{', '.join(parts)}."


def turns_text(metrics: RouteMetrics) -> str:
    """Say how many of the hard-over turns that were simulated along a route met no-go."""
    if not metrics.trials:
        return "hard-over turns were not counted"
    met = f"{metrics.collisions:,}" if metrics.collisions else "none"
    return f"{met} of {metrics.trials:,} simulated hard-over turns met {metrics.no_go_name}"


def zone_text(zone: Zone) -> str:
    """Return the name of a restricted area, traffic scheme or shut area, and its rule if any."""
    if zone.kind == "shut":
        return f"{zone.name}, {zone.rule}"
    name = zone.name or ("Restricted area" if zone.kind == "restricted" else "Traffic scheme")
    return f"{name}: {zone.rule}" if zone.rule else name


def planner_text(text: Text, case: Case) -> str:
    """Write a message of the planner with positions, dates and true lengths for readers.

    Moments of a case without a departure stay in seconds.
    """
    departure, scale = case.departure, case.projection.scale

    def dated(moment: Moment) -> str:
        if departure is None:
            return in_seconds(moment)
        return exact_moment_text(departure + timedelta(seconds=round(scale * moment.seconds)))

    words = text.spelled(
        case.water.place_text,
        dated,
        lambda one: distance(case.water.true_m(one)),
        lambda one: str(Duration(one.seconds * scale)),
    )
    return " ".join(words.split())


def to_minute(moment: datetime) -> datetime:
    """Round a moment to the nearest minute, UTC."""
    return (moment.astimezone(UTC) + timedelta(seconds=30)).replace(second=0, microsecond=0)


def moment_text(moment: datetime) -> str:
    """Write a moment for readers, to the minute: "2026-11-22 06:00 UTC"."""
    return f"{to_minute(moment):%Y-%m-%d %H:%M} UTC"


def exact_moment_text(moment: datetime) -> str:
    """Write a moment with its seconds, if it has any: for times where being late matters."""
    is_whole = moment == to_minute(moment)
    return moment_text(moment) if is_whole else f"{moment.astimezone(UTC):%Y-%m-%d %H:%M:%S} UTC"


def season_name(case: str) -> str:
    """Name a case for readers: "july", or its departure if it has no name."""
    departure = named_departure(case)
    return case if departure is None else f"departure {moment_text(departure)}"


def seasons_text(cases: Sequence[str]) -> str:
    """Name cases in a message: "season 'july'", "departure 2026-11-22 06:00 UTC"."""
    if any(map(named_departure, cases)):
        return ", ".join(map(season_name, cases))
    return f"season{'s' * (len(cases) > 1)} {', '.join(map(repr, cases))}"


def season_text(case: str) -> str:
    """Name one case in a message."""
    return seasons_text([case])


# Characters in an attribute that a reader of XML would take for other white space.
_WHITE_SPACE = {"\t": "&#9;", "\n": "&#10;", "\r": "&#13;"}

# Free space, bytes, below which a failed write means a full disk; more than SQLite's journal.
_FULL_BELOW_BYTES = 16 * 2**20


def write_json(path: Path, content: object, indent: int | None = 2) -> None:
    """Write a new file of JSON (UTF-8), with `null` for numbers that are not finite."""
    text = json.dumps(json_value(content), indent=indent, ensure_ascii=False, allow_nan=False)
    path.write_text(f"{text}\n", encoding="utf-8")


def json_value(value: Any) -> Any:  # noqa: ANN401 - any value in, one that JSON knows out
    """Convert a value, and everything nested in it, for JSON.

    NumPy's types become Python's, numbers that are not finite become None, and times are written
    by ISO 8601.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: json_value(item) for key, item in value.items()}
    if isinstance(value, list):
        return [json_value(item) for item in value]
    return value


@cache
def environment(
    *packages: str, finalize: Callable[[object], object] | None = None
) -> "Environment":
    """Load the templates of some packages; values are escaped, and a missing one is an error.

    If several packages have a template, the first one's is used.
    """
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=ChoiceLoader([PackageLoader(package) for package in packages]),
        autoescape=True,
        finalize=finalize,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def xml_environment(package: str) -> "Environment":
    """Load a package's templates of XML."""
    return environment(package, finalize=_escaped)


def _escaped(value: object) -> Markup:
    """Escape a value for an attribute or an element, unless it is XML already."""
    if isinstance(value, Markup):
        return value
    text = escape(str(value))
    for character, reference in _WHITE_SPACE.items():
        text = text.replace(character, Markup(reference))  # noqa: S704 - our own
    return text


def os_error(path: Path, error: Exception) -> OSError:
    """Turn an error of GDAL, SQLite or HDF5 into an OSError: ENOSPC if the disk is full, else EIO.

    These libraries hide the system's own error.
    """
    full = shutil.disk_usage(path.parent).free < _FULL_BELOW_BYTES
    return OSError(errno.ENOSPC if full else errno.EIO, f"{path.name}: {error}")
