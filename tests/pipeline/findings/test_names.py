"""The table of columns, and which of them a run's files have."""

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pipeline.findings.names import COLUMNS, figure_columns, figures, used
from pipeline.findings.result import RunResult
from pipeline.formats.gis.layers import FRAMES
from pipeline.formats.tables import write_metrics
from pipeline.model import RouteMetrics
from tests.pipeline.formats import small_run
from tests.pipeline.results import with_rows


@pytest.mark.parametrize("kind", ["csv", "layer", "json", "night"])
def test_each_figure_is_read_from_a_route(kind: str) -> None:
    metrics = small_run.parts().routes[0].metrics
    found = figures(metrics, kind)
    assert tuple(found) == figure_columns(kind)
    assert {"fuel", "length_m", "duration_s", "optimality_gap"} <= set(found)
    class_column = "class" if kind in {"json", "night"} else "homotopy"
    assert found[class_column] == metrics.homotopy
    for name in found:
        assert len(COLUMNS[name].meaning) > 5


def test_only_optional_columns_are_left_out_and_only_where_all_rows_are_empty() -> None:
    rows: list[dict[str, Any]] = [
        {"way": "", "least_water_m": "", "land_lon": None},
        {"way": "", "least_water_m": 0.0},
    ]
    assert used(["way", "land_lon", "least_water_m"], rows) == ["way", "least_water_m"]


def with_water(name: str, row: RouteMetrics) -> RouteMetrics:
    """Give the routes of winter water under the keel."""
    return replace(row, least_water_m=1.25) if name == "winter" else row


def test_a_column_is_there_if_one_route_has_a_value(tmp_path: Path) -> None:
    plain: RunResult = small_run.parts()
    for run, is_there in ((plain, False), (with_rows(plain, with_water), True)):
        write_metrics(run, tmp_path / "metrics.csv")
        with (tmp_path / "metrics.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        layer = FRAMES["routes"](run)
        assert ("least_water_m" in rows[0]) == ("least_water_m" in layer.columns) == is_there
        assert "least_water_at" not in rows[0]
        if is_there:
            stated = {(row["season"], row["least_water_m"]) for row in rows}
            assert stated == {("summer", ""), ("winter", "1.25")}
            assert layer[layer.season == "winter"].least_water_m.tolist() == [
                1.25 for row in rows if row["season"] == "winter"
            ]
