"""Tables of a run: metrics, departures, trade-offs, scenario; and the legs of a passage plan."""

import csv
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import renew
from pipeline._types import FloatArray, IntArray
from pipeline.findings.choices import TradeOff, trade_offs
from pipeline.findings.ensembles import (
    ENSEMBLE_COLUMNS,
    ENSEMBLE_FIGURES,
    ensemble_figures,
    ensemble_rows,
)
from pipeline.findings.result import RunCase, RunResult
from pipeline.findings.route_profile import coast_index, cumulative, steps_along_legs
from pipeline.findings.text import duration as duration_text, to_minute
from pipeline.formats.passage.tracks import tracks
from pipeline.formats.passage.waypoints import (
    KNOTS_PER_M_S,
    NAUTICAL_MILE_M,
    Waypoints,
    time_after,
    wrapped_longitude,
)
from pipeline.model import Case, DepartureChoice, RouteMetrics, Water
from pipeline.scenario.loading import scenario_text
from pipeline.texts import cell

# Fields of RouteMetrics in their order, and their columns. Fuel and length_planner_m are in the
# planner's scaled units, every other `_m` in true metres.
_FIELDS = (
    *("rank", "way", "homotopy", "fuel", "fuel_per_distance", "length", "length_m"),
    *("clearance_m", "duration_s", "speed_m_s", "optimality_gap"),
    *("trials", "collisions"),
    *("land_m", "land_lon", "land_lat", "filled_share", "uncharted_share"),
    *("least_water_m", "least_water_at", "least_water_early_m", "least_water_late_m"),
    *("members_share", "members_mean_fuel", "members_p90_fuel", "members_cvar90_fuel"),
    "members_regret",
)
_RENAMED = {"length": "length_planner_m", "speed_m_s": "speed_through_water_m_s"}
METRICS_COLUMNS = {_RENAMED.get(field, field): field for field in _FIELDS}
"""Column in the file -> field of RouteMetrics."""

_PASSAGE = ("departure", "arrival")

DEPARTURE_COLUMNS = (
    *("season", "departure", "arrival", "hours", "fuel", "homotopy", "way", "is_best"),
    *("unproven_min", "reason"),
)
"""Times are UTC, fuel is in the planner's units. `unproven_min`, in the best departure's row, is
how many minutes another departure in the window may still save, apart from the error of the paths;
empty where that is not known. `reason` says why there is no route."""

TRADE_OFF_COLUMNS = ("season", "arrival", "hours", "fuel", "of_chosen", "is_chosen")
"""Arrivals are UTC, `hours` are the hours under way, fuel is in the planner's units; `of_chosen` is
the fuel as a share of the chosen route's."""

_HEAD = """\
# The scenario as requested, with the region and offing that were chosen: `renew run` with this file
# gives the same routes.
"""


