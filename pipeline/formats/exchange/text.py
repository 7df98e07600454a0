"""Texts and times of the exchange formats: harmless whatever they hold, in a plotter's units."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from pipeline.formats.exchange.thinning import DECIMALS
from pipeline.formats.exchange.waypoints import NAUTICAL_MILE_M

if TYPE_CHECKING:
    from pipeline.formats.exchange.waypoints import Waypoints
    from pipeline.formats.shared.result import RunResult

# What XML 1.0 has no way to write; lone halves of a surrogate pair are in no encoding either.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
KNOTS = 3600 / NAUTICAL_MILE_M
"""Knots to a metre per second."""


def xml_text(text: str) -> str:
    """Replace what XML forbids by U+FFFD; markup is left for the writer to escape."""
    return _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)


def whole_text(text: str) -> str:
    """Replace halves of a surrogate pair, which no encoding has, by U+FFFD."""
    return text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")


def heading(result: RunResult, season: str) -> str:
    """What a file calls itself: the scenario's title and the season's."""
    scenario = result.scenario
    return f"{scenario.title or scenario.name}: {result.season_title(season)}"


def vessel_name(result: RunResult) -> str:
    """What the scenario calls its vessel."""
    vessel = result.scenario.vessel
    return vessel.title or vessel.name


def attribution(result: RunResult) -> str:
    """What the licences of the sources ask for, in one line."""
    return "; ".join(dict.fromkeys(credit.text for credit in result.credits if credit.text))


def waypoint_name(index: int, count: int) -> str:
    """Name of a route's waypoint: Start, WP02 and so on, Goal."""
    if index == 0:
        return "Start"
    return "Goal" if index == count - 1 else f"WP{index + 1:02d}"


def leg_words(points: Waypoints, leg: int) -> str:
    """Describe the leg that leaves waypoint `leg`: "course 239.5°, 7.07 NM, 1.81 kn, 3 h 54 min".

    With its cross-track limits; distances round down, for the limits are not to be overstepped.
    """
    speed = points.speed_m_s[leg] * KNOTS
    length = points.length_m[leg] / NAUTICAL_MILE_M
    port, starboard = int(points.port_m[leg]), int(points.starboard_m[leg])
    return (
        f"course {round(points.course_deg[leg], 1) % 360:05.1f}°, {length:.2f} NM, {speed:.2f} kn, "
        f"{duration(points.time_s[leg + 1] - points.time_s[leg])}; "
        f"room {port} m to port, {starboard} m to starboard"
    )


def duration(seconds: float) -> str:
    """Spell a time under way to the minute: 3 h 54 min."""
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes:02d} min"


def moment(departure: datetime, seconds: float) -> datetime:
    """Return the time (UTC, whole seconds) so many seconds after departure.

    Raises
    ------
    ValueError
        A departure without a time zone: it could be any of 24 hours.
    """
    if departure.tzinfo is None:
        raise ValueError(f"departure {departure.isoformat()} has no time zone; add one, such as Z")
    return (departure.astimezone(UTC) + timedelta(seconds=round(seconds))).replace(microsecond=0)


def normal_longitude(longitude: float) -> float:
    """Bring a longitude to -180 to below 180 degrees."""
    turned = round((float(longitude) + 180) % 360 - 180, DECIMALS)
    return turned if turned < 180 else -180.0
