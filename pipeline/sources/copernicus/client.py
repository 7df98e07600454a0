"""The Copernicus Marine client in a process of its own: the check of the login, and a download.

The client takes seconds to import, waits for answers without a limit of time, and may never end.
"""

import base64
import binascii
import logging
import os
import re
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from urllib.parse import quote, quote_plus, urlsplit

from pipeline.errors import one_line
from pipeline.machine.workers import WorkerEndedError, call_in_process
from pipeline.texts import clean

USERNAME = "COPERNICUSMARINE_SERVICE_USERNAME"
PASSWORD = "COPERNICUSMARINE_SERVICE_PASSWORD"  # noqa: S105 - the variable's name
LOGIN = f"{USERNAME} and {PASSWORD}, or run `copernicusmarine login`"
"""How to sign in with the client; messages put it after "set" or "check"."""
# The client's own file, under COPERNICUSMARINE_CREDENTIALS_DIRECTORY or the home directory.
_FILE = ".copernicusmarine/.copernicusmarine-credentials"
# Credentials in addresses: the client puts the user name into every address, and the address of a
# proxy may have a password.
_IN_ADDRESSES = re.compile(r"(?<=x-cop-user=)[^&\s'\"]+|(?<=://)[^/@\s'\"]+(?=@)")
_HIDDEN = "***"


def has_account() -> bool:
    """Whether the client will find a user name and a password."""
    return bool(os.environ.get(USERNAME) and os.environ.get(PASSWORD)) or (
        credentials_file().is_file()
    )


def credentials_file() -> Path:
    """Return the path of the file in which `copernicusmarine login` stores the credentials."""
    folder = os.environ.get("COPERNICUSMARINE_CREDENTIALS_DIRECTORY")
    return (Path(folder) if folder else Path.home()) / _FILE


def without_secrets(text: str) -> str:
    """Replace in a text all credentials that are known here, and any in an address."""
    secrets = _secrets()
    # A message may quote them unchanged, or as an address or a form encodes them.
    encoded = {encode(secret) for secret in secrets for encode in (str, quote, quote_plus)}
    for secret in sorted(encoded, key=len, reverse=True):
        text = text.replace(secret, _HIDDEN)
    return _IN_ADDRESSES.sub(_HIDDEN, text)


def _secrets() -> set[str]:
    """Return user names and passwords of the environment and of the client's own file."""
    secrets = {os.environ.get(USERNAME, ""), os.environ.get(PASSWORD, "")}
    try:
        stored = base64.standard_b64decode(credentials_file().read_bytes()).decode("utf-8")
    except (OSError, binascii.Error, UnicodeDecodeError):
        stored = ""
    # The file is read as configparser reads it; in a damaged one, every line is taken for a secret.
    for line in stored.splitlines():
        name, _, value = line.replace(":", "=", 1).partition("=")
        secrets.add(value.strip() if value else name.strip("[] "))
    return secrets - {"", "credentials"}


# Maximum length of the client's message in a fault, characters.
_MAX_MESSAGE_LENGTH = 200
_REACH = "check the connection to auth.marine.copernicus.eu, and the proxy"


def login_fault(deadline_s: float) -> tuple[str, str]:
    """Return why the account can't be used now, and the remedy; two empty texts if it can."""
    try:
        is_valid = call_in_process(check_login, limit_s=deadline_s)
    except WorkerEndedError as ended:
        if ended.exit_code is None:
            return f"no answer within {deadline_s:g} s", _REACH
        failure: Exception = ended
    except Exception as error:  # noqa: BLE001 - of the client or of its libraries
        failure = error
    else:
        if is_valid is None:
            return "the service can't be reached", _REACH
        refused = ("the service refuses the user name or the password", f"check {LOGIN}")
        return ("", "") if is_valid else refused
    last = without_secrets(one_line(failure))[:_MAX_MESSAGE_LENGTH]
    return f"the client failed: {last}", "install copernicusmarine again"


def check_login() -> bool | None:
    """Ask whether the service takes the account; None if it can't be reached."""
    import copernicusmarine

    try:
        return bool(copernicusmarine.login(check_credentials_valid=True))
    except copernicusmarine.CouldNotConnectToAuthenticationSystem:
        return None


# urllib3's log line of an answer: ... "GET /path HTTP/1.1" 403 243
_ANSWER = re.compile(r'"GET (?P<address>\S+) HTTP/[\d.]+" (?P<status>\d{3})')
_CHUNK = re.compile(r"(?P<store>.*\.zarr)/(?P<variable>\w+)/(?P<index>\d+(\.\d+)*)")
# Status codes for a chunk that the store does not have; the client then fills it with gaps.
_NOT_FOUND = (403, 404)


class NotCoveredError(Exception):
    """The dataset does not have all of the requested steps."""


class AnswerLog(logging.Handler):
    """Collects from urllib3's log which chunks were missing: the client does not report them."""

    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self.missing_chunks: set[tuple[str, tuple[int, ...]]] = set()
        self.missing_axes: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        """Note a missing chunk; report an error of the service on standard error."""
        answer = _ANSWER.search(record.getMessage())
        if answer is None:
            return
        path, status = urlsplit(answer["address"]).path, int(answer["status"])
        chunk = _CHUNK.fullmatch(path)
        if chunk and status in _NOT_FOUND:
            index = tuple(int(number) for number in chunk["index"].split("."))
            if len(index) > 1:
                self.missing_chunks.add((chunk["store"], index))
            else:
                self.missing_axes.add(chunk["variable"])
        elif status >= 500:
            sys.stderr.write(f"the service answers {status} for {path}\n")
            sys.stderr.flush()


