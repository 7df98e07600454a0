"""Seasons with a time limit run in processes that end at the limit, or with the program."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from pipeline.errors import StageError
from pipeline.run import run
from pipeline.scenario.loading import parse_scenario
from pipeline.scenario.model import Scenario
from tests.pipeline.processes import QUICK, SLOW, descendants, renew, started, wait_until
from tests.pipeline.results import rows_of


def scenario(text: str) -> Scenario:
    """Return the scenario of a text."""
    import tomllib

    return parse_scenario(tomllib.loads(text))


@pytest.mark.usefixtures("plain_report")
def test_a_limit_that_is_not_reached_changes_nothing(tmp_path: Path) -> None:
    outcomes = [
        run(scenario(QUICK), tmp_path / "a", limit_s=300),
        run(scenario(QUICK), tmp_path / "b"),
    ]
    assert [outcome.exit_code for outcome in outcomes] == [0, 0]
    # Compared as texts, since NaN (not known) differs from itself.
    assert repr(rows_of(outcomes[0].result)) == repr(rows_of(outcomes[1].result))


@pytest.mark.usefixtures("plain_report")
def test_a_season_past_its_limit_fails_and_the_others_are_written(tmp_path: Path) -> None:
    """The first season's plan lies in the store already."""
    both = scenario(SLOW.replace("classes = 9000", "classes = 1"))
    only_first = both.model_copy(update={"seasons": both.seasons[:1]})
    assert run(only_first, tmp_path).exit_code == 0
    before = descendants(os.getpid())  # other tests' clusters
    outcome = run(both, tmp_path, limit_s=0.5)
    assert outcome.exit_code == 1
    assert outcome.failures == ("season 'second': took longer than the limit of 0.5 s",)
    assert "first" in (tmp_path / "slow" / "metrics.csv").read_text()
    assert descendants(os.getpid()) <= before


def test_no_season_within_its_limit_is_a_failure(tmp_path: Path) -> None:
    with pytest.raises(StageError, match=r"took longer than the limit of 0\.5 s"):
        run(scenario(QUICK), tmp_path, limit_s=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_season_processes_end_with_the_program(tmp_path: Path, number: int) -> None:
    (tmp_path / "slow.toml").write_text(SLOW)
    command = renew("run", str(tmp_path / "slow.toml"), "--limit", "600", "--output", str(tmp_path))
    with started(*command) as process:
        wait_until(lambda: len(descendants(process.pid)) >= 1)
        children = descendants(process.pid)
        process.send_signal(number)
        process.wait(5)
        wait_until(lambda: not any(os.path.exists(f"/proc/{child}/exe") for child in children), 5)  # noqa: PTH110
