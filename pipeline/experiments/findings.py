"""What a run of the experiments gave: for tables, figures and the report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pipeline.experiments.environments.loading import Environment
    from pipeline.experiments.tables.summary import Table
    from pipeline.experiments.tables.tables import Results


@dataclass(frozen=True)
class Findings:
    """Environments, results of all runs, tables made of them, and facts about the run."""

    environments: tuple[Environment, ...]
    results: Results
    tables: tuple[Table, ...]
    facts: dict[str, str]
