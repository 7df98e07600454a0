"""The plans of a server, and what a page or a program may ask for.

A request has the options of `renew go`, but never a path: files that it gives are streamed to the
disk, and only workers open them. Plans wait, are at work, or have ended; they outlive the page, and
those that ended outlive the server.
"""

import asyncio
import contextlib
import hashlib
import json
import re
import shlex
import time
import uuid
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, create_model

from pipeline.errors import Faults, PipelineError, RequestError, refuse_any
from pipeline.machine.files import write_whole, writing
from pipeline.scenario import catalogue
from pipeline.serve.worker import ServingWorker
from pipeline.voyage.request import VoyageRequest
from pipeline.voyage.table import Option, help_text, options, spelling

MAX_FILE_BYTES = 500_000_000
"""Largest file that is taken; larger ones are given to `renew go` by their path."""
# Largest size of all files that a server takes, bytes.
_MAX_ALL_BYTES = 4_000_000_000
# A name without any part of a path, and with nothing that a shell or a terminal would act on.
_NAME = re.compile(r"\w[\w()+,=@. -]{0,99}", re.ASCII)
# Length of a file's id: so many hexadecimal digits of the SHA-256 of its content and name.
_ID_DIGITS = 16
# Largest number of drawn areas: more are given to the command line as a file.
_MAX_AREAS = 50
# Largest number of corners of all drawn areas.
_MAX_CORNERS = 5_000
ASKED = tuple(option for option in options(VoyageRequest) if not option.is_of_run)
"""The options that a page may ask for."""

_Text = Annotated[str, Field(max_length=200)]
# A name of the catalogue, or what the server called a file that it was given.
_Source = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
_Corner = tuple[Annotated[float, Field(ge=-360, le=360)], Annotated[float, Field(ge=-90, le=90)]]


class NotTakenError(PipelineError):
    """A request that the server does not take, with the status of the answer."""

    def __init__(self, text: str, status: int) -> None:
        super().__init__(text)
        self.status = status


