"""Tables of a run: metrics, departures, trade-offs, havens, scenario; legs of a passage plan."""

import csv
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, get_args

import numpy as np

import renew
from pipeline._types import FloatArray, IntArray
from pipeline.findings import choices, route_profile
from pipeline.findings.haven_rows import LAST_TURNS, MOMENTS, HavenRow, haven_rows
from pipeline.findings.names import figure_columns, figures, used
from pipeline.findings.result import RankedRoute, RunCase, RunResult
from pipeline.findings.text import duration as duration_text, fuel as fuel_text, percent, to_minute
from pipeline.formats.passage.safe_corridor import tracks
from pipeline.formats.passage.waypoints import (
    KNOTS_PER_M_S,
    NAUTICAL_MILE_M,
    Waypoints,
    time_after,
    wrapped_longitude,
)
from pipeline.model import Case, Water
from pipeline.scenario.loading import scenario_text
from pipeline.texts import cell, table_beside
from renew.underway.survey import State

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
    """Write rows to a new CSV file (UTF-8, a header, RFC 4180 line ends).

    Optional columns that are empty in all rows are left out.
    """
    written = [{name: _spelled(value) for name, value in row.items()} for row in rows]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, used(columns, written), extrasaction="ignore")
        writer.writeheader()
        writer.writerows(written)


def write_metrics(result: RunResult, path: Path) -> None:
    """Write the evaluation as CSV; departure and arrival are empty where none is given."""
    rows = []
    for ranked in result.routes:
        metrics, case = ranked.metrics, ranked.case
        passage = result.scenario.passage(case.name, round(metrics.duration_s)) or ()
        cells: dict[str, Any] = {"season": case.name, "current": case.current_text}
        cells |= figures(metrics, "csv")
        cells |= dict(zip(_PASSAGE, passage, strict=False))
        ensemble = case.result.ensemble
        if ensemble is not None and ranked.rank == 1:
            cells |= choices.ensemble_figures(ensemble, [one.metrics for one in case.routes])
        rows.append(cells)
    columns = ["season", *figure_columns("csv"), *choices.ENSEMBLE_FIGURES, *_PASSAGE, "current"]
    write_csv(path, columns, rows)


def _spelled(value: object) -> object:
    """Return a cell's content: figures read back exactly, times are UTC; "" if not finite."""
    if isinstance(value, float):
        return repr(float(value)) if math.isfinite(value) else ""
    if isinstance(value, datetime):
        return f"{value.astimezone(UTC):%Y-%m-%dT%H:%M:%SZ}"
    return "" if value is None else cell(value)


def _departure_rows(result: RunResult) -> Iterator[dict[str, Any]]:
    """Yield a row for each departure, with its way if a planned route has the same class."""
    for choice in result.departures:
        routes = result.case(choice.season).measures.routes
        ways = {one.homotopy: one.way for one in routes}
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
                "departure": time_after(choice.first, departure),
                "arrival": time_after(choice.first, departure + duration) if is_route else None,
                "hours": duration / 3600 if is_route else None,
                "fuel": fuel if is_route else None,
                "homotopy": homotopy,
                "way": ways.get(homotopy, ""),
                "is_best": at == best,
                "unproven_min": unproven if at == best else None,
                "reason": reason,
            }


def _trade_off_rows(result: RunResult) -> Iterator[dict[str, Any]]:
    """Yield a row for each arrival, ascending for each case; the chosen one is among them."""
    for found in choices.trade_offs(result):
        at = int(np.searchsorted(found.durations_s, found.duration_s))
        durations = np.insert(found.durations_s, at, found.duration_s).tolist()
        fuels = np.insert(found.fuels, at, found.fuel).tolist()
        for index, (duration, fuel) in enumerate(zip(durations, fuels, strict=True)):
            yield {
                "season": found.case,
                "arrival": found.moment(duration),
                "hours": duration / 3600,
                "fuel": fuel,
                "of_chosen": fuel / found.fuel,
                "is_chosen": index == at,
            }


def write_scenario(result: RunResult, path: Path) -> None:
    """Write the scenario as TOML, with all departures that were to be chosen from."""
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


_LEGS: dict[str, str] = table_beside(__file__, "legs.toml")


def leg_headings(points: Waypoints) -> dict[str, str]:
    """Return the headings of a route's table; the water's is empty without a tide."""
    headings = dict(_LEGS)
    if has_speeds(points):
        headings["speed_kn"] = "Speed, kn: SOG / STW"
    if points.ranked.route.least_water is None:
        headings["water"] = ""
    energy = points.ranked.metrics.energy
    headings["left"] = (
        headings["left"].format(energy.unit) if energy and points.left is not None else ""
    )
    return headings


