"""Waters and a vessel for voyages in one line."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from pipeline.scenario.model import Scenario
from pipeline.sources.current_field import Field
from pipeline.voyage.one_line import voyage_scenario
from pipeline.voyage.request import read_voyage
from tests.pipeline.synthetic_currents import dataset, sea, write

# In the middle of the Atlantic: the only land is the chart's, an island of 2 km by 4 km on the way.
START, GOAL = (-40.06, 35.0), (-39.94, 35.0)
ISLAND = shapely.box(-40.01, 34.985, -39.99, 35.02)


FIGURES: dict[str, Any] = {"speed": "8kn", "length": "12m", "turning_circle": "40m"}


def scenario_of(given: Mapping[str, Any]) -> tuple[Scenario, tuple[str, ...]]:
    """Give the scenario of a voyage as it is typed, with the notes on it."""
    return voyage_scenario(read_voyage(given, "command"))


def metrics(directory: Path) -> list[dict[str, str]]:
    with (directory / "metrics.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def write_tide(file: Path) -> Path:
    """Write currents around these waters that turn once in 12.42 hours, hour by hour."""
    lon, lat = np.arange(-40.25, -39.7, 0.05), np.arange(34.8, 35.25, 0.05)
    one, other = sea(lon, lat, 2), sea(lon, lat, 3)
    hours = np.arange("2026-11-22T00", "2026-11-23T12", dtype="datetime64[h]")
    steps = []
    for angle in 2 * np.pi * (np.arange(len(hours)) - 4.2) / 12.42:
        u, v = (np.cos(angle) * getattr(one, c) + np.sin(angle) * getattr(other, c) for c in "uv")
        steps.append(Field(lon, lat, u, v))
    return write(file, dataset(*steps, times=hours))
