"""The scenario as it was planned, with what was chosen for it, to be run again."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pipeline.scenario.toml_text import scenario_text

if TYPE_CHECKING:
    from pathlib import Path

    from pipeline.formats.shared.result import RunResult

_HEAD = """\
# As it was planned, with what was chosen for it: `renew run` with this file gives the same routes.
"""


def write_scenario(result: RunResult, path: Path) -> None:
    """Write the complete scenario as TOML."""
    path.write_text(_HEAD + scenario_text(result.scenario), encoding="utf-8")
