"""Tables of a run: metrics, departures and trade-offs, and its scenario."""

import csv
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.formats.shared.departures_and_speeds import TradeOff, trade_offs
from pipeline.formats.shared.result import RunResult
from pipeline.formats.shared.writing import write_json
from pipeline.model import DepartureChoice, RouteMetrics
from pipeline.scenario.loading import scenario_text

# Fields of RouteMetrics in their order, and their columns. Fuel and length_planner_m are in the
# planner's scaled units, every other `_m` in true metres.
_FIELDS = (
    *("season", "rank", "way", "homotopy", "fuel", "fuel_per_distance", "length", "length_m"),
    *("clearance_m", "duration_s", "speed_m_s", "optimality_gap", "trials", "collisions"),
    *("land_m", "land_lon", "land_lat", "filled_share", "uncharted_share"),
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
# As it was asked for, with region and offing as they were chosen: `renew run` with this file gives
# the same routes.
"""


def _write_csv(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """Write rows to a new CSV file (UTF-8, a header, RFC 4180 line ends)."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)


def _time(moment: datetime) -> str:
    """Write a time as ISO 8601, UTC, to the second."""
    return f"{moment.astimezone(UTC):%Y-%m-%dT%H:%M:%SZ}"


def write_metrics(result: RunResult, path: Path) -> None:
    """Write the evaluation as CSV; departure and arrival are empty where none is given."""
    rows = []
    for metrics in (ranked.metrics for ranked in result.routes):
        passage = result.scenario.passage(metrics.season, round(metrics.duration_s)) or ()
        cells = {column: _cell(metrics, field) for column, field in METRICS_COLUMNS.items()}
        rows.append({**cells, **dict(zip(_PASSAGE, map(_time, passage), strict=False))})
    _write_csv(path, [*METRICS_COLUMNS, *_PASSAGE], rows)


def _cell(metrics: RouteMetrics, field: str) -> str:
    """Format a figure so that it reads back exactly; empty if it is not finite."""
    value = getattr(metrics, field)
    if isinstance(value, float):
        return repr(float(value)) if math.isfinite(value) else ""
    return str(value)


def write_departures_csv(result: RunResult, path: Path) -> None:
    """Write all departures of all seasons as CSV."""
    rows = (row for choice in result.departures for row in _departure_rows(result, choice))
    _write_csv(path, DEPARTURE_COLUMNS, rows)


def write_departures_json(result: RunResult, path: Path) -> None:
    """Write all departures as JSON, by season."""
    seasons = [
        {
            "season": choice.season,
            "best": _moment(choice, choice.chosen_s),
            "unproven_s": choice.unproven_s,
            "arrive_by": None if choice.arrive_by is None else choice.arrive_by.isoformat(),
            "departures": [
                {key: one for key, one in row.items() if key != "season"}
                for row in _departure_rows(result, choice)
            ],
        }
        for choice in result.departures
    ]
    write_json(path, seasons)


def _departure_rows(result: RunResult, choice: DepartureChoice) -> Iterator[dict[str, Any]]:
    """Yield a row for each departure, with its way if the best departure has that class, too."""
    ways = {
        one.homotopy: one.way for one in result.evaluation.routes if one.season == choice.season
    }
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
    return _time(choice.first + timedelta(seconds=round(seconds)))


def write_trade_off_csv(result: RunResult, path: Path) -> None:
    """Write the trade-offs of all seasons as CSV."""
    rows = (
        {"season": found.season, **row}
        for found in trade_offs(result)
        for row in _trade_off_rows(found)
    )
    _write_csv(path, TRADE_OFF_COLUMNS, rows)


def write_trade_off_json(result: RunResult, path: Path) -> None:
    """Write the trade-offs as JSON, by season, with the speeds allowed and those of the route."""
    seasons = [
        {
            "season": found.season,
            "departure": _time(found.departure),
            "arrive_by": _time(found.arrive_by),
            "least_m_s": found.choice.least,
            "most_m_s": found.choice.most,
            "slowest_m_s": found.slowest,
            "fastest_m_s": found.fastest,
            "trade_off": list(_trade_off_rows(found)),
        }
        for found in trade_offs(result)
    ]
    write_json(path, seasons)


def _trade_off_rows(found: TradeOff) -> Iterator[dict[str, Any]]:
    """Yield a row for each arrival, ascending; the chosen one is among them."""
    at = int(np.searchsorted(found.durations_s, found.duration_s))
    durations = np.insert(found.durations_s, at, found.duration_s)
    fuels = np.insert(found.fuels, at, found.fuel)
    for index, (duration, fuel) in enumerate(zip(durations.tolist(), fuels.tolist(), strict=True)):
        yield {
            "arrival": _time(found.moment(duration)),
            "hours": duration / 3600,
            "fuel": fuel,
            "of_chosen": fuel / found.fuel,
            "is_chosen": index == at,
        }


def write_scenario(result: RunResult, path: Path) -> None:
    """Write the scenario as TOML, with the departures among which one was chosen."""
    open_ones = {choice.season: choice.asked for choice in result.departures}
    seasons = tuple(open_ones.get(one.name) or one for one in result.scenario.seasons)
    asked = result.scenario.model_copy(update={"seasons": seasons})
    path.write_text(_HEAD + scenario_text(asked), encoding="utf-8")
