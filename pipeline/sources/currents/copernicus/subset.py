"""The one download of the Copernicus Marine client, run as a process of its own.

Reads what is asked as JSON on standard input: the dataset, the labels of the time steps, and the
other arguments of `copernicusmarine.subset`. It looks up the dataset's own time axis, asks for
exactly those steps, and says as JSON on standard output what it got, or its `error`. NO_ANSWER as
exit code: the client gave up without a word, which it does without credentials.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import re
import sys
import threading
import time
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

if TYPE_CHECKING:
    from collections.abc import Sequence

    Box = tuple[float, float, float, float]

NO_ANSWER = 3
# How often it looks whether the process that wants the file still lives, s.
_WATCH_S = 1.0
# urllib3's own line for each answer: ... "GET /path HTTP/1.1" 403 243
_ANSWER = re.compile(r'"GET (?P<address>\S+) HTTP/[\d.]+" (?P<status>\d{3})')
_CHUNK = re.compile(r"(?P<store>.*\.zarr)/(?P<variable>\w+)/(?P<index>\d+(\.\d+)*)")
# Where nothing was ever written the store answers so, and the client takes it for "no value here".
_NOT_THERE = (403, 404)


class NotCoveredError(Exception):
    """The dataset has not all of the steps that are asked for."""


class Heard(logging.Handler):
    """Listens to the connections: the client keeps to itself which chunks it did not get."""

    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self.missing: set[tuple[str, tuple[int, ...]]] = set()
        self.missing_axes: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        """Note a chunk that was not there; say aloud that the service is in trouble."""
        answer = _ANSWER.search(record.getMessage())
        if answer is None:
            return
        path, status = urlsplit(answer["address"]).path, int(answer["status"])
        chunk = _CHUNK.fullmatch(path)
        if chunk and status in _NOT_THERE:
            place = tuple(int(number) for number in chunk["index"].split("."))
            if len(place) > 1:
                self.missing.add((chunk["store"], place))
            else:
                self.missing_axes.add(chunk["variable"])
        elif status >= 500:
            sys.stderr.write(f"the service answers {status} for {path}\n")
            sys.stderr.flush()


def main() -> int:
    """Download what standard input asks for; return the exit code."""
    asked = json.load(sys.stdin)
    threading.Thread(target=_end_with, args=(asked["parent"],), daemon=True).start()
    heard = Heard()
    logger = logging.getLogger("urllib3.connectionpool")
    logger.setLevel(logging.DEBUG)
    logger.addHandler(heard)
    answer: dict[str, object] | None
    try:
        # The client prints; standard output is for the answer.
        with contextlib.redirect_stdout(sys.stderr):
            answer = _download(asked, heard)
    except Exception as error:  # noqa: BLE001 - whatever it is, the parent decides
        said = f"{type(error).__name__}: {' '.join(str(error).split())}"
        lacking = "".join(f"; the service lacks its {axis}" for axis in sorted(heard.missing_axes))
        answer = {"error": f"{said}{lacking}"}
    if answer is None:
        return NO_ANSWER
    json.dump(answer, sys.stdout)
    return 0


def _end_with(parent: int) -> None:
    """End once the parent has: it may have been killed, and nobody waits for the file."""
    while os.getppid() == parent:
        time.sleep(_WATCH_S)
    os._exit(1)


def _download(asked: dict[str, Any], heard: Heard) -> dict[str, object] | None:
    """Look the steps up, fetch them, and say which release it was and what was not there."""
    # Imported here: it takes seconds, and the parent reads this module for its exit codes.
    import copernicusmarine

    request = asked["subset"]
    described = copernicusmarine.describe(
        dataset_id=request["dataset_id"], show_all_versions=True, disable_progress_bar=True
    )
    dataset = described.products[0].datasets[0]
    version = dataset.get_version(asked["version"] or None)
    part = version.get_part(None)
    stamps = _chosen(_axis(part, request["variables"][0]), asked["form"], asked["labels"])
    answer = copernicusmarine.subset(
        **request,
        dataset_version=version.label,
        dataset_part=part.name,
        start_datetime=stamps[0].strftime("%Y-%m-%dT%H:%M:%SZ"),
        end_datetime=stamps[-1].strftime("%Y-%m-%dT%H:%M:%SZ"),
    )
    if answer is None:
        return None
    return {
        "version": version.label,
        "part": part.name,
        "stamps": [stamps[0].isoformat(), stamps[-1].isoformat()],
        "missing": sorted(_box(part, store, place) for store, place in heard.missing),
    }


def _axis(part: Any, variable: str) -> list[datetime]:  # noqa: ANN401 - the client has no types
    """Every time step of a variable, UTC."""
    for service in part.services:
        for found in service.variables:
            for axis in found.coordinates:
                if found.short_name == variable and axis.coordinate_id == "time":
                    return sorted(_moment(value) for value in _values(axis))
    raise NotCoveredError(f"it lists no time steps for a variable {variable!r}")


def _values(axis: Any) -> list[Any]:  # noqa: ANN401 - the same
    """Values of an axis that is listed, or given by its limits and its step."""
    if axis.values:
        return list(axis.values)
    count = round((axis.maximum_value - axis.minimum_value) / axis.step) + 1
    return [axis.minimum_value + axis.step * place for place in range(count)]


def _moment(value: float | str) -> datetime:
    """A time of the catalogue: milliseconds since 1970, or a text."""
    if isinstance(value, str):
        moment = datetime.fromisoformat(value)
        return moment.astimezone(UTC) if moment.tzinfo else moment.replace(tzinfo=UTC)
    return datetime.fromtimestamp(value / 1000, UTC)


def _chosen(axis: Sequence[datetime], form: str, labels: Sequence[str]) -> list[datetime]:
    """The stamps of the steps with these labels; all must be there."""
    wanted = set(labels)
    chosen = [stamp for stamp in axis if stamp.strftime(form) in wanted]
    lacking = sorted(wanted - {stamp.strftime(form) for stamp in chosen})
    if lacking:
        raise NotCoveredError(
            f"it covers {axis[0]:%Y-%m-%d} to {axis[-1]:%Y-%m-%d}, and of the {len(wanted)} steps "
            f"asked for {len(lacking)} are not in it, the first {lacking[0]}"
        )
    return chosen


def _box(part: Any, store: str, place: tuple[int, ...]) -> Box:  # noqa: ANN401 - the same
    """West, south, east and north end of a chunk: the centres of its outermost cells, degrees."""
    for service in part.services:
        # The bucket's name may stand in the path or in the host's.
        if urlsplit(service.uri).path.endswith(store):
            axes = {axis.coordinate_id: axis for axis in service.variables[0].coordinates}
            south, north = _span(axes["latitude"], place[-2])
            west, east = _span(axes["longitude"], place[-1])
            return (west, south, east, north)
    raise LookupError(f"a chunk of {store} was not there, and the catalogue does not know that")


def _span(axis: Any, place: int) -> tuple[float, float]:  # noqa: ANN401 - the same
    """Least and greatest value of an axis in one of its chunks."""
    length = int(axis.chunking_length)
    values = _values(axis)[place * length : (place + 1) * length]
    return (float(values[0]), float(values[-1]))


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    sys.stderr.flush()
    # Not `sys.exit`: that waits for threads of the client, some of which go on trying for minutes.
    os._exit(code)
