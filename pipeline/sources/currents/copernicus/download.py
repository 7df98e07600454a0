"""One download of the Copernicus Marine client: in a child process, tried again, and explained."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from pipeline.errors import StageError
from pipeline.sources.currents.copernicus.account import PASSWORD, USERNAME, without_secrets
from pipeline.sources.currents.copernicus.subprocess_deadline import run_with_deadline
from pipeline.sources.currents.copernicus.subset import NO_ANSWER

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from pipeline.scenario.catalogue import CopernicusSpec

LookedT = TypeVar("LookedT")

# Each pause before another attempt is so many times the one before.
_PAUSES_GROW = 3.0
# Errors of the client after which asking again can't help, and what will.
_LOGIN = f"{USERNAME} and {PASSWORD}, or run `copernicusmarine login`"
_FINAL = {
    "InvalidUsernameOrPassword": f"check {_LOGIN}",
    "CredentialsCannotBeNone": f"set {_LOGIN}",
    "CoordinatesOutOfDatasetBounds": "shrink the region, or name another source in 'currents'",
    "NotCoveredError": "name another time, or another source in 'currents'",
    "DatasetVersionNotFound": "mend `version` in its entry in the catalogue",
    "VariableDoesNotExistInTheDataset": "mend its entry in the catalogue",
}
# Errors that pass, and what to look at if they don't.
_PASSING = {
    "CouldNotConnectToAuthenticationSystem": (
        "auth.marine.copernicus.eu can't be reached; check the connection and the proxy"
    ),
    "DatasetUpdating": "try again in an hour",
    "DatasetNotFound": (
        "if the service's catalogue is in order, mend the dataset's entry in ours, or name another "
        "source in 'currents'"
    ),
}
_LATER = "try again later, or name another source in 'currents'"
_LONGEST_REASON = 400


@dataclass(frozen=True, slots=True)
class _Failure:
    """Why a call failed, and whether another can't help."""

    reason: str
    is_final: bool


def download(
    spec: CopernicusSpec,
    request: Mapping[str, Any],
    form: str,
    labels: tuple[str, ...],
    file: Path,
    look: Callable[[dict[str, Any]], LookedT],
) -> LookedT:
    """Fetch the time steps with these labels into a file, and have it looked at.

    `look` is told what the client said: `version` and `part` of the dataset, `stamps` of the first
    and the last step, and the boxes that were `missing` from the service. It returns what it makes
    of the file; where it raises StageError, the file is fetched again.

    Raises
    ------
    StageError
        It could not be had: so many attempts failed, each of them within its deadline.
    """
    asked = {
        "parent": os.getpid(),
        "version": spec.version,
        "form": form,
        "labels": labels,
        "subset": {**request, "output_directory": str(file.parent), "output_filename": file.name},
    }
    pause, attempt = spec.pause_s, 1
    while True:
        # The client would write beside a file that is there.
        file.unlink(missing_ok=True)
        answer = _attempt(asked, spec.deadline_s)
        if not isinstance(answer, _Failure):
            try:
                return look(answer)
            except StageError as error:
                answer = _Failure(f"{error}; {_LATER}", is_final=False)
        if answer.is_final or attempt == spec.attempts:
            tried = f" ({attempt} attempts)" if attempt > 1 else ""
            raise StageError(f"{spec.name}: {answer.reason}{tried}")
        time.sleep(pause)
        pause, attempt = pause * _PAUSES_GROW, attempt + 1


def _attempt(asked: Mapping[str, Any], deadline_s: float) -> dict[str, Any] | _Failure:
    """Call the client once."""
    command = [sys.executable, "-m", "pipeline.sources.currents.copernicus.subset"]
    ended = run_with_deadline(command, json.dumps(asked), deadline_s)
    said = _cut(_last_line(ended.errors))
    if ended.code is None:
        last = f" (last heard: {said})" if said else ""
        silent = f"no answer within {deadline_s:g} s{last}; it was stopped"
        return _Failure(f"{silent}: {_LATER}", is_final=False)
    if ended.code == NO_ANSWER:
        silent = "the client gave up without a reason, as it does where it finds no credentials"
        return _Failure(f"{silent}; set {_LOGIN}", is_final=True)
    if ended.code < 0:
        name = signal.Signals(-ended.code).name
        ended_by = f"the client was ended from outside, by {name}"
        return _Failure(f"{ended_by}: look who does, and at this machine's memory", is_final=False)
    if ended.code > 0:
        return _Failure(f"the client failed: {said or f'exit {ended.code}'}", is_final=False)
    answer: dict[str, Any] = json.loads(ended.answer)
    return _explained(_cut(answer["error"])) if "error" in answer else answer


def _explained(said: str) -> _Failure:
    """Say with an error of the client what to do about it."""
    error = said.partition(":")[0]
    remedy = {**_FINAL, **_PASSING}.get(error, _LATER)
    return _Failure(f"the client failed: {said.rstrip(': .')}; {remedy}", is_final=error in _FINAL)


def _last_line(text: str) -> str:
    """Last line that says something of trouble."""
    lines = (line.strip() for line in reversed(text.splitlines()))
    return next((line for line in lines if line and not line.startswith("INFO ")), "")


def _cut(text: str) -> str:
    """A text for everybody's eyes, and not too long."""
    return without_secrets(text)[:_LONGEST_REASON]
