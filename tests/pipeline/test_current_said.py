"""Every output names the current that was planned with and its date, where its format can."""

import sqlite3
from contextlib import closing
from pathlib import Path

from pipeline.run import run
from pipeline.scenario.loading import load_scenario
from tests.pipeline.small_region import with_stand_in

DATE = "2020-06-17"
WITHOUT_TEXT = {".waypoints"}
"""Formats that have no place for a text."""


def said(path: Path) -> str:
    """Return the text of a file."""
    if path.suffix == ".gpkg":
        with closing(sqlite3.connect(path)) as opened:
            return "\n".join(map(str, opened.execute("select current from routes")))
    return path.read_bytes().decode("utf-8", "replace")


def test_every_output_names_the_current_and_its_date(tmp_path: Path, across_outputs: Path) -> None:
    file = tmp_path / "said.toml"
    file.write_text(with_stand_in("said"), encoding="utf-8")
    outcome = run(load_scenario(str(file)), across_outputs, offline=True)
    paths = [path for path in outcome.directory.iterdir() if path.suffix not in WITHOUT_TEXT]
    assert {".csv", ".gpx", ".gpkg", ".html", ".json", ".nc", ".rtz"} <= {
        path.suffix for path in paths
    }
    silent = [path.name for path in paths if DATE not in said(path)]
    assert silent == ["scenario.toml"], "it asks for currents, and answers nothing"
    # That it stands in for another is said by all that name their sources in words.
    for path in paths:
        if path.suffix in {".csv", ".gpx", ".html", ".rtz"}:
            assert "Embedded" in said(path), path.name
