"""What a server's worker process does: it loads everything first, then plans voyage after voyage.

It opens the files that the page was given, so it has a limit of memory, and the server kills it
when a plan takes too long or is cancelled.
"""

import contextlib
import gc
import json
from collections.abc import Callable, Mapping
from hashlib import sha256
from typing import Any

from pipeline.errors import PipelineError, one_line
from pipeline.findings.result import RunResult
from pipeline.findings.text import json_value
from pipeline.machine.interpreters import give_back_memory, seldom_collecting
from pipeline.machine.workers import is_call_waiting, tell
from pipeline.run import Event, prepare
from pipeline.scenario.model import Scenario
from pipeline.serve.sides import drawn, sides
from pipeline.sources.copernicus.client import without_secrets
from pipeline.stages.region import require_sailable
from pipeline.voyage.one_line import run_voyage, voyage_scenario
from pipeline.voyage.request import VoyageRequest, read_voyage
from pipeline.write import load_libraries
from renew._compiled import is_cold
from renew.warming import rehearse_half
from renew.watching import Step

Tell = Callable[[Mapping[str, Any]], None]

# What is said of each kind of step of a plan.
_STEPS = {
    "class": "another way round",
    "padding": "padding grows, for room to turn",
    "path": "a way is found",
}
# Digits of the hash that tells results of different requests between the same positions apart.
_DIGITS = 6


def get_ready() -> None:
    """Load everything, tell so, and load the machine code while no voyage waits."""
    with seldom_collecting():
        load_libraries()
        _tell({"event": "ready"})
        if not is_call_waiting() and not is_cold():
            for half in range(2):  # so that the first plan need not load the machine code
                rehearse_half(half)


def answer_request(asked: Mapping[str, Any]) -> None:
    """Plan or prepare the voyage of a request, and tell how it goes."""
    with seldom_collecting():
        (_prepare if asked["prepares"] else _plan)(asked, _tell)
    gc.collect()
    give_back_memory()


def _tell(fields: Mapping[str, Any]) -> None:
    """Tell an event, in the values of JSON."""
    tell(json_value(dict(fields)))


def _plan(asked: Mapping[str, Any], tell: Tell) -> None:
    """Plan a voyage as `renew go` does, and tell how it goes."""
    try:
        request, scenario, notes = _scenario(asked)
        tell({"event": "scenario", "name": scenario.name, "title": scenario.title})
        for note in notes:
            tell({"event": "note", "detail": note})

        def on_result(result: RunResult) -> None:
            tell({"event": "sides", **sides(result)})

        outcome = run_voyage(
            request,
            scenario,
            said=notes,
            on_event=lambda event: tell(_event(event)),
            on_step=lambda _, step: tell(_step(step)),
            on_result=on_result,
        )
    except PipelineError as error:
        tell({"event": "failed", "faults": without_secrets(str(error)).splitlines()})
    except Exception as error:  # noqa: BLE001 - the server tells it, and takes the next request
        tell({"event": "failed", "faults": [without_secrets(one_line(error))]})
    else:
        files = sorted(one.name for one in outcome.directory.iterdir() if one.is_file())
        directory, failures = str(outcome.directory), outcome.failures
        tell({"event": "done", "directory": directory, "files": files, "failures": failures})


def _prepare(asked: Mapping[str, Any], tell: Tell) -> None:
    """Make ready what a voyage needs before it is planned; what fails is told by its plan."""
    with contextlib.suppress(Exception):
        request, scenario, _ = _scenario(asked)
        require_sailable(scenario)
        prepare(scenario, request.output, offline=request.offline)
    tell({"event": "prepared"})


def _scenario(
    asked: Mapping[str, Any],
) -> tuple[VoyageRequest, Scenario, tuple[str, ...]]:
    """Return a voyage that was asked for, its scenario, and notes.

    A hash is added to its name, so that the results of one request never replace those of another.
    """
    given = asked["options"]
    where = {"output": asked["output"], "offline": asked["offline"]}
    request = read_voyage({**given, **where}, "page")
    scenario, notes = voyage_scenario(request)
    digest = sha256(json.dumps(given, sort_keys=True).encode()).hexdigest()[:_DIGITS]
    name = f"{scenario.name[: 63 - _DIGITS]}-{digest}"
    return request, scenario.model_copy(update={"name": name}), notes


def _event(event: Event) -> Mapping[str, Any]:
    """Return an event of a run as the page takes it."""
    return {
        "event": "progress",
        "stage": event.stage,
        "status": event.status,
        "season": event.season,
        "detail": without_secrets(event.detail),
    }


def _step(step: Step) -> Mapping[str, Any]:
    """Return a step of a plan as the page takes it."""
    line = None if step.path is None else drawn(step.path)
    return {"event": "step", "detail": _STEPS[step.kind], "line": line}
