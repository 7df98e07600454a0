"""Worker processes: limits, deaths, answers, and no orphans."""

import math
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from pipeline.errors import RequestError, StageError
from pipeline.machine.workers import LocalWorkers, Worker, WorkerEndedError, call_in_process, tell
from tests.pipeline.processes import ends_within, wait_until

# Starts a child, as a worker may, and sleeps.
_HANGING = """
import subprocess, sys, time
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
open({file!r}, "w").write(str(child.pid))
print("the last message")
time.sleep(60)
"""


def limit_of(least_s: float) -> float:
    """A limit, s, of a worker: under load the start of its process alone takes seconds."""
    begun = time.monotonic()
    call_in_process(math.sqrt, 4.0)
    return max(least_s, round(8 * (time.monotonic() - begun), 1))


class LibraryError(Exception):
    """An error that can't be unpickled: it asks for two arguments, and keeps one."""

    def __init__(self, what: str, why: str) -> None:
        super().__init__(f"{what}: {why}")


def fail(kind: str) -> None:
    """Fail in the way that is asked for."""
    if kind == "request":
        raise RequestError(["one fault", "another fault"])
    raise LibraryError("a library", "its reason")


def test_a_worker_is_killed_with_its_children_at_the_limit(tmp_path: Path) -> None:
    file, limit_s = tmp_path / "pid", limit_of(1.5)
    begun = time.monotonic()
    with pytest.raises(WorkerEndedError, match=rf"^took longer .* of {limit_s:g} s$") as caught:
        call_in_process(exec, _HANGING.format(file=str(file)), limit_s=limit_s)
    assert (caught.value.exit_code, caught.value.stderr) == (None, "the last message\n")
    assert 0.9 * limit_s < time.monotonic() - begun < limit_s + 10
    assert ends_within(int(file.read_text()), seconds=5), "its child process still runs"


def test_values_of_any_size_go_both_ways() -> None:
    many = [f"/a/path/of/some/length/{i:08}.nc" for i in range(20_000)]
    assert call_in_process(sorted, many, limit_s=30) == many


def test_errors_come_back_as_they_are_or_in_one_line() -> None:
    with Worker() as worker:
        worker.call(fail, "request")
        with pytest.raises(RequestError) as request:
            worker.result()
        assert request.value.faults == ("one fault", "another fault")
        worker.call(fail, "library")
        with pytest.raises(StageError, match="LibraryError: a library: its reason"):
            worker.result()


def test_what_is_told_comes_before_the_result() -> None:
    with Worker() as worker:
        worker.call(tell, {"event": "a"})
        worker.call(divmod, 7, 3)
        answers = [worker.answer() for _ in range(3)]
    assert answers == [("told", {"event": "a"}), ("returned", None), ("returned", (2, 1))]


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import os; os._exit(3)", "its process ended with code 3 (out of memory?)"),
        ("import os, sys; print('why', file=sys.stderr, flush=True); os._exit(3)", "code 3: why"),
        ("import os; os.kill(os.getpid(), 9)", "its process ended with code -9 (out of memory?)"),
    ],
)
def test_a_worker_that_ends_says_how_and_starts_again(code: str, said: str) -> None:
    with Worker() as worker:
        worker.call(exec, code)
        with pytest.raises(WorkerEndedError) as caught:
            worker.result()
        assert str(caught.value).endswith(said)
        worker.call(math.sqrt, 4.0)
        assert worker.result() == 2.0


def test_a_limit_of_data_refuses_memory() -> None:
    with Worker(data_bytes=200_000_000) as worker:
        worker.call(bytearray, 400_000_000)
        with pytest.raises(MemoryError):
            worker.result()


def test_a_worker_ends_with_its_program_however_that_ends(tmp_path: Path) -> None:
    file = tmp_path / "pid"
    script = (
        "from pipeline.machine.workers import call_in_process\n"
        f"call_in_process(exec, {_HANGING.format(file=str(file))!r})\n"
    )
    with subprocess.Popen([sys.executable, "-c", script]) as parent:
        wait_until(lambda: file.exists() and file.read_text(), 30)
        parent.kill()
    assert ends_within(int(file.read_text()), seconds=5)


@dataclass
class Job:
    """A task that does something in a worker."""

    name: str

    def make(self) -> str:
        """Do it."""
        if self.name == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.name == "hang":
            time.sleep(60)
        if self.name == "grow":
            held = bytearray(os.urandom(1 << 20)) * 400
            time.sleep(60)
            del held
        if self.name == "fail":
            raise ValueError("a reason")
        return self.name


@dataclass
class Jobs:
    """Some jobs, and how each ended."""

    waiting: list[Job]
    ends: dict[str, str] = field(default_factory=dict)

    def next_task(self, workers: int) -> Job | None:
        """Return the next job."""
        del workers
        return self.waiting.pop() if self.waiting else None

    def done(self, task: Job, result: str) -> None:
        """Keep a result."""
        self.ends[task.name] = f"done {result}"

    def died(self, task: Job, reason: str) -> None:
        """Keep a death."""
        self.ends[task.name] = reason

    def failed(self, task: Job, error: Exception) -> None:
        """Keep an error."""
        self.ends[task.name] = repr(error)


def test_a_task_that_dies_hangs_grows_or_fails_stops_no_other() -> None:
    names = ["a", "die", "b", "hang", "c", "grow", "d", "fail", "e"]
    jobs, limit_s = Jobs([Job(name) for name in names]), limit_of(3.0)
    with LocalWorkers(2, limit_s=limit_s, resident_bytes=300_000_000) as workers:
        workers.run(jobs)
        again = Jobs([Job("again")])
        workers.run(again)
    assert again.ends == {"again": "done again"}
    assert jobs.ends == {
        **{name: f"done {name}" for name in "abcde"},
        "die": "its process ended with code -9 (out of memory?)",
        "hang": f"took longer than the limit of {limit_s:g} s",
        "grow": "took more than the limit of 0.3 GB of memory",
        "fail": "ValueError('a reason')",
    }
