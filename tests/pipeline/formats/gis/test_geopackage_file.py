"""`routes.gpkg` as a file: its records beside the layers, equal files, and GDAL's checker."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.findings.note_words import note_texts
from pipeline.findings.result import RunResult
from pipeline.formats.gis.geopackage import write_geopackage
from pipeline.formats.records import manifest
from pipeline.model import RouteMetrics
from tests.pipeline.formats import runs, small_run
from tests.pipeline.formats.gis.cases import BAD_CREDIT, ODD, SCRIPT, badly_named
from tests.pipeline.formats.gis.tables import (
    LAYERS,
    layer,
    query,
    without_routes,
)
from tests.pipeline.results import with_rows
from tests.validators import geopackage_faults


def test_sources_travel_inside_the_file(package: Path, result: RunResult) -> None:
    rows = query(
        package,
        "SELECT mime_type, metadata, reference_scope FROM gpkg_metadata"
        " JOIN gpkg_metadata_reference ON md_file_id = id",
    )
    assert [(mime, scope) for mime, _, scope in rows] == [("application/json", "geopackage")]
    content = json.loads(rows[0][1])
    assert content["land_sources"][0]["text"] == small_run.LAND.text
    assert [s["name"] for s in content["current_sources"]] == ["Test table", "Better source"]
    assert content["notes"] == note_texts(result.fetched.notes)
    # The manifest without the list of files, of which this is one.
    assert set(content) == set(manifest(result, ())) - {"outputs"}
    assert content["scenario_as_run"]["name"] == "small-run"


def test_every_column_has_a_title_and_a_meaning(package: Path) -> None:
    rows = query(
        package, "SELECT table_name, column_name, name, title, description FROM gpkg_data_columns"
    )
    described = {(table, column) for table, column, *_ in rows}
    present = {
        (name, row[1])
        for name in LAYERS
        for row in query(package, f"PRAGMA table_info({name})")
        if row[1] != "geom"
    }
    assert described == present
    for _, column, name, title, meaning in rows:
        # GDAL shows `name`, other readers `title`.
        assert name == title
        assert title not in {"", column}
        assert len(meaning) > 5
    extensions = query(
        package,
        "SELECT table_name, extension_name, definition, scope FROM gpkg_extensions"
        " WHERE table_name LIKE 'gpkg_%'",
    )
    assert {(table, name) for table, name, *_ in extensions} == {
        ("gpkg_metadata", "gpkg_metadata"),
        ("gpkg_metadata_reference", "gpkg_metadata"),
        ("gpkg_data_columns", "gpkg_schema"),
        ("gpkg_data_column_constraints", "gpkg_schema"),
    }
    assert all(scope == "read-write" for *_, scope in extensions)


def test_titles_have_units(package: Path) -> None:
    """Titles of columns that end in a unit, and of the currents' columns, state the unit."""
    titles = dict(query(package, "SELECT column_name, title FROM gpkg_data_columns"))
    for column, title in titles.items():
        for ending, unit in (("_deg", "(° true)"), ("_m_s", "(m/s)"), ("_m", "(m)"), ("_s", "(s)")):
            if column.endswith(ending):
                assert title.endswith(unit), column
                break
    for column in ("u", "v", "speed"):
        assert titles[column].endswith("(m/s)")
    assert titles["direction"].endswith("(° true)")


def test_the_same_run_is_the_same_file(result: RunResult, tmp_path: Path) -> None:
    for folder in ("first", "second"):
        (tmp_path / folder).mkdir()
        write_geopackage(result, tmp_path / folder / "routes.gpkg")
        time.sleep(0.01)  # longer than the resolution of the dates in it
    first, second = sorted(tmp_path.glob("*/routes.gpkg"))
    assert first.read_bytes() == second.read_bytes()


def test_names_with_a_meaning_in_sql_are_stored_as_text(result: RunResult, tmp_path: Path) -> None:
    path = tmp_path / "routes.gpkg"
    write_geopackage(badly_named(result), path)
    assert set(layer(path, "routes").season) == {SCRIPT, ODD}
    assert set(query(path, "SELECT DISTINCT season FROM currents")) == {(SCRIPT,), (ODD,)}
    assert query(path, "PRAGMA integrity_check") == [("ok",)]
    [(metadata,)] = query(path, "SELECT metadata FROM gpkg_metadata")
    assert json.loads(metadata)["land_sources"][0]["text"] == BAD_CREDIT.text


def test_figures_that_do_not_exist_are_null(result: RunResult, tmp_path: Path) -> None:
    def unknown(_: str, row: RouteMetrics) -> RouteMetrics:
        return replace(row, optimality_gap=float("nan"), clearance_m=float("inf"))

    path = tmp_path / "routes.gpkg"
    write_geopackage(with_rows(result, unknown), path)
    found = query(path, "SELECT DISTINCT optimality_gap, clearance_m FROM routes")
    assert found == [(None, None)]


@pytest.mark.gate_share(2)
@pytest.mark.parametrize(
    "case", ["as it is", "planar", "badly named", "without routes", "without land"]
)
def test_gdals_own_checker_finds_nothing(
    result: RunResult, planar_result: RunResult, tmp_path: Path, case: str
) -> None:
    checked_result = {
        "as it is": lambda: result,
        "planar": lambda: planar_result,
        "badly named": lambda: badly_named(result),
        "without routes": lambda: without_routes(result),
        "without land": lambda: runs.open_sea(),  # noqa: PLW0108 - mypy takes them for one kind
    }[case]()
    package = tmp_path / "routes.gpkg"
    write_geopackage(checked_result, package)
    faults = geopackage_faults(package)
    if faults is None:
        pytest.skip("GDAL's Python samples are not installed (Debian: python3-gdal)")
    assert faults == ""
