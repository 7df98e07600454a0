"""What a run finds, for tests that read none of its files."""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pipeline.findings.result import RunResult
from pipeline.model import RouteMetrics
from pipeline.run import planned_scenario
from pipeline.scenario.model import Scenario


@contextlib.contextmanager
def plain_pages(*plain: str) -> Iterator[None]:
    """Write words in place of the report and the GeoPackage, or of one: most of the time."""

    def write_text(result: RunResult, path: Path) -> None:
        path.write_text(result.scenario.name)

    with pytest.MonkeyPatch.context() as patched:
        for name in plain or ("report.page.write_report", "gis.geopackage.write_geopackage"):
            patched.setattr(f"pipeline.formats.{name}", write_text)
        yield


def result_of(scenario: Scenario, output: Path) -> RunResult:
    """Plan a scenario offline, or load its plan from the store, and write nothing else."""
    with planned_scenario(scenario, output, offline=True) as result:
        return result


def rows_of(result: RunResult) -> list[RouteMetrics]:
    """The metrics of all routes, by case, then by rank."""
    return [row for case in result.cases for row in case.measures.routes]


def with_water(result: RunResult, **changes: Any) -> RunResult:
    """The same run on a chart with other values."""
    water = replace(result.water, **changes)
    planned = {name: replace(case, water=water) for name, case in result.planned.items()}
    return replace(result, water=water, planned=planned)


def with_case(result: RunResult, name: str, **changes: Any) -> RunResult:
    """The same run whose case of a name was planned with other values."""
    case = replace(result.planned[name], **changes)
    return replace(result, planned={**result.planned, name: case})


def with_result(result: RunResult, name: str, **changes: Any) -> RunResult:
    """The same run with another result of a case."""
    results = (replace(one, **changes) if one.name == name else one for one in result.results)
    return replace(result, results=tuple(results))


def with_measures(result: RunResult, name: str, **changes: Any) -> RunResult:
    """The same run with other measures of a case."""
    measures = replace(result.case(name).measures, **changes)
    return with_result(result, name, measures=measures)


def with_rows(
    result: RunResult, change: Callable[[str, RouteMetrics], RouteMetrics | None]
) -> RunResult:
    """The same run with other metrics of its routes, given each case's name; None drops one."""
    for case in result.cases:
        rows = (change(case.name, row) for row in case.measures.routes)
        kept = tuple(row for row in rows if row is not None)
        result = with_measures(result, case.name, routes=kept)
    return result
