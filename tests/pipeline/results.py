"""What a run finds, for tests that read none of its files."""

from __future__ import annotations

from pathlib import Path

from pipeline.findings.result import RunResult
from pipeline.run import planned_scenario
from pipeline.scenario.model import Scenario


def result_of(scenario: Scenario, output: Path) -> RunResult:
    """Plan a scenario offline, or load its plan from the store, and write nothing else."""
    with planned_scenario(scenario, output, offline=True) as result:
        return result