class GivenFiles:
    """The files that a server was given, each in a folder below `folder` whose name is its id.

    The same content with the same name is the same file, today and tomorrow.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        # Also those that an earlier server was given: a plan of that time names them.
        self._files = {path.parent.name: path for path in folder.glob(f"{'?' * _ID_DIGITS}/*")}
        self._bytes = 0  # of all files that this server was given

    def path(self, name: str, key: str) -> Path:
        """Return the path of a file by its id; RequestError if the server was not given it.

        `key` says who names it.
        """
        if name not in self._files:
            raise RequestError(
                f"{key} = {name!r} is neither in the catalogue nor a file that this server was "
                "given; send the file to /api/files first, and name it by its id"
            )
        return self._files[name]

    def keep(self, content: bytes, name: str) -> Path:
        """Write a file that the server made itself; return its path."""
        path = self._path_of(hashlib.sha256(content), name)
        with writing(self._folder):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, content.decode())
        return self._files.setdefault(path.parent.name, path)

    async def receive(self, name: str, chunks: AsyncIterator[bytes]) -> Path:
        """Write a file to the disk as it comes; return its path.

        Raises RequestError if the name has parts of a path, or the file is empty; NotTakenError if
        it, or all files together, are too large; StageError if the disk refuses. Nothing is left of
        it then.
        """
        if not _NAME.fullmatch(name):
            raise RequestError(
                f"name = {name[:100]!r} can't be the name of a file here: use up to 100 letters, "
                "digits, spaces and . _ - ( ) + , = @, no folder, and begin with a letter or digit"
            )
        unfinished = self._folder / f"{uuid.uuid4().hex}.part"
        try:
            with writing(self._folder):
                path = await self._written(unfinished, name, chunks)
                path.parent.mkdir(parents=True, exist_ok=True)
                unfinished.replace(path)
        finally:
            with contextlib.suppress(OSError):
                unfinished.unlink(missing_ok=True)
        return self._files.setdefault(path.parent.name, path)

    async def _written(self, unfinished: Path, name: str, chunks: AsyncIterator[bytes]) -> Path:
        """Write an unfinished file; return the path that it gets when it is complete."""
        digest, size = hashlib.sha256(), 0
        unfinished.parent.mkdir(parents=True, exist_ok=True)
        with unfinished.open("xb") as file:
            async for chunk in chunks:
                size += len(chunk)
                if size > MAX_FILE_BYTES:
                    raise NotTakenError(too_large(name), 413)
                if self._bytes + size > _MAX_ALL_BYTES:
                    raise NotTakenError(
                        f"{name}: no room is left; this server takes {_MAX_ALL_BYTES:,} bytes in "
                        "all; start it again",
                        413,
                    )
                digest.update(chunk)
                file.write(chunk)
        if not size:
            raise RequestError(f"{name} is empty; give a file with content")
        path = self._path_of(digest, name)
        self._bytes += size if path.parent.name not in self._files else 0
        return path

    def _path_of(self, digest: "hashlib._Hash", name: str) -> Path:
        """Return the path of a file, whose id depends on its content and its name."""
        digest.update(b"\0" + name.encode())
        return self._folder / digest.hexdigest()[:_ID_DIGITS] / name


def too_large(name: str) -> str:
    """Say that a file is too large."""
    return (
        f"{name} is larger than {MAX_FILE_BYTES:,} bytes; cut it to the region, or give its path "
        "to `renew go` on the command line"
    )


class _DrawnAreas(BaseModel):
    """A voyage: each key is an option of `renew go`, as text.

    Files are named by the `id` that the server gave them; a path is refused.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    areas: tuple[Annotated[tuple[_Corner, ...], Field(min_length=3)], ...] = Field(
        default=(), max_length=_MAX_AREAS, description="Shut areas: rings of lon, lat, degrees."
    )
    route: _Source | None = Field(
        default=None, description="A route in GPX, RTZ or GeoJSON, to be checked from end to end."
    )

    def options(self, files: GivenFiles) -> dict[str, Any]:
        """Return the options by their names, with the paths of files in place of their ids.

        Raises RequestError with a line for each vessel, source or file that is not known.
        """
        faults = Faults()
        if sum(map(len, self.areas)) > _MAX_CORNERS:
            faults.lines.append(
                f"areas have more than {_MAX_CORNERS:,} corners; give them as a file, in avoid"
            )

        def named(option: Option, text: str) -> str:
            if text in known[option.key]:
                return text
            if option.key == "vessel":
                faults.lines.append(
                    f"vessel = {text!r} is not in the catalogue ({', '.join(known[option.key])}); "
                    "choose one, or give speed, length and turning_circle"
                )
                return ""
            # Facts about a file may stand behind it: "ID,radius=50m".
            one, comma, facts = text.partition("," if option.kind == "file" else "\0")
            path = faults.collect(lambda: str(files.path(one, option.key)))
            return f"{path}{comma}{facts}" if path else ""

        known = {one.key: catalogue.choices(one.section) if one.section else () for one in ASKED}
        given: dict[str, Any] = {}
        for option in ASKED:
            value = getattr(self, option.key)
            if value and (option.kind in {"source", "file"} or option.section):
                texts = value if option.most else [value]
                paths = [named(option, text) for text in texts]
                value = paths if option.most else paths[0]
            given[option.key] = list(value) if option.most else value
        if self.route:
            given["route"] = faults.collect(lambda: str(files.path(str(self.route), "route")))
        refuse_any(faults.lines)
        if self.areas:
            given["avoid"].append(str(files.keep(_geojson(self.areas), "areas.geojson")))
        return given


