"""The plans of a server: asked for, waiting, at work, and ended; they outlive the page."""

import asyncio
import contextlib
import json
import time
import uuid
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pipeline.errors import PipelineError, StageError
from pipeline.serve.request import PlanRequest, command_line
from pipeline.serve.worker import ServingWorker

State = Literal["waiting", "running", "done", "failed", "cancelled"]

# Largest number of plans that wait: at the usual time limit the last waits up to 80 minutes.
_MAX_WAITING = 8
# Largest number of plans that are kept, oldest first out.
_MAX_KEPT = 50
# Largest number of notes that are kept of a plan.
_MAX_NOTES = 50
# Largest number of draft routes that are kept of a plan.
_MAX_DRAFTS = 40
# Memory, bytes, above which a worker that has planned is replaced by the spare one.
_MAX_IDLE_BYTES = 700_000_000
_LIVE = {"waiting", "running"}
# Name of the work that prepares a voyage, beside the ids of plans.
_PREPARING = "preparing"


class FullQueueError(StageError):
    """So many plans wait that no other is taken."""


@dataclass
class AskedPlan:
    """A plan: what was asked, and what is known of it so far.

    `stages` are those begun, in order; `detail` is what happens in the last. `drafts` are the ways
    found while it is planned, and `sides` its routes, before its `files` are written.
    """

    request: PlanRequest
    options: Mapping[str, Any]
    id: str = field(default_factory=lambda: uuid.uuid4().hex)
    state: State = "waiting"
    name: str = ""
    stages: list[str] = field(default_factory=list)
    detail: str = ""
    notes: list[str] = field(default_factory=list)
    drafts: list[list[list[float]]] = field(default_factory=list)
    sides: dict[str, Any] | None = None
    faults: list[str] = field(default_factory=list)
    directory: Path | None = None
    files: list[str] = field(default_factory=list)
    asked_at: float = field(default_factory=time.time)
    begun: float = 0.0
    seconds: float = 0.0
    version: int = 0

    def take(self, event: Mapping[str, Any]) -> None:
        """Take in an event of the worker."""
        self.version += 1
        self.seconds = time.monotonic() - self.begun
        match event["event"]:
            case "scenario":
                self.name = event["name"]
            case "note":
                self._note(event["detail"])
            case "progress":
                self._progress(event)
            case "step":
                self.detail = event["detail"]
                if event["line"] is not None and len(self.drafts) < _MAX_DRAFTS:
                    self.drafts.append(event["line"])
            case "sides":
                self.sides = {key: value for key, value in event.items() if key != "event"}
            case "failed":
                self.fail(event["faults"])
            case "done":
                self.directory, self.files = Path(event["directory"]), event["files"]
                self.faults, self.state = event["failures"], "done"

    def fail(self, faults: list[str], state: State = "failed") -> None:
        """End the plan without results."""
        self.version += 1
        self.state, self.faults = state, faults

    def _progress(self, event: Mapping[str, Any]) -> None:
        """Take in an event of a stage."""
        if event["status"] == "note":
            self._note(event["detail"])
        elif event["status"] == "begun":
            if event["stage"] == "fetch":  # the first one: the region is widened
                self.stages.clear()
                self.drafts.clear()
            self.stages.append(event["stage"])
            self.detail = ""
        elif event["status"] == "part":
            self.detail = event["detail"]

    def _note(self, note: str) -> None:
        """Keep a note, once."""
        if note not in self.notes and len(self.notes) < _MAX_NOTES:
            self.notes.append(note)