def has_speeds(points: Waypoints) -> bool:
    """Whether a route is sailed at several speeds through water."""
    return bool(np.ptp(points.ranked.route.speeds) > 0)


def rows(points: Waypoints, departure: datetime | None) -> list[dict[str, str]]:
    """Return the rows of a route's waypoints, each with the leg that leads to it."""
    case = points.ranked.case.case
    begin, end = points.lonlat[:-1], points.lonlat[1:]
    drawn = tracks(begin, end, points.curve, case.projection, _ERROR_M)
    line, ends = drawn.chain
    times = route_profile.cumulative(route_profile.steps_along_legs(line, points.ranked).planner_s)
    currents = _currents(line, ends, times, case)
    water = _least_water(line, ends, times, case)
    to_go = np.append(np.cumsum(points.length_m[:-1][::-1])[::-1], 0.0) / NAUTICAL_MILE_M
    table = []
    for index, (longitude, latitude) in enumerate(points.lonlat):
        row = {
            "name": points.names[index],
            "latitude": position(float(latitude), "NS", 2),
            "longitude": position(float(longitude), "EW", 3),
            "to_go_nm": f"{to_go[index]:.1f}",
            "passed": _moment_cell(float(points.time_s[index]), departure),
            "left": "" if points.left is None else f"{math.floor(points.left[index]):,}",
        }
        if index:
            row |= _leg(points, index - 1)
            row |= _nearest_land(drawn.xy[drawn.leg == index - 1], case.water)
            row |= {"current": currents[index - 1], "water": water[index - 1]}
        table.append(row)
    return table


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
    """Return the least water under the keel on each leg when it is sailed, m, rounded down.

    It is empty where there is enough water at any state of the tide.
    """
    if case.tidal_depth is None:
        return [""] * (len(ends) - 1)
    water = case.tidal_depth.spare_along(line, times) + case.under_keel_clearance_m
    least = np.minimum.reduceat(water, ends[:-1]).tolist()
    return [f"{math.floor(10 * one) / 10:.1f}" if math.isfinite(one) else "" for one in least]


def _currents(line: FloatArray, ends: IntArray, times: FloatArray, case: Case) -> list[str]:
    """Return the mean current on each leg when it is sailed: direction of set, and knots."""
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
    closest = route_profile.closest_approach(
        route_profile.coast_edges(water.land), line, water.projection
    )
    if closest is None:
        return {"clearance": "no land"}
    longitude, latitude = water.projection.to_lonlat(closest[0])
    where = f"{position(float(latitude), 'NS', 2)}  {position(float(longitude), 'EW', 3)}"
    return {"clearance": distance_text(closest[1]), "nearest_land": where}


def tightest_place(ranked: RankedRoute) -> renew.Tightest | None:
    """Return the place where turns have the least room; None without padding."""
    case, seed = ranked.case.case, ranked.case.scenario.planner.seed
    return renew.tightest(ranked.route, case.current, case.vessel, seed=seed)


def tightest_text(case: Case, tightest: renew.Tightest) -> str:
    """Say how wide the padding is at a case's tightest place."""
    where = case.water.place_text(tightest.point)
    if not case.water.is_planar:
        longitude, latitude = case.projection.to_lonlat(tightest.point).tolist()
        where = f"{position(latitude, 'NS', 2)} {position(longitude, 'EW', 3)}"
    widths = (tightest.padding, tightest.turns, tightest.gap)
    padding, turns, gap = (f"{math.floor(one * case.projection.scale):,} m" for one in widths)
    return (
        f"Padding at the tightest place, {where}: {padding}, of which turns need {turns}, and the "
        f"planned path keeps {gap} from the hard no-go zone there."
    )


STATES: tuple[State, ...] = get_args(State)
HAVEN_COLUMNS = (
    *("season", "kind", "begin", "end", "begin_s", "end_s", "haven", "way", "turn_off"),
    *("turn_off_s", "lon", "lat", "haven_lon", "haven_lat", "bearing_deg", "length_m", "hours"),
    *("fuel", "longest_hours", "least_hours", "reason"),
)
"""Times are UTC, empty without a departure; `_s` are seconds since departure. `way` numbers a
case's ways; lengths are true metres, fuel is in the planner's units."""


