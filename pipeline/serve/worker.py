"""The workers of a server: started ahead, killed when a plan takes too long, and started again.

A worker process loads all libraries first, then plans voyage after voyage, and sends the events
that the page shows. It opens the files that the page was given, so its memory is limited, and the
server kills it when a plan takes too long or is cancelled.
"""

import asyncio
import contextlib
import gc
import json
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from pipeline._types import FloatArray
from pipeline.errors import PipelineError, StageError, one_line
from pipeline.findings.names import figures
from pipeline.findings.note_words import caveats_json, note_texts
from pipeline.findings.result import RunCase, RunResult, addressed
from pipeline.findings.sentences import case_facts
from pipeline.findings.text import capitalised, fuel, json_value
from pipeline.formats.figures.map_marks import speed_limits
from pipeline.formats.report.map_data import map_data
from pipeline.formats.report.page import shown_choices
from pipeline.geo.projection import METRES_PER_DEGREE
from pipeline.machine.interpreters import give_back_memory
from pipeline.machine.workers import Worker, WorkerEndedError, is_call_waiting, tell
from pipeline.run import Event, prepare
from pipeline.scenario.model import Scenario
from pipeline.sources.copernicus.client import without_secrets
from pipeline.stages.region import require_sailable
from pipeline.voyage.check import check_route, checked_lines
from pipeline.voyage.one_line import run_voyage, voyage_scenario
from pipeline.voyage.request import VoyageRequest, read_voyage
from pipeline.voyage.route_file import read_route
from pipeline.write import load_libraries
from renew._compiled import is_cold
from renew.results import Step
from renew.warming import rehearse_half

# Plans after which a worker is replaced, so that memory that libraries leak stays bounded.
_MAX_PLANS = 50
# Words for each kind of step of a plan.
_STEPS = {
    "class": "another way round",
    "padding": "padding grows, for room to turn",
    "path": "a way is found",
}
# Digits of the hash that tells results of different requests between the same positions apart.
_DIGITS = 6
# Largest distance of a drawn line from the route, as a share of the route's longer side: half a
# pixel on a map of 2,000 pixels.
_DETAIL = 1 / 4000
# Decimals of drawn positions, degrees: about 1 m.
_DECIMALS = 5


class ServingWorker(Worker):
    """A process that plans within a limit of memory, as the server sees it."""

    def __init__(self, memory_bytes: int) -> None:
        super().__init__(data_bytes=memory_bytes)
        self._plans = 0
        self._changing = asyncio.Lock()

    async def start(self) -> None:
        """Start the process unless it runs, and wait until it is ready."""
        async with self._changing:
            if self.is_running and self._plans >= _MAX_PLANS:
                self.kill()
            if not self.is_running:
                self._plans = 0
                self.call(get_ready)
                await self._event()

    async def plan(self, asked: Mapping[str, Any], limit_s: float) -> AsyncIterator[dict[str, Any]]:
        """Plan a voyage; yield its events, "done" or "failed" last.

        If `asked` only prepares, the last is "prepared". Raises StageError if it took too long, or
        the process ended.
        """
        await self.start()
        self._plans += 1
        try:
            async with asyncio.timeout(limit_s):
                self.call(answer_request, asked)
                while True:
                    event = await self._event()
                    yield event
                    if event["event"] in {"done", "failed", "prepared"}:
                        return
        except TimeoutError:
            self.kill()
            raise StageError(
                f"the plan took longer than {limit_s:g} s; plan a shorter voyage, or raise the "
                "limit: renew serve --limit SECONDS"
            ) from None

    async def _event(self) -> dict[str, Any]:
        """Wait for the next event of the process; its calls return nothing."""
        while True:
            await _readable(self.pipe.fileno())
            try:
                kind, value = self.answer()
            except WorkerEndedError as ended:
                words = str(ended).removeprefix("its process ").removesuffix(" (out of memory?)")
                raise StageError(
                    f"the process that planned {words}; if memory was short, plan a shorter "
                    "voyage, or raise the limit: renew serve --memory GB"
                ) from None
            if kind == "raised":
                raise value
            if kind == "told":
                event: dict[str, Any] = value
                return event


async def _readable(descriptor: int) -> None:
    """Wait until a file descriptor can be read."""
    loop, is_readable = asyncio.get_running_loop(), asyncio.Event()
    loop.add_reader(descriptor, is_readable.set)
    try:
        await is_readable.wait()
    finally:
        loop.remove_reader(descriptor)


# --- in the worker's process ---


def get_ready() -> None:
    """Load all libraries, send "ready", and load the machine code while no voyage waits."""
    load_libraries()
    _tell({"event": "ready"})
    if not is_call_waiting() and not is_cold():
        for half in range(2):  # so that the first plan need not load the machine code
            rehearse_half(half)


def answer_request(asked: Mapping[str, Any]) -> None:
    """Plan or prepare the voyage of a request, and send events on its progress."""
    if asked["prepares"]:
        with contextlib.suppress(Exception):  # the voyage's own plan reports what fails
            request, scenario, _ = _scenario(asked)
            require_sailable(scenario)
            prepare(scenario, request.output, offline=request.offline)
        _tell({"event": "prepared"})
    else:
        _plan(asked)
    gc.collect()
    give_back_memory()


