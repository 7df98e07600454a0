"""Runs in processes of their own, to be stopped and killed."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from tests.conftest import ROOT
from tests.pipeline.small_plane import small_plane

QUICK = small_plane("quick")
_ISLANDS = ", ".join(
    f"[[{x}, {y}], [{x + 3}, {y}], [{x + 3}, {y + 3}], [{x}, {y + 3}]]"
    for x in range(8, 90, 12)
    for y in range(6, 94, 12)
)
# Takes many minutes to plan: 56 islands, each of which distinguishes classes, give thousands of
# them.
SLOW = f"""
schema_version = 1
name = "slow"
vessel = "paper-asv"
start = [1, 50]
goal = [99, 50]
[plane]
extent = [0, 0, 100, 100]
obstacles = [{_ISLANDS}]
[[seasons]]
name = "first"
uniform = {{ u = 0.1 }}
[[seasons]]
name = "second"
gyre = {{ amplitude = 0.5 }}
[planner]
classes = 9000
distinct_by = 0
"""


@contextlib.contextmanager
def started(
    *command: str, cwd: Path | None = None, variables: Mapping[str, str] | None = None
) -> Iterator[subprocess.Popen[str]]:
    """Start a command in a session of its own; kill what is left of it at the end."""
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(ROOT), **(variables or {})},
        start_new_session=True,
        # A shell starts what runs in the background with Ctrl-C ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509 - no threads
    ) as process:
        try:
            yield process
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


def renew(*arguments: str) -> tuple[str, ...]:
    """Return the command `renew` with its arguments."""
    return (sys.executable, "-m", "pipeline.cli.main", *arguments)


def wait_until(is_so: Callable[[], object], seconds: float = 120.0) -> None:
    """Wait until something is so; fail after the time."""
    deadline = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def descendants(pid: int) -> set[int]:
    """Return the ids of a process's living child processes, and of theirs."""
    parents = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            with contextlib.suppress(OSError):
                state = (folder / "stat").read_text().rpartition(")")[2].split()
                if state[0] != "Z":
                    parents[int(folder.name)] = int(state[1])
    found = {pid}
    while more := {one for one, parent in parents.items() if parent in found} - found:
        found |= more
    return found - {pid}


def ends_within(process_id: int, seconds: float) -> bool:
    """Whether a process ends in time; a zombie has ended."""
    status = Path(f"/proc/{process_id}/stat")
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        try:
            if status.read_text().rpartition(")")[2].split()[0] == "Z":
                return True
        except FileNotFoundError:
            return True
        time.sleep(0.1)
    return False
