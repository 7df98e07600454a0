"""Figures of the pipeline as a user runs it, and times until RENEW answers."""

from __future__ import annotations

import csv
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pyogrio
import pyproj
import shapely

from tests.bench.clock import ran
from tests.bench.figure import Figure, at_most
from tests.strategies import PAPER_VESSEL, SINGLE_GYRE_ISLANDS


def figures() -> Iterator[Figure]:
    """Yield the pipeline's figures, one by one as they are measured."""
    with tempfile.TemporaryDirectory() as folder:
        seconds, peak = run_scenario("palawan-season", Path(folder), "--offline")
        yield at_most("palawan-season, both seasons, k = 16: time", seconds, 60, " s", 1)
        yield at_most("palawan-season: largest process", peak, 1.5, " GB")
        seconds, _ = run_scenario("palawan-season", Path(folder), "--offline")
        yield at_most("palawan-season, second run: time", seconds, 5, " s", 1)
        yield from _of_results(Path(folder) / "palawan-season")


def run_scenario(name: str, folder: Path, *options: str) -> tuple[float, float]:
    """Run a scenario as a user does; wall time (s) and the process's largest memory (GB)."""
    words = ("-m", "pipeline.cli.main", "run", name, *options, "--output", str(folder))
    taken = ran(*words)
    return taken.wall, taken.peak


def _of_results(folder: Path) -> Iterator[Figure]:
    """What the files say: collisions, land, lengths, sides."""
    with (folder / "metrics.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    collisions = sum(int(row["collisions"]) for row in rows)
    trials = sum(int(row["trials"]) for row in rows)
    yield Figure(
        "palawan-season: collisions on the original land",
        "0",
        f"{collisions} of {trials}",
        collisions == 0,
    )
    on_land = sum(float(row["land_m"]) for row in rows)
    yield at_most("palawan-season: route on the original land", on_land, 0, " m", 1)
    worst = 0.0
    geod = pyproj.Geod(ellps="WGS84")
    _, _, shapes, (lengths,) = pyogrio.raw.read(
        folder / "routes.gpkg", layer="routes", columns=["length_m"]
    )
    for shape, length in zip(shapely.from_wkb(shapes), lengths, strict=True):
        worst = max(worst, abs(geod.geometry_length(shape) / length - 1))
    yield at_most("palawan-season: length attribute against its line", 100 * worst, 0.1, " %", 3)
    for season in dict.fromkeys(row["season"] for row in rows):
        found = [row for row in rows if row["season"] == season]
        first = {row["way"].split(",")[0]: row for row in reversed(found)}
        text = "; ".join(f"{way} {float(row['fuel']):.1f}" for way, row in first.items() if way)
        yield Figure(
            f"palawan-season, {season}: least fuel on each side of Palawan",
            "both sides",
            text,
            {"west of Palawan", "east of Palawan"} <= first.keys(),
        )


# Without the tests' modules, whose own imports a user's plan does not make.
FIRST_PLAN = f"""
import renew
from shapely import Polygon, box
chart = renew.Chart(box(0, 0, 100, 100), [Polygon(one) for one in {SINGLE_GYRE_ISLANDS}])
vessel = renew.{PAPER_VESSEL}
renew.plan(chart, renew.GyreCurrent(0.8, 100, 100), vessel, (10.0, 10.0), (90.0, 90.0))
"""


def startup() -> Iterator[Figure]:
    """Yield each command's least time of three, after one that is not counted (s)."""
    commands = {
        "import renew": (("-c", "import renew"), 0.5),
        "import renew and plan the single gyre": (("-c", FIRST_PLAN), 1.0),
        "renew --help": (("-m", "pipeline.cli.main", "--help"), 0.25),
    }
    for name, (words, limit) in commands.items():
        times = [ran(*words).cpu for _ in range(4)]
        yield at_most(f"{name}: CPU time", min(times[1:]), limit, " s")
