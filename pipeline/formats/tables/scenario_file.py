"""The scenario as it was planned, with what was chosen for it, to be run again."""

from pathlib import Path

from pipeline.formats.shared.result import RunResult
from pipeline.scenario.loading import scenario_text

_HEAD = """\
# As it was asked for, with region and offing as they were chosen: `renew run` with this file gives
# the same routes.
"""


def write_scenario(result: RunResult, path: Path) -> None:
    """Write the scenario as TOML, with the departures among which one was chosen."""
    open_ones = {choice.season: choice.asked for choice in result.departures}
    seasons = tuple(open_ones.get(one.name) or one for one in result.scenario.seasons)
    asked = result.scenario.model_copy(update={"seasons": seasons})
    path.write_text(_HEAD + scenario_text(asked), encoding="utf-8")