class Plans:
    """Plans voyages in some workers, in the order in which they were asked for."""

    def __init__(
        self, output: Path, *, offline: bool, workers: int, limit_s: float, memory_bytes: int
    ) -> None:
        self.output, self._offline, self._limit_s = output, offline, limit_s
        self._pairs = [
            (ServingWorker(memory_bytes), ServingWorker(memory_bytes)) for _ in range(workers)
        ]
        self._plans: dict[str, AskedPlan] = {}
        # None asks for the voyage in `_ahead` to be prepared.
        self._waiting: asyncio.Queue[AskedPlan | None] = asyncio.Queue()
        self._ahead: Mapping[str, Any] | None = None
        self._work: dict[str, asyncio.Task[None]] = {}
        self._loops: list[asyncio.Task[None]] = []

    @contextlib.asynccontextmanager
    async def at_work(self) -> AsyncIterator[None]:
        """Take plans inside the `with` block; kill all workers at its end."""
        self._loops = [asyncio.create_task(self._serve(*pair)) for pair in self._pairs]
        try:
            yield
        finally:
            for task in (*self._loops, *self._work.values()):
                task.cancel()
            for worker in (worker for pair in self._pairs for worker in pair):
                worker.kill()

    def add(self, request: PlanRequest, options: Mapping[str, Any]) -> AskedPlan:
        """Return a new plan, or that of the same options unless it failed.

        Raises
        ------
        FullQueueError
            Too many plans wait.
        """
        same = json.dumps(options, sort_keys=True)
        for known in self._plans.values():
            if (
                known.state in {*_LIVE, "done"}
                and json.dumps(known.options, sort_keys=True) == same
            ):
                return known
        if sum(one.state == "waiting" for one in self._plans.values()) >= _MAX_WAITING:
            raise FullQueueError(
                f"{_MAX_WAITING} plans wait already; wait until one has ended, or cancel one"
            )
        plan = AskedPlan(request, options)
        ends = ("start", "goal")
        if self._ahead is not None and any(self._ahead[one] != options[one] for one in ends):
            self._ahead = None  # the voyage that is prepared is not the one that is planned
            if (task := self._work.pop(_PREPARING, None)) is not None:
                task.cancel()
        self._plans[plan.id] = plan
        self._waiting.put_nowait(plan)
        # The oldest plans that ended are forgotten; their results stay on the disk.
        ended = [one.id for one in self._plans.values() if one.state not in _LIVE]
        for identity in ended[: max(0, len(self._plans) - _MAX_KEPT)]:
            del self._plans[identity]
        return plan

    def prepare(self, options: Mapping[str, Any]) -> None:
        """Make a voyage's land and currents ready, unless a worker has something else to do."""
        if self._ahead is None and not any(one.state in _LIVE for one in self._plans.values()):
            self._ahead = options
            self._waiting.put_nowait(None)

    def get(self, identity: str) -> AskedPlan | None:
        """Return a plan by its id; None if it is not known."""
        return self._plans.get(identity)

    def all(self) -> tuple[AskedPlan, ...]:
        """Return all plans that are kept, the latest first."""
        return tuple(reversed(self._plans.values()))

    def command(self, plan: AskedPlan) -> str:
        """Return the command line of a plan; empty until its name is known."""
        if not plan.name:
            return ""
        return command_line(plan.options, plan.name, self.output, offline=self._offline)

    def cancel(self, plan: AskedPlan) -> None:
        """Cancel a plan that waits or is at work; one that ended stays as it is."""
        if plan.state in _LIVE:
            plan.fail([], "cancelled")
            if (task := self._work.pop(plan.id, None)) is not None:
                task.cancel()

    async def _serve(self, worker: ServingWorker, spare: ServingWorker) -> None:
        """Plan with a worker, one plan after the other; the spare one takes over if it was killed.

        So the plan after a cancelled one begins at once, and only one of the two holds a chart.
        """
        await self._started(worker)
        starting = asyncio.create_task(self._started(spare))
        while True:
            plan = await self._waiting.get()
            if self._ahead is None if plan is None else plan.state != "waiting":
                continue
            job = self._prepare(worker) if plan is None else self._plan(worker, plan)
            name = _PREPARING if plan is None else plan.id
            work = self._work[name] = asyncio.create_task(job)
            await asyncio.wait([work])
            self._work.pop(name, None)
            if worker.memory_bytes > _MAX_IDLE_BYTES:
                worker.kill()
            if not worker.is_running:
                worker, spare = spare, worker
                await starting
                starting = asyncio.create_task(self._started(spare))

    async def _started(self, worker: ServingWorker) -> None:
        """Start a worker; if that fails, the plan that needs it tries again, and tells why."""
        with contextlib.suppress(PipelineError):
            await worker.start()

    async def _plan(self, worker: ServingWorker, plan: AskedPlan) -> None:
        """Plan with a worker; whatever happens, the plan ends."""
        plan.state, plan.begun = "running", time.monotonic()
        plan.version += 1
        try:
            async for event in worker.plan(self._asked(plan.options), self._limit_s):
                plan.take(event)
        except PipelineError as error:
            plan.fail(str(error).splitlines())
        except asyncio.CancelledError:
            worker.kill()
            raise
        finally:
            if plan.state in _LIVE:
                plan.fail(["the plan ended unexpectedly; ask for it again"])

    async def _prepare(self, worker: ServingWorker) -> None:
        """Prepare a voyage with a worker."""
        assert self._ahead is not None  # noqa: S101 - asked for
        try:
            async for _ in worker.plan(self._asked(self._ahead, prepares=True), self._limit_s):
                pass
        except PipelineError:
            pass  # the plan tells it
        except asyncio.CancelledError:
            worker.kill()
            raise
        self._ahead = None

    def _asked(self, options: Mapping[str, Any], *, prepares: bool = False) -> dict[str, Any]:
        """Return what a worker is asked."""
        where = {"output": str(self.output), "offline": self._offline}
        return {"options": options, "prepares": prepares, **where}
