"""The choice of a source by its name; embedded tables and still water."""

import csv
from pathlib import Path

import numpy as np
import pytest
import shapely
from pydantic import ValidationError

from pipeline.errors import RequestError
from pipeline.findings.note_words import note_texts
from pipeline.model import Land
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import EmbeddedTableSpec
from pipeline.scenario.region import ChartSpec
from pipeline.scenario.season import Season
from pipeline.sources.registry import EmbeddedTable, current_source, land_source
from tests.pipeline.sources.land.test_vector import write


@pytest.mark.parametrize("name", ["s57", "natural-earth"])
def test_a_kind_of_chart_needs_its_files(name: str) -> None:
    with pytest.raises(RequestError, match=r"--charts PATH"):
        land_source(ChartSpec.model_validate({"source": name}), 1.0)


def test_a_name_that_does_not_match_its_path_is_refused(tmp_path: Path) -> None:
    file = write(tmp_path / "land.gpkg", shapely.box(118.45, 10.25, 118.46, 10.26))
    for name, path, found in (
        ("s57", file, "a vector file, not 's57'"),
        ("natural-earth", tmp_path, "S-57 cells, not 'natural-earth'"),
    ):
        spec = ChartSpec.model_validate({"source": {"name": name, "path": str(path)}})
        with pytest.raises(RequestError, match=f"is {found}; leave the name out"):
            land_source(spec, 1.0)


# --- The embedded table of currents ---


NO_LAND = Land((), (), 0.0)


def palawan() -> EmbeddedTable:
    """Return the table of the catalogue."""
    spec = catalogue.source("embedded-palawan")
    assert isinstance(spec, EmbeddedTableSpec)
    return EmbeddedTable(spec)


def season(name: str) -> Season:
    """Return a season that uses the table."""
    return Season(name=name, valid="2024-07", currents=("embedded-palawan",))


@pytest.mark.parametrize("table", ["palawan", "hansando", "far-east"])
def test_the_grid_has_every_row_at_its_place_and_nothing_else(table: str) -> None:
    spec = catalogue.source(f"embedded-{table}")
    assert isinstance(spec, EmbeddedTableSpec)
    for name in spec.seasons:
        assert_is_whole(EmbeddedTable(spec), name)


def assert_is_whole(table: EmbeddedTable, name: str) -> None:
    """Compare one season of a table with its rows."""
    grid = table.current(shapely.box(116, 8, 121, 13), season(name), NO_LAND, Path())
    lines = (catalogue.root() / "currents" / table.spec.table).read_text().splitlines()
    rows = [row for row in csv.reader(lines) if row[0] == name]
    assert len(rows) > 5
    assert np.isfinite(grid.u).sum() == np.isfinite(grid.v).sum() == len(rows)
    for _, lon, lat, u, v in rows:
        column = int(np.abs(grid.lon - float(lon)).argmin())
        row = int(np.abs(grid.lat - float(lat)).argmin())
        assert abs(grid.lon[column] - float(lon)) < 1e-3
        assert abs(grid.lat[row] - float(lat)) < 1e-3
        assert (grid.u[0, row, column], grid.v[0, row, column]) == (float(u), float(v))
    assert np.ptp(np.diff(grid.lon)) < 1e-9
    assert np.ptp(np.diff(grid.lat)) < 1e-9
    assert grid.credit.kind == "current"
    assert grid.case == name


def test_it_covers_half_a_cell_beyond_its_nodes() -> None:
    table = palawan()
    # The nodes of summer reach from 115 to 123 E and 7 to 14 N.
    assert table.uncovered_reason(shapely.box(114.75, 6.75, 123.25, 14.25), season("summer")) == ""
    for box, side in (
        (shapely.box(114.74, 7, 122, 13), "west of 114.75"),
        (shapely.box(116, 6.74, 122, 13), "south of 6.75"),
        (shapely.box(116, 7, 123.26, 13), "east of 123.25"),
        (shapely.box(116, 7, 122, 14.26), "north of 14.25"),
    ):
        assert side in table.uncovered_reason(box, season("summer"))


def test_the_identity_follows_the_values_and_the_season(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = palawan().spec
    known = {palawan().identity(season("summer")), palawan().identity(season("winter"))}
    copy = tmp_path / "catalog"
    for section in ("scenarios", "currents"):
        (copy / section).mkdir(parents=True)
    text = (catalogue.root() / "currents/palawan.csv").read_text()
    (copy / "currents" / "palawan.csv").write_text(text.replace("-0.034", "-0.035", 1))
    monkeypatch.setattr(catalogue, "root", lambda: copy)
    assert EmbeddedTable(spec).identity(season("summer")) not in known


def test_a_season_that_is_named_by_its_month_has_the_monsoons_currents() -> None:
    table = palawan()
    region = shapely.box(116, 8, 121, 13)

    def named(month: str) -> Season:
        return Season(name=month, valid=month, currents=("embedded-palawan",))

    for month, monsoon in (("2024-07", "summer"), ("2031-12", "winter"), ("2024-01", "winter")):
        grid = table.current(region, named(month), NO_LAND, Path())
        same = table.current(region, season(monsoon), NO_LAND, Path())
        assert grid.case == month
        assert np.array_equal(grid.u, same.u, equal_nan=True)
        assert table.identity(named(month)) == table.identity(season(monsoon))
        assert table.covered_bounds(region, named(month)) == region.bounds
    assert "summer is of the months 6, 7, 8, 9; winter is of" in table.uncovered_reason(
        region, named("2024-05")
    )
    assert table.covered_bounds(region, named("2024-05")) is None


def test_it_covers_a_part_of_a_larger_region() -> None:
    world = shapely.box(0, -80, 360, 80)
    assert palawan().covered_bounds(world, season("summer")) == (114.75, 6.75, 123.25, 14.25)
    assert palawan().covered_bounds(shapely.box(0, 0, 10, 10), season("summer")) is None


# --- Still water ---


STILL = Season(name="still", currents=("still",))
REGION = shapely.box(170, -20, 190, -10)


def test_it_is_zero_over_the_whole_region_and_says_so() -> None:
    source = current_source("still")
    grid = source.current(REGION, STILL, Land((), (), 0.0), Path())
    assert (grid.lon[0], grid.lat[0], grid.lon[-1], grid.lat[-1]) == REGION.bounds
    assert not np.any([grid.u, grid.v])
    assert source.covered_bounds(REGION, STILL) == REGION.bounds
    assert any("without currents" in note for note in note_texts(grid.notes))


def test_it_needs_nothing() -> None:
    source = current_source("still")
    assert not source.needs_network(REGION, STILL, Path())
    assert source.unavailable_reason() == source.uncovered_reason(REGION, STILL) == ""


def test_only_still_water_needs_no_time() -> None:
    assert STILL.valid == ""
    with pytest.raises(ValidationError, match="lacks 'valid'"):
        Season(name="some", currents=("still", "embedded-palawan"))
