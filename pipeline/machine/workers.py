"""Worker processes: started, given functions to call, limited, killed, and started again.

A worker is an interpreter that calls one function after the other for this program, and sends back
what each returns, raises or tells meanwhile. Functions, their arguments and answers are pickled.
The process has a session of its own, and ends, with all that it has started, as soon as its pipe to
this program closes: however this program ends, no worker is left.

A user who plans in a downloaded folder does not mean to run the code in it: no interpreter started
here, or by one of them, looks for modules in the working directory. `multiprocessing`, and the
libraries on top of it, would besides import the user's main module once more in every process.
"""

import contextlib
import math
import multiprocessing
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Literal, Protocol

from pipeline.errors import StageError, one_line
from pipeline.machine.interpreters import SAFE_PATH, cores, seldom_collecting

_ROOT = Path(__file__).resolve().parents[2]
_MAIN = "from pipeline.machine.workers import main; main()"
# Number of bytes that are kept of what a worker writes to standard error, the last ones.
_KEPT_BYTES = 64 << 10
# Largest length of a worker's last line in a message, in characters.
_MAX_SHOWN = 200
# Time for a worker whose pipe has closed to end, and to close its standard error, s.
_END_S = 5.0
# Time between two checks of the limits and of the caller, s.
_PAUSE_S = 0.05

AnswerKind = Literal["told", "returned", "raised"]


class WorkerEndedError(Exception):
    """A worker ended during a call.

    `exit_code` is negative for a signal, and None where the worker was killed after `limit_s`
    seconds; `stderr` is the end of what it wrote to standard error.
    """

    def __init__(self, exit_code: int | None, stderr: str, limit_s: float = math.inf) -> None:
        super().__init__(exit_code, stderr, limit_s)
        self.exit_code, self.stderr, self.limit_s = exit_code, stderr, limit_s

    def __str__(self) -> str:
        """Say which limit it exceeded, or with which code it ended and the last line it wrote."""
        if self.exit_code is None:
            return f"took longer than the limit of {self.limit_s:g} s"
        last = next(filter(None, map(str.strip, reversed(self.stderr.split("\n")))), "")
        words = f": {last[:_MAX_SHOWN]}" if last else " (out of memory?)"
        return f"its process ended with code {self.exit_code}{words}"


