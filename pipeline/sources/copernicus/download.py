"""A download by the Copernicus Marine client: its time steps, attempts, and place in the cache.

Which steps a dataset has is known without a request, so they are selected by the same rules as
those of the user's files (`pipeline.sources.cf.fields`), before they are downloaded.

The service labels the mean of a month or a day with its first moment, that of an hour with its
first or its middle, and an instantaneous field with its own time. So a step is identified here by a
label as coarse as the step itself: "2024-07", "2024-07-15", "2024-07-15T18".

In the cache each NetCDF file has a sidecar with its request, provenance and hash. A file is
downloaded into a staging folder of its own and moved into the cache once it is complete and has
passed the acceptance check. A file without a sidecar, or with another hash than its sidecar gives,
counts as absent.
"""

import contextlib
import json
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypeVar

from shapely.geometry import Polygon

from pipeline.errors import StageError, one_line
from pipeline.geo.projection import MARGIN_CELLS, widened
from pipeline.machine.files import remove_abandoned, write_whole
from pipeline.machine.store import file_hash
from pipeline.machine.workers import WorkerEndedError, call_in_process
from pipeline.scenario.catalogue import CopernicusSpec, StepLength
from pipeline.scenario.season import Period, TimeMethod
from pipeline.sources.cf.axes import MONTH, TimeSteps, middle_of_step, step_around
from pipeline.sources.cf.fields import SelectedSteps, select_all_steps, select_steps
from pipeline.sources.copernicus.client import LOGIN, answer_request, without_secrets
from pipeline.texts import table_beside

_BY_HOUR = "%Y-%m-%dT%H"
_LABEL_FORMATS = {"month": "%Y-%m", "day": "%Y-%m-%d", "6 hours": _BY_HOUR, "hour": _BY_HOUR}
_SPOKEN = {"month": "a month", "day": "a day", "6 hours": "6 hours", "hour": "an hour"}
_LENGTHS: dict[StepLength, timedelta] = {
    "month": MONTH,
    "day": timedelta(days=1),
    "6 hours": timedelta(hours=6),
    "hour": timedelta(hours=1),
}
# Number of steps around a moment that are looked at: the one before it, its own, and two more.
_LEAST_STEPS = 4


def label_format(spec: CopernicusSpec) -> str:
    """Return the format (strftime) of a step's label; a climatology has no years."""
    return "%m" if spec.kind == "climatology" else _LABEL_FORMATS[spec.step]


def step_ends(spec: CopernicusSpec, moment: datetime) -> tuple[datetime, datetime]:
    """Return begin and end of the step of a dataset that a moment lies in."""
    return step_around(moment, _LENGTHS[spec.step])


def select(
    spec: CopernicusSpec, period: Period, method: TimeMethod | Literal["changing"]
) -> tuple[TimeSteps, SelectedSteps]:
    """Select the steps of a dataset that make up a period's field, or fields that change.

    Returns these steps alone, each with the time for which it is valid and its label, and which of
    them make up each field. Raises ValueError if the dataset is a climatology, and changes between
    its months are asked for; or its steps are longer than the period.
    """
    middle = period.begin + (period.end - period.begin) / 2
    if spec.kind == "climatology":
        if method == "changing":
            raise ValueError("is a climatology of months, which does not show how currents change")
        if method == "linear":
            raise ValueError("is a climatology of months, which are not interpolated in time")
        month = TimeSteps(months=(middle.month,), labels=(f"{middle:%m}",))
        return month, select_steps(month, period, method)
    if method not in {"mean", "changing"}:
        period = Period(middle, middle)
    begin, end = step_ends(spec, period.begin)
    if method == "mean" and (begin < period.begin or end > period.end):
        raise ValueError(
            f"has time steps of {_SPOKEN[spec.step]}, which are longer than the time asked for"
        )
    begins = [step_ends(spec, begin - timedelta(hours=1))[0]]
    while len(begins) < _LEAST_STEPS or begins[-1] <= period.end:
        begins.append(step_ends(spec, begins[-1])[1])
    if method == "nearest" and spec.kind == "mean":
        begins = [begin]  # the mean that contains a moment, even if another's middle is nearer
    is_instant, length = spec.kind == "instant", _LENGTHS[spec.step]
    steps = TimeSteps(
        moments=tuple(at if is_instant else middle_of_step(at, length) for at in begins),
        labels=tuple(at.strftime(label_format(spec)) for at in begins),
        width=end - begin,
    )
    if method == "changing":
        selected = select_all_steps(steps, period)
    else:
        selected = select_steps(steps, period, method)
    used = sorted({step for weights in selected.weights for step in weights})
    place = {step: at for at, step in enumerate(used)}
    weights = tuple({place[i]: share for i, share in shares.items()} for shares in selected.weights)
    return steps.only(used), replace(selected, weights=weights)


