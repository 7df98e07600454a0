"""Runs a command with a deadline: the command may hang, and its caller must not."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

# Time to read a killed process's last output, s: with its whole session killed the pipes close at
# once.
_DRAIN_S = 5.0


@dataclass(frozen=True, slots=True)
class ProcessResult:
    """How a process ended: `exit_code` is None where it was killed at its deadline."""

    exit_code: int | None
    stdout: str
    stderr: str


def run_with_deadline(command: Sequence[str], stdin: str, deadline_s: float) -> ProcessResult:
    """Run a command with some input; kill it and its child processes at the deadline."""
    with subprocess.Popen(  # noqa: S603 - the command is this package's own
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
    ) as process:
        try:
            stdout, stderr = process.communicate(stdin, timeout=deadline_s)
        except subprocess.TimeoutExpired:
            _kill_session(process)
            stderr = ""
            with contextlib.suppress(subprocess.TimeoutExpired):
                _, stderr = process.communicate(timeout=_DRAIN_S)
            return ProcessResult(None, "", stderr)
        except BaseException:
            _kill_session(process)
            raise
        return ProcessResult(process.returncode, stdout, stderr)


def _kill_session(process: subprocess.Popen[str]) -> None:
    """Kill a process and all that it started in its session."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        process.kill()
    process.wait()