class Worker(contextlib.AbstractContextManager["Worker"]):
    """A process that calls functions, started at the first call; inside `with` it ends with it.

    It gets no more memory above `data_bytes` of data, without a limit if 0. `variables` are in its
    environment, beside those of this process.
    """

    def __init__(self, data_bytes: int = 0, variables: Mapping[str, str] | None = None) -> None:
        self._data_bytes, self._variables = data_bytes, variables or {}
        self._process: subprocess.Popen[bytes] | None = None
        self._pipe: Connection[Any, Any] | None = None
        self._stderr = bytearray()
        self._reading = threading.Thread()

    def __exit__(self, *_: object) -> None:
        """Kill the process."""
        self.kill()

    @property
    def is_running(self) -> bool:
        """Whether the process lives."""
        return self._process is not None and self._process.poll() is None

    @property
    def resident_bytes(self) -> int:
        """Memory that the process holds; 0 where the system does not tell it."""
        try:
            pages = Path(f"/proc/{self._process.pid if self._process else 0}/statm").read_text()
            return int(pages.split()[1]) * os.sysconf("SC_PAGE_SIZE")
        except (OSError, IndexError):  # the file of a process that ends is empty
            return 0

    @property
    def pipe(self) -> "Connection[Any, Any]":
        """The pipe, which is readable once an answer waits or the process has ended."""
        if self._pipe is None:
            raise ValueError("a worker has no pipe before its first call")
        return self._pipe

    def call(self, function: Callable[..., object], *arguments: object) -> None:
        """Have a function called after those before it; start the process unless it runs.

        Raises StageError if the system can't start a process.
        """
        if not self.is_running:
            self._start()
        with contextlib.suppress(OSError):  # it has ended, which `answer` says
            self.pipe.send((function, arguments))

    def answer(self) -> tuple[AnswerKind, Any]:
        """Wait for the next answer: what a call has told, or has returned or raised at its end.

        Raises WorkerEndedError if the process has ended.
        """
        try:
            kind, value = self.pipe.recv()
        except (EOFError, OSError):
            raise self._ended() from None
        return kind, value

    def result(self, limit_s: float = math.inf) -> Any:  # noqa: ANN401 - that of any function
        """Wait for what the call returns, and return it, or raise its error.

        Raises WorkerEndedError if the process has ended, or was killed at the limit.
        """
        deadline = time.monotonic() + limit_s
        while self.pipe.poll(
            None if math.isinf(limit_s) else max(0.0, deadline - time.monotonic())
        ):
            kind, value = self.answer()
            if kind == "raised":
                raise value
            if kind == "returned":
                return value
        raise WorkerEndedError(None, self.kill(), limit_s)

    def kill(self) -> str:
        """Kill the process and all that it started; return the last that it wrote."""
        process, self._process = self._process, None
        if process is None:
            return ""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return self._last_words()

    def _start(self) -> None:
        ours, theirs = multiprocessing.Pipe()
        entries = [str(_ROOT), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
        # An empty entry means the working directory, and is left out.
        path = os.pathsep.join(filter(None, entries))
        try:
            self._process = subprocess.Popen(  # noqa: S603 - this interpreter
                [sys.executable, "-P", "-c", _MAIN, str(theirs.fileno()), str(self._data_bytes)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                env={**os.environ, **self._variables, "PYTHONPATH": path, SAFE_PATH: "1"},
                pass_fds=[theirs.fileno()],
                start_new_session=True,  # killed together with all that it started
            )
        except OSError as error:
            raise StageError(
                f"can't start a process ({error}); check this machine's free memory"
            ) from error
        finally:
            theirs.close()
        self._pipe, self._stderr = ours, bytearray()
        self._reading = threading.Thread(
            target=_keep_last, args=(self._process.stderr, self._stderr), daemon=True
        )
        self._reading.start()

    def _ended(self) -> WorkerEndedError:
        """Return the error of a process whose pipe has closed, and end what it has started."""
        code = None
        if self._process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                code = self._process.wait(_END_S)
        return WorkerEndedError(code, self.kill() or self._last_words())

    def _last_words(self) -> str:
        """Return the last that the process wrote to standard error, after its end."""
        self._reading.join(_END_S)
        return self._stderr.decode(errors="replace")


def _keep_last(stream: Any, kept: bytearray) -> None:  # noqa: ANN401 - a pipe of subprocess
    """Read a stream to its end, and keep its last bytes."""
    with stream:
        while chunk := stream.read1():
            kept += chunk
            del kept[:-_KEPT_BYTES]


def call_in_process(
    function: Callable[..., object], *arguments: object, limit_s: float = math.inf
) -> Any:  # noqa: ANN401 - that of any function
    """Call a function in a process of its own; return what it returns, or raise its error.

    Raises WorkerEndedError if the process ended, or was killed after the limit.
    """
    with Worker() as worker:
        worker.call(function, *arguments)
        return worker.result(limit_s)


# --- tasks on several workers -----------------------------------------------------------------


class WorkerTask(Protocol):
    """A task for a worker: a value that can be pickled."""

    def make(self) -> Any:  # noqa: ANN401 - each kind of task has its own
        """Do the task."""
        ...


class Work(Protocol):
    """A queue of tasks that are handed out one at a time; it receives results and failures."""

    def next_task(self, workers: int) -> WorkerTask | None:
        """Return the next task, or None if none is ready; one may be ready later."""
        ...

    def done(self, task: Any, result: Any) -> None:  # noqa: ANN401 - as `WorkerTask.make`
        """Receive a task's result."""
        ...

    def died(self, task: Any, reason: str) -> None:  # noqa: ANN401 - any task
        """Handle a task during which its worker ended."""
        ...

    def failed(self, task: Any, error: Exception) -> None:  # noqa: ANN401 - any task
        """Handle a task that failed, or raise its error."""
        ...


class LocalWorkers(contextlib.AbstractContextManager["LocalWorkers"]):
    """Workers of this machine, for tasks; the processes stay from one `run` to the next.

    A process is killed after the time limit of a task, `limit_s`, and if it has more memory than
    `resident_bytes`; 0: no limit. `variables` are as those of `Worker`.
    """

    def __init__(
        self,
        count: int,
        *,
        limit_s: float = math.inf,
        resident_bytes: int = 0,
        variables: Mapping[str, str] | None = None,
    ) -> None:
        self._idle = [Worker(variables=variables) for _ in range(count)]
        self._count, self._limit_s, self._resident_bytes = count, limit_s, resident_bytes
        self._at_work: dict[Worker, tuple[WorkerTask, float]] = {}

    def __exit__(self, *_: object) -> None:
        """Kill all processes."""
        for worker in (*self._idle, *self._at_work):
            worker.kill()

    def run(self, work: Work, check: Callable[[], None] = lambda: None) -> None:
        """Hand out all tasks; `check` is called regularly, and may end the work with an error."""
        while True:
            while self._idle and (task := work.next_task(self._count)) is not None:
                worker = self._idle.pop()
                self._at_work[worker] = task, time.monotonic() + self._limit_s
                worker.call(make_task, task)
            if not self._at_work:
                return
            wait([worker.pipe for worker in self._at_work], _PAUSE_S)
            for worker, (task, deadline) in tuple(self._at_work.items()):
                self._look_at(worker, task, deadline, work)
            check()

    def _look_at(self, worker: Worker, task: WorkerTask, deadline: float, work: Work) -> None:
        """Report a task that has ended; kill a worker that is over its limits."""
        if worker.pipe.poll():
            try:
                kind, value = worker.answer()
            except WorkerEndedError as ended:
                reason = str(ended)
            else:
                if kind != "told":
                    self._idle.append(worker)
                    del self._at_work[worker]
                    (work.failed if kind == "raised" else work.done)(task, value)
                return
        elif time.monotonic() > deadline:
            reason = str(WorkerEndedError(None, "", self._limit_s))
        elif 0 < self._resident_bytes < worker.resident_bytes:
            reason = f"took more than the limit of {self._resident_bytes / 1e9:g} GB of memory"
        else:
            return
        worker.kill()
        self._idle.append(worker)
        del self._at_work[worker]
        work.died(task, reason)


def make_task(task: WorkerTask) -> Any:  # noqa: ANN401 - as `WorkerTask.make`
    """Do a task, in a worker."""
    return task.make()


# --- in the process of a worker ---------------------------------------------------------------


# The pipe by which this process answers, if it is a worker, in a list of one.
_pipe: "list[Connection[Any, Any]]" = []
# The calls that wait in this worker.
_calls: "queue.SimpleQueue[bytes]" = queue.SimpleQueue()
_answering = threading.Lock()


def tell(value: object) -> None:
    """Send a value to the program that the call in this worker is for, before the call returns."""
    _answer("told", value)


def is_call_waiting() -> bool:
    """Whether this worker already has another call to make after the present one."""
    return not _calls.empty()


def main() -> None:
    """Make the calls that come through the pipe whose number is the first argument."""
    number, data_bytes = map(int, sys.argv[1:])
    if data_bytes:
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (data_bytes, data_bytes))
    sys.stdout = sys.stderr  # which is kept for messages
    _pipe.append(Connection(number))
    threading.Thread(target=_take_calls, daemon=True).start()
    with seldom_collecting():  # at its usual pace it takes a tenth of a compilation
        while True:
            _make(_calls.get())


def _take_calls() -> None:
    """Take calls; end this process, and all that it started, when there are no more to come."""
    with contextlib.suppress(EOFError, OSError):
        while True:
            _calls.put(_pipe[0].recv_bytes())
    os.killpg(os.getpgid(0), signal.SIGKILL)


def _make(call: bytes) -> None:
    """Make a call, and send what it returns or raises."""
    try:
        function, arguments = pickle.loads(call)  # noqa: S301 - from the program that started this
        _answer("returned", function(*arguments))
    except Exception as error:  # noqa: BLE001 - raised again in the program that called
        try:
            pickle.loads(pickle.dumps(error))  # noqa: S301 - just made
        except Exception:  # noqa: BLE001 - an error of a library need not be made for this
            _answer("raised", StageError(one_line(error)))
        else:
            _answer("raised", error)


def _answer(kind: AnswerKind, value: object) -> None:
    """Send an answer; in a process that is no worker, do nothing."""
    if _pipe:
        with _answering:
            _pipe[0].send((kind, value))


# --- compilation ahead ------------------------------------------------------------------------


@contextlib.contextmanager
def first_compilation() -> Iterator[Callable[[], None]]:
    """Start to compile the planner's kernels if nothing is compiled yet.

    Yields a function that waits for the end. If a process fails or is killed, kernels that it did
    not compile are compiled when they are called. With a single core, or without a lasting cache,
    no process is started.
    """
    from renew._compiled import is_cold

    with contextlib.ExitStack() as held:
        halves = [0, 1] if cores() > 1 and is_cold() else []
        workers = [held.enter_context(Worker()) for _ in halves]
        for worker, half in zip(workers, halves, strict=True):
            worker.call(compile_half, half)

        def finish() -> None:
            for worker in workers:
                with contextlib.suppress(Exception):
                    worker.result()

        yield finish


def compile_half(half: int) -> None:
    """Compile half of the kernels, 0 or 1, in a worker: the import alone takes seconds."""
    from renew.warming import rehearse_half

    rehearse_half(half)
