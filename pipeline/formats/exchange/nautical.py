"""Texts, times and positions of the exchange formats, in a plotter's units."""

import itertools
import re
from datetime import UTC, datetime, timedelta

import numpy as np

from pipeline._types import FloatArray, IntArray
from pipeline.formats.passage.tracks import DECIMALS
from pipeline.formats.passage.waypoints import NAUTICAL_MILE_M, Waypoints
from pipeline.formats.shared.note_words import note_texts
from pipeline.formats.shared.result import RankedRoute, RunResult, route_unknowns
from pipeline.formats.shared.text import capitalised
from pipeline.model import RouteMetrics

KNOTS_PER_M_S = 3600 / NAUTICAL_MILE_M
# Maximum length of a vessel's name, in characters: checkers of RTZ warn above it.
_MAX_VESSEL_NAME = 32


def document_title(result: RunResult, season: str) -> str:
    """Title of a season's file: the scenario's title and the season's."""
    scenario = result.scenario
    return f"{scenario.title or scenario.name}: {result.season_title(season)}"


def vessel_name(result: RunResult) -> str:
    """Title of the scenario's vessel, its name where the title is long; at most 32 characters.

    It is "" for a vessel without a title or a name.
    """
    vessel = result.scenario.vessel
    short = vessel.label if len(vessel.label) <= _MAX_VESSEL_NAME else vessel.name
    return short[:_MAX_VESSEL_NAME]


def route_name(ranked: RankedRoute, result: RunResult) -> str:
    """Name of a route in a plotter's list: "Palawan summer 01 west", sorted by rank.

    The scenario's name, the season, the rank, and how the route passes the main island.
    """
    digits = len(str(len(result.season_routes(ranked.season))))
    words = re.split(r"[-_\s]+", result.scenario.name)
    # Beside the season's own name the word says nothing.
    place = " ".join(word for word in words if word.lower() != "season")
    rank = f"{ranked.rank:0{digits}d}"
    parts = (capitalised(place), ranked.season, rank, ranked.metrics.main_side)
    return " ".join(part for part in parts if part)


def attribution(result: RunResult) -> str:
    """Credits that the sources' licences demand, in one line."""
    return "; ".join(dict.fromkeys(credit.text for credit in result.credits if credit.text))


def limits_text(result: RunResult, metrics: RouteMetrics) -> str:
    """Say what is not known about a route, in one line; may be empty."""
    found = "; ".join(note_texts(route_unknowns(result, metrics)))
    return f"{capitalised(found)}." if found else ""


def waypoint_name(index: int, count: int) -> str:
    """Name of a waypoint among those of its route: Start, WP02 and so on, Goal."""
    if index == 0:
        return "Start"
    return "Goal" if index == count - 1 else f"WP{index + 1:02d}"


def leg_text(points: Waypoints, leg: int) -> str:
    """Describe the leg that leaves waypoint `leg`: "course 239.5°, 7.07 NM, 1.81 kn, 3 h 54 min".

    The speed through water follows if speeds are chosen, then the cross-track limits, rounded down.
    """
    speed = points.speed_m_s[leg] * KNOTS_PER_M_S
    through_water = ""
    if np.ptp(points.ranked.route.speeds) > 0:
        through_water = f" ({points.through_water_m_s[leg] * KNOTS_PER_M_S:.2f} kn through water)"
    length = points.length_m[leg] / NAUTICAL_MILE_M
    port, starboard = int(points.port_m[leg]), int(points.starboard_m[leg])
    return (
        f"course {round(points.course_deg[leg], 1) % 360:05.1f}°, {length:.2f} NM, "
        f"{speed:.2f} kn{through_water}, {duration(points.time_s[leg + 1] - points.time_s[leg])}; "
        f"cross-track limits {port} m to port, {starboard} m to starboard"
    )


def duration(seconds: float) -> str:
    """Format a duration to the minute: 3 h 54 min."""
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes:02d} min"


def time_after(departure: datetime, seconds: float) -> datetime:
    """Time (UTC, whole seconds) at `seconds` after departure.

    Raises
    ------
    ValueError
        A departure without a time zone, which is ambiguous.
    """
    if departure.tzinfo is None:
        raise ValueError(f"departure {departure.isoformat()} has no time zone; add one, such as Z")
    return (departure.astimezone(UTC) + timedelta(seconds=round(seconds))).replace(microsecond=0)


def wrapped_longitude(longitude: float) -> float:
    """Wrap a longitude to -180 to below 180 degrees, rounded as it is written."""
    wrapped = round((float(longitude) + 180) % 360 - 180, DECIMALS)
    return wrapped if wrapped < 180 else -180.0


def split_at_antimeridian(points: FloatArray) -> list[FloatArray]:
    """Cut a line (n, 2) in degrees, continuous across 180, into parts within -180 to 180 degrees.

    Both parts end at the cut, at an interpolated latitude. A line that only touches 180 degrees
    stays whole; one that runs along it is at -180.
    """
    turn = _turns(points[:, 0])
    parts: list[list[FloatArray]] = [[points[0] - _shift(turn[0])]]
    for (one, other), (begin, end) in zip(
        itertools.pairwise(points), itertools.pairwise(turn), strict=True
    ):
        step = int(np.sign(end - begin))
        for band in range(begin, end, step or 1):
            edge = 360.0 * (band + (step > 0)) - 180.0
            share = (edge - one[0]) / (other[0] - one[0])
            crossing = np.array([edge, one[1] + share * (other[1] - one[1])])
            parts[-1].append(crossing - _shift(band))
            parts.append([crossing - _shift(band + step)])
        parts[-1].append(other - _shift(end))
    whole = [part for part in map(np.array, parts) if len(np.unique(part, axis=0)) > 1]
    return whole or [np.array(parts[-1])]


def within_180(points: FloatArray) -> FloatArray:
    """Points (n, 2) with longitudes from -180 to below 180 degrees."""
    return points - np.stack([360.0 * _turns(points[:, 0]), np.zeros(len(points))], axis=-1)


def _turns(longitude: FloatArray) -> IntArray:
    """Whole turns (n,) by which longitudes are beyond -180 to below 180 degrees."""
    return np.floor((longitude + 180) / 360).astype(np.int64)


def _shift(turns: int) -> FloatArray:
    """Shift (2,) in degrees for whole turns of longitude."""
    return np.array([360.0 * turns, 0.0])
