"""The embedded table of currents."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import shapely

from pipeline.model import Land
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import EmbeddedTableSpec
from pipeline.scenario.season import Season
from pipeline.sources.registry import EmbeddedTable

NO_LAND = Land((), (), 0.0)


def palawan() -> EmbeddedTable:
    """Return the table of the catalogue."""
    spec = catalogue.source("embedded-palawan")
    assert isinstance(spec, EmbeddedTableSpec)
    return EmbeddedTable(spec)


def season(name: str) -> Season:
    """Return a season that uses the table."""
    return Season(name=name, valid="2024-07", currents=("embedded-palawan",))


@pytest.mark.parametrize(("name", "step"), [("summer", 0.5), ("winter", 1.0)])
def test_the_grid_has_every_row_at_its_place_and_nothing_else(name: str, step: float) -> None:
    grid = palawan().current(shapely.box(116, 8, 121, 13), season(name), NO_LAND, Path())
    rows = [
        row
        for row in csv.reader(catalogue.table("palawan.csv").read_text().splitlines())
        if row[0] == name
    ]
    assert len(rows) > 50
    assert np.isfinite(grid.u).sum() == np.isfinite(grid.v).sum() == len(rows)
    for _, lon, lat, u, v in rows:
        column = int(np.abs(grid.lon - float(lon)).argmin())
        row = int(np.abs(grid.lat - float(lat)).argmin())
        assert abs(grid.lon[column] - float(lon)) < 1e-3
        assert abs(grid.lat[row] - float(lat)) < 1e-3
        assert (grid.u[0, row, column], grid.v[0, row, column]) == (float(u), float(v))
    assert np.allclose(np.diff(grid.lon), step)
    assert np.allclose(np.diff(grid.lat), step)
    assert grid.credit.kind == "current"
    assert grid.season == name


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
    text = catalogue.table("palawan.csv").read_text()
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
        assert grid.season == month
        assert np.array_equal(grid.u, same.u, equal_nan=True)
        assert table.identity(named(month)) == table.identity(season(monsoon))
        assert table.covered_bounds(region, named(month)) == region.bounds
    assert "has no season '2024-05'" in table.uncovered_reason(region, named("2024-05"))
    assert table.covered_bounds(region, named("2024-05")) is None


def test_it_covers_a_part_of_a_larger_region() -> None:
    world = shapely.box(0, -80, 360, 80)
    assert palawan().covered_bounds(world, season("summer")) == (114.75, 6.75, 123.25, 14.25)
    assert palawan().covered_bounds(shapely.box(0, 0, 10, 10), season("summer")) is None
