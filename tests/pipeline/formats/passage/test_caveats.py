"""Files for plotters, ECDIS and autopilots say what was measured, not known and decided."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from pipeline.formats.passage.missions import write_plan
from pipeline.formats.passage.routes import write_gpx, write_kml, write_rtz
from pipeline.formats.tables import write_metrics
from tests.pipeline.formats import small_run
from tests.pipeline.results import with_measures

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from pipeline.findings.result import RunResult

WRITERS: dict[str, Callable[..., None]] = {
    "rtz": write_rtz,
    "gpx": write_gpx,
    "kml": write_kml,
    "plan": write_plan,
}


def with_hits(result: RunResult) -> RunResult:
    """The run, with two turns of winter's best route that met land."""
    turns, *others = result.case("winter").measures.turns
    collided = np.zeros(len(turns.points), dtype=bool)
    collided[[5, 9]] = True
    best, *rows = result.case("winter").measures.routes
    flown = (replace(turns, collided=collided), *others)
    return with_measures(result, "winter", routes=(replace(best, collisions=2), *rows), turns=flown)


@pytest.mark.parametrize("end", WRITERS)
def test_a_route_that_is_not_safe_says_so_in_every_file(end: str, tmp_path: Path) -> None:
    result = small_run.parts()
    told = {}
    for name, run in (("safe", result), ("unsafe", with_hits(result))):
        WRITERS[end](run.case("winter"), tmp_path / f"{name}.{end}")
        told[name] = (tmp_path / f"{name}.{end}").read_text(encoding="utf-8").lower()
    row = result.case("winter").measures.routes[0]
    assert f"not safe everywhere: 2 of {row.trials:,} hard-over turns" in told["unsafe"]
    assert "not safe" not in told["safe"]
    assert "everywhere" not in told["safe"]
    if end == "rtz":
        assert f"none of {row.trials:,} simulated hard-over turns met land" in told["safe"]
        assert f"2 of {row.trials:,} simulated hard-over turns met land" in told["unsafe"]


@pytest.mark.parametrize("end", WRITERS)
def test_every_file_names_the_current_that_was_used(end: str, tmp_path: Path) -> None:
    """Summer is planned on a stand-in, winter on what was asked for."""
    result = small_run.parts()
    for season in ("summer", "winter"):
        WRITERS[end](result.case(season), tmp_path / f"{season}.{end}")
        grid = result.case(season).grid
        assert grid is not None
        told = (tmp_path / f"{season}.{end}").read_text(encoding="utf-8").lower()
        assert f"planned on {grid.credit.name}, valid {grid.valid}".lower() in told


def test_metrics_name_the_current_that_was_used(tmp_path: Path) -> None:
    result = small_run.parts()
    write_metrics(result, tmp_path / "metrics.csv")
    text = (tmp_path / "metrics.csv").read_text(encoding="utf-8")
    for grid in result.fetched.currents:
        assert f"{grid.credit.name}, {grid.valid.replace('/', ' to ')}" in text