def _field(option: Option) -> tuple[Any, Any]:
    """Return the type and the field of an option in JSON."""
    kind: Any = _Source if option.kind in {"source", "file"} else _Text
    text = help_text(option, spelling(VoyageRequest, "page"))
    if option.kind == "flag":
        return bool, Field(default=False, description=text)
    if option.most:
        # A single value need not be in a list.
        several = Annotated[
            tuple[kind, ...], BeforeValidator(lambda one: [one] if isinstance(one, str) else one)
        ]
        return several, Field(default=(), max_length=option.most, description=text)
    if option.is_required:
        return kind, Field(description=text, examples=[option.example])
    if option.kind == "file":
        return kind | None, Field(default=None, description=text)
    return kind, Field(default="", description=text)


if TYPE_CHECKING:
    PlanRequest = _DrawnAreas
else:
    PlanRequest = create_model(
        "PlanRequest",
        __base__=_DrawnAreas,
        __doc__=_DrawnAreas.__doc__,
        **{option.key: _field(option) for option in ASKED},
    )


def _geojson(areas: tuple[tuple[_Corner, ...], ...]) -> bytes:
    """Return drawn areas as a file that `renew go --avoid` reads."""
    features = [
        {
            "type": "Feature",
            "properties": {"name": f"drawn area {number}"},
            "geometry": {"type": "Polygon", "coordinates": [[*ring, ring[0]]]},
        }
        for number, ring in enumerate(areas, start=1)
    ]
    return json.dumps({"type": "FeatureCollection", "features": features}).encode()


def command_line(given: Mapping[str, Any], name: str, output: Path, *, offline: bool) -> str:
    """Return the command that plans the same, to be typed in a shell."""
    asked = {**given, "name": name, "output": output, "offline": offline}
    typed = [
        word
        for option in options(VoyageRequest)
        if option.group
        for word in option.words(asked.get(option.key))
    ]
    # After "--" nothing is an option: a longitude may begin with a minus.
    return shlex.join(["renew", "go", *typed, "--", given["start"], given["goal"]])


# --- plans ---

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
# Folder, inside the output folder, of the plans that ended.
_KEPT = ".plans"
# What a file there has of a plan, besides its request.
_RECORDED = (
    *("id", "state", "name", "title", "options", "notes", "sides", "maps", "faults", "files"),
    *("asked_at", "seconds"),
)


