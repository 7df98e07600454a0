"""`trade-off.csv` and `trade-off.json`: least fuel by arrival, where speeds are chosen."""

import csv
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.formats.shared.json_values import write_json
from pipeline.formats.shared.result import RunResult
from pipeline.formats.shared.trade_offs import TradeOff, trade_offs

COLUMNS = ("season", "arrival", "hours", "fuel", "of_chosen", "is_chosen")
"""Arrivals are UTC, `hours` those under way, fuel is in the planner's units; `of_chosen` is a share
of the best route's fuel, which has the row that is chosen."""


def write_trade_off_csv(result: RunResult, path: Path) -> None:
    """Write the trade-offs of all seasons to a new CSV file (UTF-8, a header, RFC 4180)."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        for found in trade_offs(result):
            writer.writerows({"season": found.season, **row} for row in _rows(found))


def write_trade_off_json(result: RunResult, path: Path) -> None:
    """Write the trade-offs as JSON, by season, with the speeds allowed and those of the route."""
    seasons = [
        {
            "season": found.season,
            "departure": _moment(found.departure),
            "arrive_by": _moment(found.arrive_by),
            "least_m_s": found.choice.least,
            "most_m_s": found.choice.most,
            "slowest_m_s": found.slowest,
            "fastest_m_s": found.fastest,
            "trade_off": list(_rows(found)),
        }
        for found in trade_offs(result)
    ]
    write_json(path, seasons)


def _rows(found: TradeOff) -> Iterator[dict[str, Any]]:
    """Yield a row for each arrival, ascending; the chosen one is among them."""
    at = int(np.searchsorted(found.durations_s, found.duration_s))
    durations = np.insert(found.durations_s, at, found.duration_s)
    fuels = np.insert(found.fuels, at, found.fuel)
    for index, (duration, fuel) in enumerate(zip(durations.tolist(), fuels.tolist(), strict=True)):
        yield {
            "arrival": _moment(found.moment(duration)),
            "hours": duration / 3600,
            "fuel": fuel,
            "of_chosen": fuel / found.fuel,
            "is_chosen": index == at,
        }


def _moment(moment: datetime) -> str:
    """A time as ISO 8601, UTC, to the second."""
    return f"{moment.astimezone(UTC):%Y-%m-%dT%H:%M:%SZ}"
