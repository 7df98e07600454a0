"""Ctrl-C and SIGTERM end a run within seconds, whatever its threads do."""

from __future__ import annotations

import json
import signal
import sys
import time
from pathlib import Path

import pytest

from tests.pipeline.processes import SLOW, renew, started

STOPPED = "stopped; finished stages are kept, run again to continue"


@pytest.mark.gate_share(1)
@pytest.mark.parametrize(
    ("number", "code", "seasons"), [(signal.SIGTERM, 143, 2), (signal.SIGINT, 130, 1)]
)
def test_a_planning_run_stops_promptly_and_another_can_start(
    tmp_path: Path, number: int, code: int, seasons: int
) -> None:
    """Two seasons are planned in threads, one in the main thread."""
    second = SLOW[SLOW.rindex("[[seasons]]") : SLOW.index("[planner]")]
    text = SLOW if seasons == 2 else SLOW.replace(second, "")
    (tmp_path / "slow.toml").write_text(text)
    command = renew(
        "run", str(tmp_path / "slow.toml"), "--output", str(tmp_path / "outputs"), "--json"
    )
    for _ in range(2):
        with started(*command) as process:
            assert process.stderr is not None
            begun = ({"stage": "plan", "event": "begun"}.items() <= json.loads(line).items()
                     for line in process.stderr)  # fmt: skip
            assert any(begun)
            time.sleep(0.5)  # among the classes by then
            assert process.poll() is None
            process.send_signal(number)
            # Three seconds at most by its own clock; other tests may have the processor.
            assert process.wait(20) == code
            assert process.stderr.read().splitlines()[-1] == STOPPED
        assert not list(tmp_path.glob("outputs/.artefacts/*/.*"))


def test_code_that_never_returns_is_ended_all_the_same() -> None:
    """The main thread waits in C for a lock that it holds itself, and sees no signal."""
    program = (
        "import ctypes\n"
        "from pipeline.cli.failures import ending_promptly\n"
        "with ending_promptly():\n"
        "    print('ready', flush=True)\n"
        "    mutex = ctypes.create_string_buffer(64)\n"
        "    lock = ctypes.CDLL(None).pthread_mutex_lock\n"
        "    lock(mutex), lock(mutex)\n"
    )
    with started(sys.executable, "-c", program) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.5)
        process.send_signal(signal.SIGTERM)
        assert process.wait(8) == 143
        assert process.stderr is not None
        assert process.stderr.read() == f"{STOPPED}\n"
