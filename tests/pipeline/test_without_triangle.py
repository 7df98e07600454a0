"""The catalogue's jobs where the extra `triangle` is not installed, as a user starts them."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline.cli.main import app
from tests.commands import PYTHON, ran


def rows(output: Path, scenario: str) -> dict[tuple[str, str], dict[str, str]]:
    """Rows of metrics.csv by season and class."""
    with (output / scenario / "metrics.csv").open(newline="") as file:
        return {(row["season"], row["homotopy"]): row for row in csv.DictReader(file)}


@pytest.mark.slow
@pytest.mark.parametrize(
    "scenario", ["single-gyre", pytest.param("palawan-season", marks=pytest.mark.slow)]
)
def test_it_runs_and_finds_the_same_routes(scenario: str, root: Path, tmp_path: Path) -> None:
    without, usual = tmp_path / "without", tmp_path / "usual"
    command = ["run", scenario, "--offline", "--output"]
    program = (
        "import importlib.util; assert importlib.util.find_spec('triangle') is None; "
        "from pipeline.cli.main import main; main()"
    )
    ran(
        *PYTHON,
        program,
        *command,
        str(without),
        cwd=root,
        env={**os.environ, "PYTHONPATH": str(root / "tests" / "no_triangle")},
        timeout=600,
    )
    assert CliRunner().invoke(app, [*command, str(usual)]).exit_code == 0
    found, expected = rows(without, scenario), rows(usual, scenario)
    assert found.keys() == expected.keys()
    for route, row in expected.items():
        # The best route is near the optimum; a dear class may take another of its valleys.
        tolerance = 1e-3 if row["rank"] == "1" else 5e-3
        assert float(found[route]["fuel"]) == pytest.approx(float(row["fuel"]), rel=tolerance)
        assert found[route]["way"] == row["way"]
        assert found[route]["collisions"] == "0"