def _haven_cells(result: RunResult) -> Iterator[dict[str, Any]]:
    """Yield the coverage of each case: its stretches first, then the last places to turn."""
    for case in result.cases:
        departure = case.spec.departure
        for row in haven_rows(case):
            cells: dict[str, Any] = {
                "season": case.name,
                "kind": row.kind,
                "begin": departure and time_after(departure, row.begin_s),
                "end": departure and time_after(departure, row.end_s),
                "begin_s": row.begin_s,
                "end_s": row.end_s,
                "longest_hours": row.longest_s / 3600,
                "least_hours": row.least_s / 3600,
                "reason": row.reason,
            }
            if (way := row.way) is not None:
                cells |= {
                    "haven": way.haven,
                    "way": way.number,
                    "turn_off": departure and time_after(departure, way.turn_off_s),
                    "turn_off_s": way.turn_off_s,
                    **_place("", way.place.tolist()),
                    **_place("haven_", way.haven_place.tolist()),
                    "bearing_deg": round(way.bearing_deg, 3),
                    "length_m": way.length_m,
                    "hours": way.duration_s / 3600,
                    "fuel": way.fuel,
                }
            yield cells


_TABLES: dict[str, tuple[Sequence[str], Callable[[RunResult], Iterator[dict[str, Any]]]]] = {
    "departures.csv": (DEPARTURE_COLUMNS, _departure_rows),
    "ensemble.csv": (choices.ENSEMBLE_COLUMNS, choices.ensemble_rows),
    "havens.csv": (HAVEN_COLUMNS, _haven_cells),
    "trade-off.csv": (TRADE_OFF_COLUMNS, _trade_off_rows),
}


def write_table(result: RunResult, path: Path) -> None:
    """Write the table of all cases that the file's name stands for, as CSV."""
    columns, rows = _TABLES[path.name]
    write_csv(path, columns, rows(result))


def _moment_cell(seconds: float, departure: datetime | None) -> str:
    """Write a time as UTC, to the minute, or since departure if none is given."""
    if departure is None:
        return f"+ {duration_text(seconds)}"
    return f"{to_minute(time_after(departure, seconds)):%Y-%m-%d %H:%M}"


def haven_texts(row: HavenRow, case: RunCase) -> dict[str, str]:
    """Return a row as text, by column; the last place to turn off has no begin.

    Fuel is left out if the vessel's power is not known: it is in proportion to time.
    """
    departure, best = case.spec.departure, case.routes[0].metrics
    cells = {
        "kind": row.kind,
        "begin": "" if row.kind in LAST_TURNS else _moment_cell(row.begin_s, departure),
        "end": "" if row.kind in MOMENTS else _moment_cell(row.end_s, departure),
    }
    if (way := row.way) is not None:
        lon, lat = way.place.tolist()
        cells |= {
            "haven": way.haven,
            "turn_off": _moment_cell(way.turn_off_s, departure),
            "latitude": position(lat, "NS", 2),
            "longitude": position(lon, "EW", 3),
            "bearing": f"{round(way.bearing_deg) % 360:03d}",
            "length": f"{way.length_m / NAUTICAL_MILE_M:.1f}",
            "takes": duration_text(way.duration_s),
            "longest": duration_text(row.longest_s),
            "fuel": fuel_text(way.fuel, best) if best.energy else "",
        }
    return cells


def haven_facts(case: RunCase) -> list[str]:
    """Return sentences that explain the table of havens: limits, shares, how to use it."""
    coverage, limits = case.coverage, case.scenario.havens
    if coverage is None:
        return []
    shares = ", ".join(f"{percent(coverage.share(state))} {state}" for state in STATES)
    left_out = ", ".join(haven.name for haven, _ in coverage.left_out)
    return [
        f"Ways to havens {limits.text if limits else ''}, by time under way: {shares}.",
        (
            "Covered: early, on time or late, carry on to the place named, turn off there, and be "
            "at the haven in time. Uncovered: by a bound, nobody on time gets to a haven of the "
            "list in time. Not settled: neither is shown."
        ),
        (
            "Last change: up to there the vessel can change to the other route, for a voyage that "
            "needs at most 2 % more fuel than that route from the start."
            if coverage.class_turns
            else ""
        ),
        f"No way was found to {left_out}." if left_out else "",
    ]


def _place(prefix: str, place: list[float]) -> dict[str, float]:
    """Return the columns of a place (lon, lat), degrees."""
    return {f"{prefix}lon": wrapped_longitude(place[0]), f"{prefix}lat": round(place[1], 8)}
