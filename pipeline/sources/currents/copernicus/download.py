"""One download by the Copernicus Marine client: in a subprocess, repeated, errors explained."""

import json
import os
import signal
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, TypeVar

from pipeline.errors import StageError
from pipeline.machine.interpreters import run_python
from pipeline.scenario.catalogue import CopernicusSpec
from pipeline.sources.currents.copernicus.account import LOGIN, without_secrets
from pipeline.sources.currents.copernicus.steps import SelectedSteps
from pipeline.sources.currents.copernicus.subset import NO_ANSWER

AcceptedT = TypeVar("AcceptedT")

# Factor by which the pause before another attempt grows each time.
_PAUSE_GROWTH = 3.0
# Time within which the service must say which steps it has, s.
_LOOK_S = 120.0
# Errors of the client that another attempt does not solve, and what does.
_PERMANENT_ERRORS = {
    "InvalidUsernameOrPassword": f"check {LOGIN}",
    "CredentialsCannotBeNone": f"set {LOGIN}",
    "CoordinatesOutOfDatasetBounds": "shrink the region, or name another source in 'currents'",
    "NotCoveredError": "name another time, or another source in 'currents'",
    "DatasetVersionNotFound": "correct `version` in its entry in the catalogue",
    "VariableDoesNotExistInTheDataset": "correct its entry in the catalogue",
}
# Errors that may pass, and what to check if they don't.
_TEMPORARY_ERRORS = {
    "CouldNotConnectToAuthenticationSystem": (
        "auth.marine.copernicus.eu can't be reached; check the connection and the proxy"
    ),
    "DatasetUpdating": "try again in an hour",
    "DatasetNotFound": (
        "if the service's catalogue is in order, correct the dataset's entry in ours, or name "
        "another source in 'currents'"
    ),
}
_TRY_LATER = "try again later, or name another source in 'currents'"
# Length to which the client's messages are cut, characters.
_MAX_MESSAGE_LENGTH = 400


@dataclass(frozen=True, slots=True)
class _Failure:
    """Why an attempt failed, and whether another one is useless."""

    reason: str
    is_permanent: bool


def download(
    spec: CopernicusSpec,
    arguments: Mapping[str, Any],
    label_format: str,
    steps: SelectedSteps,
    file: Path,
    accept: Callable[[dict[str, Any]], AcceptedT],
) -> AcceptedT:
    """Download time steps into a file, and return what `accept` makes of it.

    `accept` is given the answer of `subset`: `version` and `part` of the dataset, `stamps` of the
    first and the last step, and the `missing_boxes` of the service. Where it raises StageError, the
    file is downloaded again.

    Raises
    ------
    StageError
        All attempts failed, each of them within its deadline, or one for good.
    """
    request = {
        "parent_pid": os.getpid(),
        "version": spec.version,
        "label_format": label_format,
        "labels": steps.labels,
        # A voyage may be over before the last possible arrival.
        "may_lack": steps.are_fields,
        "subset": {**arguments, "output_directory": str(file.parent), "output_filename": file.name},
    }
    pause, attempt = spec.pause_s, 1
    while True:
        # The client does not overwrite a file: it writes beside it.
        file.unlink(missing_ok=True)
        answer = _attempt(request, spec.deadline_s)
        if not isinstance(answer, _Failure):
            try:
                return accept(answer)
            except StageError as error:
                answer = _Failure(f"{error}; {_TRY_LATER}", is_permanent=False)
        if answer.is_permanent or attempt == spec.attempts:
            attempts = f" ({attempt} attempts)" if attempt > 1 else ""
            raise StageError(f"{spec.name}: {answer.reason}{attempts}")
        time.sleep(pause)
        pause, attempt = pause * _PAUSE_GROWTH, attempt + 1


def last_step(spec: CopernicusSpec) -> tuple[datetime, str]:
    """Ask for a dataset's last time step (aware, UTC) and its version, once.

    Raises
    ------
    StageError
        The service does not answer, or not that.
    """
    request = {
        "parent_pid": os.getpid(),
        "version": spec.version,
        "dataset_id": spec.dataset,
        "variables": [spec.eastward],
    }
    answer = _attempt(request, min(spec.deadline_s, _LOOK_S))
    if isinstance(answer, _Failure):
        raise StageError(f"{spec.name}: {answer.reason}")
    return datetime.fromisoformat(answer["last_step"]), str(answer["version"])


def _attempt(request: Mapping[str, Any], deadline_s: float) -> dict[str, Any] | _Failure:
    """Call the client once."""
    module = "pipeline.sources.currents.copernicus.subset"
    result = run_python(["-m", module], json.dumps(request), deadline_s)
    message = _presentable(_last_message(result.stderr))
    if result.exit_code is None:
        last = f" (last message: {message})" if message else ""
        reason = f"no answer within {deadline_s:g} s{last}; it was stopped: {_TRY_LATER}"
        return _Failure(reason, is_permanent=False)
    if result.exit_code == NO_ANSWER:
        reason = "the client gave up without a reason, as it does where it finds no credentials"
        return _Failure(f"{reason}; set {LOGIN}", is_permanent=True)
    if result.exit_code < 0:
        name = signal.Signals(-result.exit_code).name
        reason = f"the client was ended from outside, by {name}: check what did, and the memory"
        return _Failure(f"{reason} of this machine", is_permanent=False)
    if result.exit_code > 0:
        reason = f"the client failed: {message or f'exit {result.exit_code}'}"
        return _Failure(reason, is_permanent=False)
    answer: dict[str, Any] = json.loads(result.stdout)
    return _explained(_presentable(answer["error"])) if "error" in answer else answer


def _explained(message: str) -> _Failure:
    """Add the remedy to an error of the client."""
    error = message.partition(":")[0]
    remedy = {**_PERMANENT_ERRORS, **_TEMPORARY_ERRORS}.get(error, _TRY_LATER)
    reason = f"the client failed: {message.rstrip(': .')}; {remedy}"
    return _Failure(reason, is_permanent=error in _PERMANENT_ERRORS)


def _last_message(text: str) -> str:
    """Last line that is not mere information."""
    lines = (line.strip() for line in reversed(text.splitlines()))
    return next((line for line in lines if line and not line.startswith("INFO ")), "")


def _presentable(text: str) -> str:
    """A text without credentials, cut to a limited length."""
    return without_secrets(text)[:_MAX_MESSAGE_LENGTH]
