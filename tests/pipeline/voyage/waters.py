"""Waters and a vessel for voyages in one line."""

from __future__ import annotations

import csv
from pathlib import Path

import shapely

from pipeline.voyage.vessel_options import VesselFigures

# In the middle of the Atlantic: the only land is the chart's, an island of 2 km by 4 km on the way.
START, GOAL = (-40.06, 35.0), (-39.94, 35.0)
ISLAND = shapely.box(-40.01, 34.985, -39.99, 35.02)


FIGURES = VesselFigures("8kn", "12m", "40m")


def metrics(directory: Path) -> list[dict[str, str]]:
    with (directory / "metrics.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))
