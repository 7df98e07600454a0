"""`departures.csv` and `departures.json`: what each departure that was planned comes to."""

import csv
import math
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

from pipeline.formats.shared.json_values import write_json
from pipeline.formats.shared.result import RunResult
from pipeline.model import DepartureChoice

COLUMNS = (
    "season",
    "departure",
    "arrival",
    "hours",
    "fuel",
    "homotopy",
    "way",
    "is_best",
    "unproven_min",
    "reason",
)
"""Times are UTC, fuel is in the planner's units; `unproven_min` is by how many minutes another
departure in the window may still take less than the best, to within the paths' own error; empty on
the others, and where nothing is known of it. `reason` is why there is no route."""


def write_departures_csv(result: RunResult, path: Path) -> None:
    """Write all departures of all seasons to a new CSV file (UTF-8, a header, RFC 4180)."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        for choice in result.departures:
            for row in _rows(result, choice):
                writer.writerow({key: "" if one is None else one for key, one in row.items()})


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
                for row in _rows(result, choice)
            ],
        }
        for choice in result.departures
    ]
    write_json(path, seasons)


def _rows(result: RunResult, choice: DepartureChoice) -> Iterator[dict[str, Any]]:
    """Yield a row for each departure; a way is given if the best departure has that class, too."""
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
    """A time of the choice's clock (ISO 8601, UTC), to the second."""
    return f"{choice.first + timedelta(seconds=round(seconds)):%Y-%m-%dT%H:%M:%SZ}"