def write_csv(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """Write rows to a new CSV file (UTF-8, a header, RFC 4180 line ends)."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows({key: cell(one) for key, one in row.items()} for row in rows)


def utc_text(moment: datetime) -> str:
    """Write a time as ISO 8601, UTC, to the second."""
    return f"{moment.astimezone(UTC):%Y-%m-%dT%H:%M:%SZ}"


def write_metrics(result: RunResult, path: Path) -> None:
    """Write the evaluation as CSV; departure and arrival are empty where none is given."""
    rows = []
    for ranked in result.routes:
        metrics, case = ranked.metrics, ranked.case
        passage = result.scenario.passage(case.name, round(metrics.duration_s)) or ()
        cells: dict[str, Any] = {"season": case.name, "current": case.current_text}
        cells |= {column: _cell(metrics, field) for column, field in METRICS_COLUMNS.items()}
        cells |= dict(zip(_PASSAGE, map(utc_text, passage), strict=False))
        found = case.result.ensemble
        if found is not None and ranked.rank == 1:
            cells |= ensemble_figures(found, [one.metrics for one in case.routes])
        rows.append(cells)
    columns = ["season", *METRICS_COLUMNS, *ENSEMBLE_FIGURES, *_PASSAGE, "current"]
    write_csv(path, columns, rows)


def _cell(metrics: RouteMetrics, field: str) -> str:
    """Format a figure so that it reads back exactly; empty if it is not finite."""
    value = getattr(metrics, field)
    if isinstance(value, float):
        return repr(float(value)) if math.isfinite(value) else ""
    if isinstance(value, datetime):
        return utc_text(value)
    return "" if value is None else str(value)


def write_departures_csv(result: RunResult, path: Path) -> None:
    """Write all departures of all cases as CSV."""
    rows = (
        row
        for choice in result.departures
        for row in _departure_rows(choice, result.case(choice.season))
    )
    write_csv(path, DEPARTURE_COLUMNS, rows)


def _departure_rows(choice: DepartureChoice, case: RunCase) -> Iterator[dict[str, Any]]:
    """Yield a row for each departure, with its way if a planned route has the same class."""
    ways = {one.homotopy: one.way for one in case.measures.routes}
    unproven = choice.unproven_s / 60 if math.isfinite(choice.unproven_s) else None
    best = int(abs(choice.departures_s - choice.chosen_s).argmin())
    planned = zip(
        choice.departures_s.tolist(),
        choice.durations_s.tolist(),
        choice.fuels.tolist(),
        choice.homotopies,
        choice.reasons,
        strict=True,
    )
    for at, (departure, duration, fuel, homotopy, reason) in enumerate(planned):
        is_route = math.isfinite(duration)
        yield {
            "season": choice.season,
            "departure": _moment(choice, departure),
            "arrival": _moment(choice, departure + duration) if is_route else None,
            "hours": duration / 3600 if is_route else None,
            "fuel": fuel if is_route else None,
            "homotopy": homotopy,
            "way": ways.get(homotopy, ""),
            "is_best": at == best,
            "unproven_min": unproven if at == best else None,
            "reason": reason,
        }


def _moment(choice: DepartureChoice, seconds: float) -> str:
    """Write a time of the choice's clock."""
    return utc_text(choice.first + timedelta(seconds=round(seconds)))


def write_trade_off_csv(result: RunResult, path: Path) -> None:
    """Write the trade-offs of all cases as CSV."""
    rows = (
        {"season": found.case, **row}
        for found in trade_offs(result)
        for row in _trade_off_rows(found)
    )
    write_csv(path, TRADE_OFF_COLUMNS, rows)


def _trade_off_rows(found: TradeOff) -> Iterator[dict[str, Any]]:
    """Yield a row for each arrival, ascending; the chosen one is among them."""
    at = int(np.searchsorted(found.durations_s, found.duration_s))
    durations = np.insert(found.durations_s, at, found.duration_s)
    fuels = np.insert(found.fuels, at, found.fuel)
    for index, (duration, fuel) in enumerate(zip(durations.tolist(), fuels.tolist(), strict=True)):
        yield {
            "arrival": utc_text(found.moment(duration)),
            "hours": duration / 3600,
            "fuel": fuel,
            "of_chosen": fuel / found.fuel,
            "is_chosen": index == at,
        }


def write_ensemble_csv(result: RunResult, path: Path) -> None:
    """Write the fuel of each route in each member, of all cases with members, as CSV."""
    write_csv(path, ENSEMBLE_COLUMNS, ensemble_rows(result))


def write_scenario(result: RunResult, path: Path) -> None:
    """Write the scenario as TOML, with the departures among which one was chosen."""
    open_ones = {choice.season: choice.asked for choice in result.departures}
    seasons = tuple(
        open_ones.get(one.name) or one
        for one in result.scenario.seasons
        if not (one.name in result.planned and result.planned[one.name].follows)
    )
    asked = result.scenario.model_copy(update={"seasons": seasons})
    path.write_text(_HEAD + scenario_text(asked), encoding="utf-8")


# Maximum distance, true metres, between a leg and the line on which it is measured.
_ERROR_M = 5.0
# Current below which no direction is given, knots.
_NO_CURRENT_KN = 0.05


class Row(NamedTuple):
    """A waypoint's cells as text, with the figures of the leg that leads to it, if there is one."""

    name: str
    latitude: str
    longitude: str
    course: str = ""
    leg_nm: str = ""
    to_go_nm: str = ""
    speed_kn: str = ""
    passed: str = ""
    limits_m: str = ""
    current: str = ""
    clearance: str = ""
    water: str = ""
    nearest_land: str = ""


_HEADINGS = Row(
    *("Waypoint", "Latitude", "Longitude", "Course\n° true", "Leg\nNM", "To go\nNM"),
    *("Speed over\nground, kn", "Passed", "Limits, m\nport / stbd"),
    *("Current on leg\nto ° true, kn", "Least\nclearance", "", "from where on the leg"),
)


def headings(points: Waypoints) -> Row:
    """Return the headings of a route's table, as its speeds and the tide ask for."""
    found = _HEADINGS
    if has_speeds(points):
        found = found._replace(speed_kn="Speed, kn\nSOG / STW")
    if points.ranked.route.least_water is not None:
        found = found._replace(water="Water under\nkeel, m")
    return found


def has_speeds(points: Waypoints) -> bool:
    """Whether a route is sailed at several speeds through water."""
    return bool(np.ptp(points.ranked.route.speeds) > 0)


def rows(points: Waypoints, departure: datetime | None) -> list[Row]:
    """Return rows of a route's waypoints, from start to goal."""
    case = points.ranked.case.case
    begin, end = points.lonlat[:-1], points.lonlat[1:]
    drawn = tracks(begin, end, points.curve, case.projection, _ERROR_M)
    line, ends = drawn.chain
    times = cumulative(steps_along_legs(line, points.ranked).planner_s)
    currents = _currents(line, ends, times, case)
    water = _least_water(line, ends, times, case)
    to_go = np.append(np.cumsum(points.length_m[:-1][::-1])[::-1], 0.0) / NAUTICAL_MILE_M
    found = []
    for index, (longitude, latitude) in enumerate(points.lonlat):
        seconds = float(points.time_s[index])
        passed = f"+ {duration_text(seconds)}"
        if departure is not None:
            passed = f"{to_minute(time_after(departure, seconds)):%Y-%m-%d %H:%M}"
        row = Row(
            name=points.names[index],
            latitude=position(float(latitude), "NS", 2),
            longitude=position(float(longitude), "EW", 3),
            to_go_nm=f"{to_go[index]:.1f}",
            passed=passed,
        )
        if index:
            nearest = _nearest_land(drawn.xy[drawn.leg == index - 1], case.water)
            row = row._replace(**_leg(points, index - 1), **nearest)
            row = row._replace(current=currents[index - 1], water=water[index - 1])
        found.append(row)
    return found


def _leg(points: Waypoints, leg: int) -> dict[str, str]:
    """Return course, length, speed and limits of a leg."""
    speed_kn = f"{points.speed_m_s[leg] * KNOTS_PER_M_S:.2f}"
    if has_speeds(points):
        speed_kn += f" / {points.through_water_m_s[leg] * KNOTS_PER_M_S:.2f}"
    return {
        "course": f"{round(float(points.course_deg[leg]), 1) % 360:05.1f}",
        "leg_nm": f"{points.length_m[leg] / NAUTICAL_MILE_M:.2f}",
        "speed_kn": speed_kn,
        "limits_m": f"{int(points.port_m[leg])} / {int(points.starboard_m[leg])}",
    }


def position(degrees: float, sides: str, digits: int) -> str:
    """Write a coordinate in degrees and minutes: 12° 39.510' N; a longitude within 180 degrees."""
    degrees = wrapped_longitude(degrees) if sides == "EW" else degrees
    minutes = round(abs(degrees) * 60, 3)
    whole, rest = divmod(minutes, 60)
    return f"{int(whole):0{digits}d}° {rest:06.3f}' {sides[degrees < 0]}"


def distance_text(metres: float) -> str:
    """Write a distance, rounded down so that it is never overstated: "1.24 NM", "820 m"."""
    if not math.isfinite(metres):
        return "no land"
    if metres >= NAUTICAL_MILE_M:
        return f"{math.floor(100 * metres / NAUTICAL_MILE_M) / 100:.2f} NM"
    return f"{math.floor(metres)} m"


def _least_water(line: FloatArray, ends: IntArray, times: FloatArray, case: Case) -> list[str]:
    """Return the least water under the keel on each leg when passed, m, rounded down.

    It is empty where no depth counts with the tide: there is enough water at any time.
    """
    if case.tidal_depth is None:
        return [""] * (len(ends) - 1)
    water = case.tidal_depth.spare_along(line, times) + case.under_keel_clearance_m
    least = np.minimum.reduceat(water, ends[:-1]).tolist()
    return [f"{math.floor(10 * one) / 10:.1f}" if math.isfinite(one) else "" for one in least]


def _currents(line: FloatArray, ends: IntArray, times: FloatArray, case: Case) -> list[str]:
    """Return the mean current on each leg when passed: direction of set, and speed in knots."""
    lonlat = case.projection.to_lonlat(line)
    velocity = case.projection.rotate_to_lonlat(lonlat, case.current.velocity(line, times))
    texts = []
    for first, last in itertools.pairwise(ends.tolist()):
        lengths = np.linalg.norm(np.diff(line[first : last + 1], axis=0), axis=1)
        middles = (velocity[first:last] + velocity[first + 1 : last + 1]) / 2
        east, north = np.average(middles, axis=0, weights=lengths)
        knots = float(np.hypot(east, north)) * KNOTS_PER_M_S
        to = round(math.degrees(math.atan2(east, north))) % 360
        texts.append(f"{to:03d}  {knots:.2f}" if knots >= _NO_CURRENT_KN else f"–  {knots:.2f}")
    return texts


def _nearest_land(line: FloatArray, water: Water) -> dict[str, str]:
    """Return the least clearance of a leg from the original land, and the point where it is."""
    closest = coast_index(water.land).closest_approach(line, water.projection)
    if closest is None:
        return {"clearance": "no land"}
    longitude, latitude = water.projection.to_lonlat(closest.point)
    where = f"{position(float(latitude), 'NS', 2)}  {position(float(longitude), 'EW', 3)}"
    return {"clearance": distance_text(closest.clearance_m), "nearest_land": where}


def tightest_text(points: Waypoints) -> str:
    """Say the padding where the route is nearest to a padded edge; empty without padding."""
    case = points.ranked.case.case
    found = renew.tightest(points.ranked.route, case.current, case.vessel)
    if found is None:
        return ""
    longitude, latitude = case.projection.to_lonlat(found.point)
    widths = (found.padding, found.turns, found.gap)
    padding, turns, gap = (f"{math.floor(one * case.projection.scale):,} m" for one in widths)
    return (
        f"Padding at the tightest place, {position(float(latitude), 'NS', 2)} "
        f"{position(float(longitude), 'EW', 3)}: {padding}, of which turns need {turns}, and the "
        f"planned path keeps {gap} from the hard no-go zone there."
    )
