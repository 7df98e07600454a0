import csv
from dataclasses import fields, replace
from datetime import datetime
from pathlib import Path

from pipeline.findings.names import COLUMNS, figure_columns
from pipeline.findings.result import RunResult
from pipeline.formats.tables import write_metrics
from pipeline.model import RouteMetrics
from tests.pipeline.results import rows_of, with_rows


def test_metrics_read_back_the_same(result: RunResult, tmp_path: Path) -> None:
    write_metrics(result, tmp_path / "metrics.csv")
    with (tmp_path / "metrics.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(rows_of(result))
    # Passages are in the file as one text.
    names = {column: COLUMNS[column].attribute for column in figure_columns("csv")}
    computed = {"way", "main_passage", "energy_wh", "left_wh"}
    assert set(names.values()) - computed == {field.name for field in fields(RouteMetrics)} - {
        *("passages", "still_fuel", "energy")
    }
    for row, metrics in zip(rows, rows_of(result), strict=True):
        for column, name in names.items():
            value = getattr(metrics, name)
            if value is None or value != value:  # noqa: PLR0124 - as only NaN is
                assert row.get(column, "") == ""
                assert COLUMNS[column].optional or column in row
            else:
                assert type(value)(row[column]) == value


def test_departure_and_arrival_stand_where_a_departure_is_given(
    result: RunResult, tmp_path: Path
) -> None:
    departure = datetime.fromisoformat("2026-11-22T14:20:00+08:00")
    summer, winter = result.scenario.seasons
    seasons = (summer.model_copy(update={"departure": departure}), winter)
    dated = replace(result, scenario=result.scenario.model_copy(update={"seasons": seasons}))
    write_metrics(dated, tmp_path / "metrics.csv")
    with (tmp_path / "metrics.csv").open(encoding="utf-8", newline="") as file:
        for row, ranked in zip(csv.DictReader(file), result.routes, strict=True):
            if ranked.season == winter.name:
                assert (row["departure"], row["arrival"]) == ("", "")
                continue
            assert row["departure"] == "2026-11-22T06:20:00Z"
            taken = datetime.fromisoformat(row["arrival"]) - departure
            assert taken.total_seconds() == round(ranked.metrics.duration_s)


def test_a_figure_that_does_not_exist_is_blank(result: RunResult, tmp_path: Path) -> None:
    changed = with_rows(result, lambda _, row: replace(row, optimality_gap=float("nan")))
    write_metrics(changed, tmp_path / "metrics.csv")
    with (tmp_path / "metrics.csv").open(encoding="utf-8", newline="") as file:
        assert next(csv.DictReader(file))["optimality_gap"] == ""