@dataclass(frozen=True)
class SubsetRequest:
    """All that a dataset's file must have: a region (lon/lat degrees), and steps by `select`."""

    spec: CopernicusSpec
    region: Polygon
    steps: TimeSteps
    selected: SelectedSteps

    @property
    def changes(self) -> bool:
        """Whether each step is a field of its own, of a current that changes."""
        return len(self.selected.weights) > 1

    def until(self, last: datetime) -> "SubsetRequest":
        """Return the request without the steps that begin after a moment.

        If all steps together make up one field, it stays as it is.
        """
        if not self.changes:
            return self
        begins = [step_ends(self.spec, moment)[0] for moment in self.steps.moments]
        count = sum(begin <= last for begin in begins)
        selected = replace(
            self.selected,
            weights=self.selected.weights[:count],
            times_s=self.selected.times_s[:count],
        )
        return replace(self, steps=self.steps.only(range(count)), selected=selected)

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of `copernicusmarine.subset` except version, times and output file."""
        spec = self.spec
        lowest, highest = spec.latitudes
        margin = MARGIN_CELLS * spec.cell_deg
        west, south, east, north = widened(self.region.bounds, margin, margin)
        arguments: dict[str, Any] = {
            "dataset_id": spec.dataset,
            "variables": [spec.eastward, spec.northward],
            "minimum_longitude": west,
            "maximum_longitude": east,
            "minimum_latitude": max(south, lowest),
            "maximum_latitude": min(north, highest),
            "coordinates_selection_method": "strict-inside",
            "disable_progress_bar": True,
            "raise_if_updating": True,
        }
        if spec.depth_m is not None:
            # For equal limits the client takes the nearest level.
            arguments |= {"minimum_depth": spec.depth_m, "maximum_depth": spec.depth_m}
        return arguments

    @property
    def record(self) -> dict[str, Any]:
        """The request as the sidecar has it."""
        return {**self.arguments, "version": self.spec.version, "times": list(self.steps.labels)}


AcceptedT = TypeVar("AcceptedT")

# Factor by which the pause before another attempt grows each time.
_PAUSE_GROWTH = 3.0
# Time within which the service must say which steps it has, s.
_LOOK_S = 120.0
_ERRORS = table_beside(__file__, "errors.toml")
_TRY_LATER = "try again later, or name another source in 'currents'"
# Length to which the client's messages are cut, characters.
_MAX_MESSAGE_LENGTH = 400


_Failure: TypeAlias = tuple[str, bool]
"""Why an attempt failed, and whether another one is useless."""


def download(
    asked: SubsetRequest, file: Path, accept: Callable[[dict[str, Any]], AcceptedT]
) -> AcceptedT:
    """Download what is asked for into a file, and return what `accept` makes of it.

    `accept` is given the answer of `subset`: `version` and `part` of the dataset, `stamps` of the
    first and the last step, and the `missing_boxes` of the service. Where it raises StageError, the
    file is downloaded again. Raises StageError if all attempts failed or exceeded their deadlines,
    or one failed with a permanent error.
    """
    spec = asked.spec
    request = {
        "version": spec.version,
        "label_format": label_format(spec),
        "labels": asked.steps.labels,
        # The last step may be missing: the voyage may end before it.
        "may_lack": asked.changes,
        "subset": {
            **asked.arguments,
            "output_directory": str(file.parent),
            "output_filename": file.name,
        },
    }
    pause, attempt = spec.pause_s, 1
    while True:
        # The client does not overwrite a file: it writes beside it.
        file.unlink(missing_ok=True)
        answer = _attempt(request, spec.deadline_s)
        if isinstance(answer, dict):
            try:
                return accept(answer)
            except StageError as error:
                answer = (f"{error}; {_TRY_LATER}", False)
        reason, is_permanent = answer
        if is_permanent or attempt == spec.attempts:
            attempts = f" ({attempt} attempts)" if attempt > 1 else ""
            raise StageError(f"{spec.name}: {reason}{attempts}")
        time.sleep(pause)
        pause, attempt = pause * _PAUSE_GROWTH, attempt + 1


def last_step(spec: CopernicusSpec) -> tuple[datetime, str]:
    """Ask for a dataset's last time step (aware, UTC) and its version, once.

    Raises StageError if the service does not answer, or its answer does not state them.
    """
    request = {"version": spec.version, "dataset_id": spec.dataset, "variables": [spec.eastward]}
    answer = _attempt(request, min(spec.deadline_s, _LOOK_S))
    if not isinstance(answer, dict):
        raise StageError(f"{spec.name}: {answer[0]}")
    return datetime.fromisoformat(answer["last_step"]), str(answer["version"])


def _attempt(request: Mapping[str, Any], deadline_s: float) -> dict[str, Any] | _Failure:
    try:
        answer: dict[str, Any] | None = call_in_process(
            answer_request, dict(request), limit_s=deadline_s
        )
    except WorkerEndedError as ended:
        return _ended(ended), False
    except Exception as error:  # noqa: BLE001 - of the client or of its libraries
        return f"the client failed: {_presentable(one_line(error))}", False
    if answer is None:
        reason = "the client gave up without a reason, as it does where it finds no credentials"
        return f"{reason}; set {LOGIN}", True
    if "error" not in answer:
        return answer
    name = answer["error"]
    remedy = {**_ERRORS["permanent"], **_ERRORS["temporary"]}.get(name, _TRY_LATER)
    said = _presentable(f"{name}: {answer['said']}").rstrip(": .")
    return f"the client failed: {said}; {remedy.format(login=LOGIN)}", name in _ERRORS["permanent"]


def _ended(ended: WorkerEndedError) -> str:
    """Say why there is no answer of a process that has ended."""
    lines = (line.strip() for line in reversed(ended.stderr.splitlines()))
    last_line = next((line for line in lines if line and not line.startswith("INFO ")), "")
    message = _presentable(last_line)
    if ended.exit_code is None:
        last = f" (last message: {message})" if message else ""
        return f"no answer within {ended.limit_s:g} s{last}; it was stopped: {_TRY_LATER}"
    if ended.exit_code < 0:
        name = signal.Signals(-ended.exit_code).name
        return (
            f"the client was ended from outside, by {name}: check what did, and the memory of this "
            "machine"
        )
    return f"the client failed: {message or f'exit {ended.exit_code}'}"


def _presentable(text: str) -> str:
    """Return a text without credentials, cut to a limited length."""
    return without_secrets(text)[:_MAX_MESSAGE_LENGTH]


_STAGING_SUFFIX = ".partial"
# Age from which a staging folder was left behind by a killed run, s: no download takes as long.
_ABANDONED_AGE_S = 24 * 3600.0


def cached_metadata(file: Path, request: object) -> dict[str, Any] | None:
    """Read the sidecar of a cached file; None unless it is for this request and has its hash."""
    try:
        metadata = json.loads(file.with_suffix(".json").read_text(encoding="utf-8"))
        is_valid = metadata["request"] == request and metadata["sha256"] == file_hash(file)
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return metadata if is_valid else None


def save(staged: Path, file: Path, metadata: dict[str, Any]) -> dict[str, Any]:
    """Move an accepted file to its place in the cache; write and return its sidecar."""
    metadata = {
        **metadata,
        "retrieved_utc": datetime.now(UTC).isoformat(timespec="seconds"),
        "bytes": staged.stat().st_size,
        "sha256": file_hash(staged),
    }
    # If killed in between, the file is not used: the old sidecar has another hash.
    staged.replace(file)
    write_whole(file.with_suffix(".json"), json.dumps(metadata, indent=2) + "\n")
    return metadata


@contextlib.contextmanager
def staging_folder(cache: Path) -> Iterator[Path]:
    """Make an empty folder in the cache, and remove it when the block ends."""
    cache.mkdir(parents=True, exist_ok=True)
    remove_abandoned_downloads(cache)
    with tempfile.TemporaryDirectory(
        suffix=_STAGING_SUFFIX, dir=cache, ignore_cleanup_errors=True
    ) as folder:
        yield Path(folder)


def remove_abandoned_downloads(cache: Path) -> None:
    """Remove staging folders that killed runs left behind, with the client's leftovers in them."""
    remove_abandoned(cache, f"*{_STAGING_SUFFIX}", _ABANDONED_AGE_S)
