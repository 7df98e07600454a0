"""A command without stages says now and then that it is at work."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline.cli import terminal
from pipeline.cli.main import app


class _Nothing(str):
    """What each of the slow functions may return: no findings, no text, and the path of a file."""

    __slots__ = ()

    def relative_to(self, _: object) -> str:
        return self


def _slow(*_: object, **__: object) -> str:
    """Take a while, and find nothing."""
    time.sleep(0.35)
    return _Nothing()


@pytest.mark.gate_share(3)
@pytest.mark.parametrize(
    ("arguments", "slow"),
    [
        (["check", "single-gyre"], "pipeline.stages.region.endpoints_on_land"),
        (["nightly", "check"], "pipeline.nightly.cases.pairs_on_land"),
        (["clean"], "pipeline.cli.upkeep.freed"),
        (["warm"], "pipeline.cli.upkeep.warm"),
        (["doctor", "--offline"], "pipeline.cli.upkeep.examine"),
    ],
)
def test_a_slow_command_says_that_it_is_at_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], slow: str
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(terminal, "_PAUSE_S", 0.1)
    monkeypatch.setattr(slow, _slow)
    threads = threading.active_count()
    ended = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert ended.exit_code == 0
    assert 1 <= ended.stderr.count("still at work, after ") <= 4
    assert threading.active_count() == threads