@dataclass
class AskedPlan:
    """A plan: its request, and how far it has come.

    `title` is the user's name for it. `stages` are those begun, in order; `detail` is what happens
    in the last. `drafts` are the ways found while it is planned, and `sides` its routes, before its
    `files` are written; they come again if the region is widened, and `maps` counts what the map
    draws of them. `is_found` is set once only its files are to be written, or it ended.
    """

    request: PlanRequest
    options: Mapping[str, Any]
    id: str = field(default_factory=lambda: uuid.uuid4().hex)
    state: State = "waiting"
    name: str = ""
    title: str = ""
    stages: list[str] = field(default_factory=list)
    detail: str = ""
    notes: list[str] = field(default_factory=list)
    drafts: list[list[list[float]]] = field(default_factory=list)
    sides: dict[str, Any] | None = None
    maps: int = 0
    faults: list[str] = field(default_factory=list)
    directory: Path | None = None
    files: list[str] = field(default_factory=list)
    asked_at: float = field(default_factory=time.time)
    begun: float = 0.0
    seconds: float = 0.0
    version: int = 0
    is_found: asyncio.Event = field(default_factory=asyncio.Event)

    def kept(self) -> dict[str, Any]:
        """Return what is kept of it on the disk once it ended."""
        values = {name: getattr(self, name) for name in _RECORDED}
        return {**values, "request": self.request.model_dump(mode="json")}

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
        self.is_found.set()

    def _progress(self, event: Mapping[str, Any]) -> None:
        if event["status"] == "note":
            self._note(event["detail"])
        elif event["status"] == "begun":
            if event["stage"] == "fetch":  # the first one: the region is widened
                self.stages.clear()
                self.drafts.clear()
            self.stages.append(event["stage"])
            if event["stage"] == "write":
                self.is_found.set()
            self.detail = ""
        elif event["status"] == "part":
            self.detail = event["detail"]

    def _note(self, note: str) -> None:
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
        self._kept = output / _KEPT
        self._plans = {plan.id: plan for plan in _read_plans(self._kept, output)}
        # Plans in their order; None stands for preparing the voyage in `_ahead`.
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
        """Add a plan and return it; return an earlier one of the same options unless it failed.

        Raises NotTakenError if too many plans wait.
        """
        same = json.dumps(options, sort_keys=True)
        for known in self._plans.values():
            if (
                known.state in {*_LIVE, "done"}
                and json.dumps(known.options, sort_keys=True) == same
            ):
                return known
        if sum(plan.state == "waiting" for plan in self._plans.values()) >= _MAX_WAITING:
            raise NotTakenError(
                f"{_MAX_WAITING} plans wait already; wait until one has ended, or cancel one", 429
            )
        plan = AskedPlan(request, options)
        ends = ("start", "goal")
        if self._ahead is not None and any(self._ahead[end] != options[end] for end in ends):
            self._ahead = None  # the voyage that is prepared is not the one that is planned
            if (task := self._work.pop(_PREPARING, None)) is not None:
                task.cancel()
        self._plans[plan.id] = plan
        self._waiting.put_nowait(plan)
        # The oldest plans that ended are forgotten; their results stay on the disk.
        ended = [known.id for known in self._plans.values() if known.state not in _LIVE]
        for identity in ended[: max(0, len(self._plans) - _MAX_KEPT)]:
            self.forget(self._plans[identity])
        return plan

    def keep(self, plan: AskedPlan) -> None:
        """Write a plan that ended, for the server after this one."""
        if plan.id in self._plans and plan.state not in _LIVE:
            with contextlib.suppress(OSError):  # it is gone with this server
                self._kept.mkdir(parents=True, exist_ok=True)
                write_whole(self._kept / f"{plan.id}.json", json.dumps(plan.kept()))

    def forget(self, plan: AskedPlan) -> None:
        """Forget a plan that ended; its files stay."""
        del self._plans[plan.id]
        for path in (self._kept / f"{plan.id}.json", self.map_file(plan)):
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)

    def map_file(self, plan: AskedPlan) -> Path:
        """Return the path of what the page's map draws of a plan."""
        return self._kept / f"{plan.id}.map"

    def number_before(self, plan: AskedPlan) -> int:
        """Return how many plans come before one that waits."""
        if plan.state != "waiting":
            return 0
        live = [one.id for one in self._plans.values() if one.state in _LIVE]
        return live.index(plan.id)

    def prepare(self, options: Mapping[str, Any]) -> None:
        """Make a voyage's land and currents ready, unless a worker has something else to do."""
        if self._ahead is None and not any(plan.state in _LIVE for plan in self._plans.values()):
            self._ahead = options
            self._waiting.put_nowait(None)

    def get(self, identity: str, *, drawn: bool = False) -> AskedPlan:
        """Return a plan by its id; NotTakenError if it is not known, or not yet `drawn`."""
        plan = self._plans.get(identity)
        if plan is None or (drawn and not plan.maps):
            fault = "there is no such plan; the server keeps the latest ones only"
            raise NotTakenError(fault, 404)
        return plan

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
        """Plan with a worker, one plan after the other.

        The spare one takes over if it was killed, or still writes the files of a plan: so the next
        plan begins at once.
        """
        work = asyncio.create_task(asyncio.sleep(0))
        await self._rested(worker, work)
        resting = asyncio.create_task(self._rested(spare, work))
        while True:
            plan = await self._waiting.get()
            if not work.done() or not worker.is_running:
                await resting
                worker, spare = spare, worker
                resting = asyncio.create_task(self._rested(spare, work))
            # It may have been cancelled meanwhile.
            if self._ahead is None if plan is None else plan.state != "waiting":
                continue
            name = _PREPARING if plan is None else plan.id
            work = self._work[name] = asyncio.create_task(self._made(worker, plan))
            work.add_done_callback(partial(self._ended, name))
            # What is only prepared is never found before its work has ended.
            is_found = asyncio.Event() if plan is None else plan.is_found
            found = asyncio.create_task(is_found.wait())
            await asyncio.wait([work, found], return_when=asyncio.FIRST_COMPLETED)
            found.cancel()
            if not worker.is_running:
                await resting
                worker, spare = spare, worker
                resting = asyncio.create_task(self._rested(spare, work))

    def _ended(self, name: str, _: asyncio.Task[None]) -> None:
        self._work.pop(name, None)

    async def _rested(self, worker: ServingWorker, work: asyncio.Task[None]) -> None:
        """Wait for the end of a worker's work, and have it ready for other.

        If it can't be started, the plan that needs it tries again, and reports why.
        """
        await asyncio.wait([work])
        with contextlib.suppress(PipelineError):
            await worker.start()

    async def _made(self, worker: ServingWorker, plan: AskedPlan | None) -> None:
        """Plan with a worker, or prepare a voyage; one that has grown large is ended."""
        try:
            await (self._prepare(worker) if plan is None else self._plan(worker, plan))
        finally:
            if worker.resident_bytes > _MAX_IDLE_BYTES:
                worker.kill()

    async def _plan(self, worker: ServingWorker, plan: AskedPlan) -> None:
        """Plan with a worker; whatever happens, the plan ends."""
        plan.state, plan.begun = "running", time.monotonic()
        plan.version += 1
        try:
            async for event in worker.plan(self._asked(plan.options), self._limit_s):
                if event["event"] == "map":
                    plan.maps += self._is_map_kept(plan, event["json"])
                plan.take(event)
        except PipelineError as error:
            plan.fail(str(error).splitlines())
        except asyncio.CancelledError:
            worker.kill()
            raise
        finally:
            if plan.state in _LIVE:
                plan.fail(["the plan ended unexpectedly; ask for it again"])
            self.keep(plan)

    def _is_map_kept(self, plan: AskedPlan, drawn: str) -> bool:
        """Write what the map draws of a plan; without room on the disk the page draws none."""
        try:
            self._kept.mkdir(parents=True, exist_ok=True)
            write_whole(self.map_file(plan), drawn)
        except OSError:
            return False
        return True

    async def _prepare(self, worker: ServingWorker) -> None:
        assert self._ahead is not None  # noqa: S101 - None was taken from the queue for it
        try:
            async for _ in worker.plan(self._asked(self._ahead, prepares=True), self._limit_s):
                pass
        except PipelineError:
            pass  # the voyage's own plan reports it
        except asyncio.CancelledError:
            worker.kill()
            raise
        self._ahead = None

    def _asked(self, options: Mapping[str, Any], *, prepares: bool = False) -> dict[str, Any]:
        """Return the argument of `answer_request`, for a worker."""
        where = {"output": str(self.output), "offline": self._offline}
        return {"options": options, "prepares": prepares, **where}


def _read_plans(folder: Path, output: Path) -> list[AskedPlan]:
    """Read the plans that an earlier server kept, the earliest first; damaged ones are left out."""
    plans = []
    for path in folder.glob("*.json"):
        with contextlib.suppress(OSError, ValueError, TypeError, KeyError):
            kept = json.loads(path.read_bytes())
            if any("/" in name for name in (kept["name"], *kept["files"])):
                continue
            given = {"id": path.stem, "request": PlanRequest(**kept["request"])}
            plan = AskedPlan(**kept | given)
            plan.directory = output / plan.name if plan.files else None
            plans.append(plan)
    return sorted(plans, key=lambda plan: plan.asked_at)[-_MAX_KEPT:]
