"""`metrics.csv`: one row per season and class, with units in the column names."""

import csv
import math
from pathlib import Path

from pipeline.formats.shared.result import RunResult
from pipeline.model import RouteMetrics

# Column in the file -> field of RouteMetrics. Fuel and length_planner_m are in the planner's scaled
# units, every other `_m` in true metres.
COLUMNS = {
    "season": "season",
    "rank": "rank",
    "way": "way",
    "homotopy": "homotopy",
    "fuel": "fuel",
    "fuel_per_distance": "fuel_per_distance",
    "length_planner_m": "length",
    "length_m": "length_m",
    "clearance_m": "clearance_m",
    "duration_s": "duration_s",
    "speed_through_water_m_s": "speed_m_s",
    "optimality_gap": "optimality_gap",
    "trials": "trials",
    "collisions": "collisions",
    "land_m": "land_m",
    "land_lon": "land_lon",
    "land_lat": "land_lat",
    "filled_share": "filled_share",
    "uncharted_share": "uncharted_share",
}


def write_metrics(result: RunResult, path: Path) -> None:
    """Write the evaluation to a new CSV file (UTF-8, a header, RFC 4180 line ends)."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([*COLUMNS, "departure", "arrival"])
        for ranked in result.routes:
            cells = [_cell(ranked.metrics, field) for field in COLUMNS.values()]
            writer.writerow([*cells, *_times(ranked.metrics, result)])


def _times(metrics: RouteMetrics, result: RunResult) -> tuple[str, str]:
    """Departure and arrival (ISO 8601, UTC), to the second; empty where no departure is given."""
    passage = result.scenario.passage(metrics.season, round(metrics.duration_s))
    begin, end = (f"{one:%Y-%m-%dT%H:%M:%SZ}" for one in passage) if passage else ("", "")
    return begin, end


def _cell(metrics: RouteMetrics, field: str) -> str:
    """Format a figure so that it reads back exactly; empty if it is not finite."""
    value = getattr(metrics, field)
    if isinstance(value, float):
        return repr(float(value)) if math.isfinite(value) else ""
    return str(value)
