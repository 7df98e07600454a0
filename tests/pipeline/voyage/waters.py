"""Waters and a vessel for voyages in one line."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import shapely

from pipeline.scenario.model import Scenario
from pipeline.voyage.one_line import voyage_scenario
from pipeline.voyage.readers import VesselFigures
from pipeline.voyage.request import read_voyage

# In the middle of the Atlantic: the only land is the chart's, an island of 2 km by 4 km on the way.
START, GOAL = (-40.06, 35.0), (-39.94, 35.0)
ISLAND = shapely.box(-40.01, 34.985, -39.99, 35.02)


FIGURES = VesselFigures("8kn", "12m", "40m")


def scenario_of(given: Mapping[str, Any]) -> tuple[Scenario, tuple[str, ...]]:
    """Give the scenario of a voyage as it is typed, with the notes on it."""
    return voyage_scenario(read_voyage(given, "command"))


def metrics(directory: Path) -> list[dict[str, str]]:
    with (directory / "metrics.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))
