"""Plan seasons with a time limit, each in a separate process that is killed after the limit.

Run as a program, this module plans one season, whose pickled task it reads from standard input.
"""

import contextlib
import json
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import IO

from pipeline.machine.interpreters import python_command, python_environment
from pipeline.stages.seasons.task import SeasonTask, Status, plan_and_evaluate, status_of

# Time between two checks whether processes have ended, s.
_PAUSE_S = 0.05
# Time between two checks of a process whether its parent still runs, s.
_PARENT_S = 0.5
_MODULE = "pipeline.stages.seasons.process"
# Largest length of a process's last output in a message, in characters.
_MAX_SHOWN = 200


class SeasonProcess:
    """A separate process that runs a season's task; it has a deadline if the task has a limit."""

    def __init__(self, task: SeasonTask) -> None:
        self._task = task
        self._deadline = time.monotonic() + (task.limit_s or float("inf"))
        # Files, because a pipe would have to be read while the process runs.
        self._output = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `status`
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - as above
        self._process = subprocess.Popen(  # noqa: S603 - this very module
            python_command("-m", _MODULE, str(os.getpid())),
            stdin=subprocess.PIPE,
            stdout=self._output,
            stderr=self._errors,
            env=python_environment(),
            start_new_session=True,
        )
        with contextlib.suppress(BrokenPipeError), self._stdin() as stdin:
            stdin.write(pickle.dumps(task))

    def _stdin(self) -> IO[bytes]:
        """Return the pipe to the process's standard input."""
        if self._process.stdin is None:
            raise ValueError("started without a pipe")
        return self._process.stdin

    def status(self) -> Status | None:
        """Return how the task ended, or None while it runs; after its deadline, kill it."""
        if self._process.poll() is None:
            if time.monotonic() < self._deadline:
                return None
            self.kill()
            reason = f"took longer than the limit of {self._task.limit_s:g} s"
            return Status(self._task.season, reason, crashed=True)
        with self._output as output, self._errors as errors:
            output.seek(0)
            errors.seek(0)
            words = errors.read().decode(errors="replace").split("\n")
            try:
                failure, crashed = json.loads(output.read())
                return Status(self._task.season, str(failure), bool(crashed))
            except ValueError:
                last = next((line.strip() for line in reversed(words) if line.strip()), "")
                reason = f"its process ended with code {self._process.returncode}"
                return Status(
                    self._task.season,
                    f"{reason}: {last[:_MAX_SHOWN]}" if last else f"{reason} (out of memory?)",
                    crashed=True,
                )

    def kill(self) -> None:
        """Kill the process and all processes that it started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._output.close()
        self._errors.close()


def run_in_processes(
    tasks: Sequence[SeasonTask], count: int, on_status: Callable[[Status], None]
) -> None:
    """Run tasks, at most `count` at a time; an exception or interruption kills all processes."""
    waiting, working = deque(tasks), list[SeasonProcess]()
    try:
        while waiting or working:
            while waiting and len(working) < count:
                working.append(SeasonProcess(waiting.popleft()))
            for process in tuple(working):
                status = process.status()
                if status is not None:
                    working.remove(process)
                    on_status(status)
            time.sleep(_PAUSE_S)
    finally:
        for process in working:
            process.kill()


def _end_with(parent: int) -> None:
    """End this process after its parent has ended, for whatever reason."""
    while os.getppid() == parent:
        time.sleep(_PARENT_S)
    os._exit(1)


def _main() -> None:
    """Plan one season; write its failure, and whether the task crashed, to standard output."""
    threading.Thread(target=_end_with, args=(int(sys.argv[1]),), daemon=True).start()
    task = pickle.load(sys.stdin.buffer)  # noqa: S301 - written by the process that started this
    answer, sys.stdout = sys.stdout, sys.stderr  # keeps libraries' output out of the answer
    status = status_of(task.season, partial(plan_and_evaluate, task))
    answer.write(json.dumps([status.failure, status.crashed]))


if __name__ == "__main__":
    _main()