def _plan(asked: Mapping[str, Any]) -> None:
    """Plan a voyage as `renew go` does, and send events on its progress."""
    try:
        if "route" in asked["options"]:
            _check(asked)
            return
        request, scenario, notes = _scenario(asked)
        _tell({"event": "scenario", "name": scenario.name, "title": scenario.title})
        for note in notes:
            _tell({"event": "note", "detail": note})
        outcome = run_voyage(
            request,
            scenario,
            said=notes,
            on_event=_tell_event,
            on_step=_tell_step,
            on_result=_tell_result,
        )
    except PipelineError as error:
        _tell({"event": "failed", "faults": without_secrets(str(error)).splitlines()})
    except Exception as error:  # noqa: BLE001 - the server tells it, and takes the next request
        _tell({"event": "failed", "faults": [without_secrets(one_line(error))]})
    else:
        files = sorted(file.name for file in outcome.directory.iterdir() if file.is_file())
        directory, failures = str(outcome.directory), outcome.failures
        _tell({"event": "done", "directory": directory, "files": files, "failures": failures})


def _check(asked: Mapping[str, Any]) -> None:
    """Check a route as `renew check-route` does, and send what was found."""
    given = dict(asked["options"])
    route = read_route(Path(given.pop("route")))
    if not given["depart"] and not given["month"] and route.points[0].time:
        given["depart"] = route.points[0].time
    request, scenario, notes = _scenario({**asked, "options": {**given, **route.stops}})
    run, checked = check_route(request, (scenario, notes), route, _tell_event)
    said = {one.given.season: [*checked_lines(one, route)] for one in checked}
    _tell_result(run, said)
    _tell({"event": "done", "directory": asked["output"], "files": [], "failures": []})


def _scenario(asked: Mapping[str, Any]) -> tuple[VoyageRequest, Scenario, tuple[str, ...]]:
    """Return the request of a voyage, its scenario, and notes.

    A hash is added to its name, so that the results of one request never replace those of another.
    """
    given = asked["options"]
    where = {"output": asked["output"], "offline": asked["offline"]}
    request = read_voyage({**given, **where}, "page")
    scenario, notes = voyage_scenario(request)
    digest = sha256(json.dumps(given, sort_keys=True).encode()).hexdigest()[:_DIGITS]
    name = f"{scenario.name[: 63 - _DIGITS]}-{digest}"
    return request, scenario.model_copy(update={"name": name}), notes


def _tell(fields: Mapping[str, Any]) -> None:
    """Send an event to the server, in the values of JSON."""
    tell(json_value(dict(fields)))


def _tell_event(event: Event) -> None:
    _tell(
        {
            "event": "progress",
            "stage": event.stage,
            "status": event.status,
            "season": event.season,
            "detail": without_secrets(event.detail),
        }
    )


def _tell_step(_case: object, step: Step) -> None:
    line = None if step.path is None else drawn(step.path)
    _tell({"event": "step", "detail": _STEPS[step.kind], "line": line})


def drawn(path: FloatArray) -> list[list[float]]:
    """Return a path (n, 2), lon/lat degrees, with as many points as a map shows."""
    line = shapely.LineString(path)
    west, south, east, north = line.bounds
    detail = max(east - west, north - south, 1 / METRES_PER_DEGREE) * _DETAIL
    points = shapely.get_coordinates(shapely.simplify(line, detail))
    shown: list[list[float]] = np.round(points, _DECIMALS).tolist()
    return shown


def _tell_result(result: RunResult, checked: Mapping[str, Sequence[str]] | None = None) -> None:
    """Send the sides, or what was found of a checked route, then what the map draws of them."""
    found = sides(result)
    for season in found["seasons"] if checked else ():
        season["checked"] = (checked or {}).get(season["name"])
    _tell({"event": "sides", **found})
    drawn = map_data(result, speed_limits(result), on_globe=True)
    tell({"event": "map", "json": json.dumps(drawn, separators=(",", ":"), allow_nan=False)})


def sides(result: RunResult) -> dict[str, Any]:
    """Return each case's routes with their figures and sentences.

    Lengths and distances are in true metres, durations in seconds. The first route by each passage
    of the main island is marked as a side's best one. `gap` is a share, None where none is proven.
    `warnings` tell which currents stand in for others.
    """
    stand_ins = addressed(result.fetched.stand_in_notes, result.scenario)
    return {
        "name": result.scenario.name,
        "title": result.scenario.title,
        "no_go": result.fetched.land.no_go_name,
        "seasons": [
            {
                "name": case.name,
                "title": case.title,
                "failure": case.result.failure,
                "routes": list(_routes(case)),
                "choices": [
                    {"title": title, "said": said, "plot": str(plot)}
                    for title, said, plot in shown_choices(case)
                ],
            }
            for case in result.cases
        ],
        "warnings": [capitalised(text) for text in note_texts(stand_ins)],
        **caveats_json(result),
        "notes": [capitalised(text) for text in note_texts(result.fetched.notes)],
    }


def _routes(case: RunCase) -> Iterator[dict[str, Any]]:
    """Yield the routes of a case with their figures, sentences and lines, best first."""
    facts = case_facts(case)
    if facts is None:  # it has no route
        return
    passed: set[str] = set()
    for ranked in case.routes:
        row, is_best = ranked.metrics, ranked.rank == 1
        passage = case.scenario.passage(case.name, round(row.duration_s))
        yield {
            **figures(row, "json"),
            "fuel_text": fuel(row.fuel, row),
            "excess": row.fuel / case.routes[0].metrics.fuel - 1,
            "because": facts.because() if is_best else facts.why_dearer(row),
            "certainty": facts.certainty() if is_best else "",
            "side": row.main_passage,
            "is_side": row.main_passage not in passed,
            "gap": case.proven_gap(row),
            "trials": row.trials,
            "collisions": row.collisions,
            "departure": passage and passage[0],
            "arrival": passage and passage[1],
            "line": drawn(case.run.water.projection.to_lonlat(np.asarray(ranked.route.path))),
        }
        passed.add(row.main_passage)