def answer_request(request: dict[str, Any]) -> dict[str, object] | None:
    """Download what a request asks for.

    The request has the dataset, the labels of the time steps, whether the last of them `may_lack`,
    and the other arguments of `copernicusmarine.subset`. The dataset's own time axis is looked up,
    and exactly those steps are downloaded. Without `subset` the time steps are only looked up.

    Returns what was got, or the client's `error`; None if the client returned nothing and raised
    nothing, as it does without credentials.
    """
    log = AnswerLog()
    logger = logging.getLogger("urllib3.connectionpool")
    logger.setLevel(logging.DEBUG)
    logger.addHandler(log)
    try:
        return _download(request, log)
    except Exception as error:  # noqa: BLE001 - any error is reported; the caller decides
        lacking = "".join(f"; the service lacks its {axis}" for axis in sorted(log.missing_axes))
        return {"error": type(error).__name__, "said": f"{clean(str(error))}{lacking}"}


def _download(request: dict[str, Any], log: AnswerLog) -> dict[str, object] | None:
    """Look up the steps, download them, and return the release and the missing chunks."""
    # Imported here: it takes seconds, and the parent process imports this module, too.
    import copernicusmarine

    arguments = request.get("subset", request)
    described = copernicusmarine.describe(
        dataset_id=arguments["dataset_id"], show_all_versions=True, disable_progress_bar=True
    )
    dataset = described.products[0].datasets[0]
    version = dataset.get_version(request["version"] or None)
    part = version.get_part(None)
    times = _time_axis(part, arguments["variables"][0])
    if "subset" not in request:
        return {"version": version.label, "last_step": times[-1].isoformat()}
    label_format, labels = request["label_format"], request["labels"]
    if request["may_lack"]:
        last = times[-1].strftime(label_format)
        # One step alone does not show how currents change.
        labels = [*labels[:2], *(label for label in labels[2:] if label <= last)]
    stamps = _with_labels(times, label_format, labels)
    answer = copernicusmarine.subset(
        **arguments,
        dataset_version=version.label,
        dataset_part=part.name,
        start_datetime=stamps[0].strftime("%Y-%m-%dT%H:%M:%SZ"),
        end_datetime=stamps[-1].strftime("%Y-%m-%dT%H:%M:%SZ"),
    )
    if answer is None:
        return None
    boxes = sorted(_chunk_box(part, store, index) for store, index in log.missing_chunks)
    return {
        "version": version.label,
        "part": part.name,
        "stamps": [stamps[0].isoformat(), stamps[-1].isoformat()],
        "missing_boxes": boxes,
    }


def _time_axis(part: Any, variable: str) -> list[datetime]:  # noqa: ANN401 - the client has no types
    """Return all time steps of a variable, UTC."""
    for service in part.services:
        for listed in service.variables:
            for axis in listed.coordinates:
                if listed.short_name == variable and axis.coordinate_id == "time":
                    return sorted(_utc(value) for value in _values(axis))
    raise NotCoveredError(f"it lists no time steps for a variable {variable!r}")


def _values(axis: Any) -> list[Any]:  # noqa: ANN401 - the same
    """Return values of an axis that the catalogue lists, or gives by its limits and its step."""
    if axis.values:
        return list(axis.values)
    count = round((axis.maximum_value - axis.minimum_value) / axis.step) + 1
    return [axis.minimum_value + axis.step * index for index in range(count)]


def _utc(value: float | str) -> datetime:
    """Return a time of the catalogue, which is given in milliseconds since 1970 or as text."""
    if isinstance(value, str):
        moment = datetime.fromisoformat(value)
        return moment.astimezone(UTC) if moment.tzinfo else moment.replace(tzinfo=UTC)
    return datetime.fromtimestamp(value / 1000, UTC)


def _with_labels(
    times: Sequence[datetime], label_format: str, labels: Sequence[str]
) -> list[datetime]:
    """Return the times of the steps with these labels; NotCoveredError where one is not there."""
    wanted = set(labels)
    at_labels = [time for time in times if time.strftime(label_format) in wanted]
    lacking = sorted(wanted - {time.strftime(label_format) for time in at_labels})
    if lacking:
        around = around_missing([time.strftime(label_format) for time in times], lacking[0])
        raise NotCoveredError(
            f"it covers {times[0]:%Y-%m-%d} to {times[-1]:%Y-%m-%d}, and lacks {len(lacking)} of "
            f"the {len(wanted)} steps requested, the first {lacking[0]}{around}"
        )
    return at_labels


def _chunk_box(part: Any, store: str, index: tuple[int, ...]) -> tuple[float, float, float, float]:  # noqa: ANN401 - the same
    """Return bounds of a chunk, degrees: the centres of its outermost cells."""
    for service in part.services:
        # The bucket's name may be part of the path or of the host name.
        if urlsplit(service.uri).path.endswith(store):
            axes = {axis.coordinate_id: axis for axis in service.variables[0].coordinates}
            south, north = _chunk_range(axes["latitude"], index[-2])
            west, east = _chunk_range(axes["longitude"], index[-1])
            return (west, south, east, north)
    raise LookupError(f"a chunk of {store} is missing, which is not in the catalogue")


def _chunk_range(axis: Any, index: int) -> tuple[float, float]:  # noqa: ANN401 - the same
    """Return the first and last value of an axis in one of its chunks."""
    length = int(axis.chunking_length)
    values = _values(axis)[index * length : (index + 1) * length]
    return (float(values[0]), float(values[-1]))


def around_missing(steps: Sequence[str], missing: str) -> str:
    """Say between which steps, by their ascending labels, one is missing; empty at an end."""
    before = [step for step in steps if step < missing]
    after = [step for step in steps if step > missing]
    return f", between {before[-1]} and {after[0]}" if before and after else ""
