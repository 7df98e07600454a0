"""Report a night: its progress as JSON, its end to a monitoring service and a metrics file."""

import http.client
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Literal
from urllib.parse import urlsplit, urlunsplit

from pipeline.cli.failures import exit_code_of, reporting_end
from pipeline.cli.terminal import json_lines, log_event
from pipeline.errors import RequestError
from pipeline.machine.files import whole_file
from pipeline.nightly.cycles import BusyError
from pipeline.nightly.night import NightEvent, NightEventHandler, NightOutcome

if TYPE_CHECKING:
    from prometheus_client import CollectorRegistry


# Minimum time between two lines on the progress of a stage, s.
_PROGRESS_S = 10.0
Ping = Literal["start", "success", "failure"]
_ENDINGS: dict[Ping, str] = {"start": "/start", "success": "", "failure": "/fail"}
# Exit codes that are not reported: another job is running, and the currents are not available yet.
# If no later run succeeds, the service gets no report and then sends an alert.
_UNTOLD = frozenset({4, 5})
# Time limit for each step of a connection, s.
_TIMEOUT_S = 5.0
# Time limit for the whole, s: a name lookup has no limit of its own.
_DEADLINE_S = 10.0
SUCCESSES = frozenset({0, 10})
"""Exit codes of a night that published its cycle, or had nothing to do."""

_LAST_SUCCESS = "renew_nightly_last_success_timestamp_seconds"
_FORECAST = "renew_nightly_forecast_reference_timestamp_seconds"
_HELP = {
    _LAST_SUCCESS: "End of the last night that published its cases or had nothing to do.",
    _FORECAST: "Reference time of the currents of the last successful night.",
    "renew_nightly_last_run_timestamp_seconds": "End of the last night, successful or not.",
    "renew_nightly_last_exit_code": "Exit code of the last night; 0 and 10 are successes.",
    "renew_nightly_stage_seconds": "Wall time of each stage of the last night.",
    "renew_nightly_cases": "Cases of the last night, by how they ended.",
}


def night_progress() -> NightEventHandler:
    """Return the event handler that logs to standard error."""
    log = json_lines(sys.stderr)
    said = 0.0

    def on_event(event: NightEvent) -> None:
        nonlocal said
        fields: dict[str, object] = {"stage": event.stage}
        if event.status == "working":
            if time.monotonic() - said < _PROGRESS_S and event.done < event.total:
                return
            said = time.monotonic()
            fields |= {"done": event.done, "total": event.total}
        if event.detail:
            fields["detail"] = event.detail
        if event.seconds:
            fields["seconds"] = round(event.seconds, 3)
        log_event(log, event.status, fields)

    return on_event


def watched(
    night: Callable[[], NightOutcome],
    *,
    metrics: Path | None,
    url: str | None,
    on_event: NightEventHandler,
) -> NightOutcome:
    """Run a night and report it; if the report fails, there is only a note.

    Raises RequestError if the address is not valid.
    """
    if url:
        check_url(url)
        _note(ping(url, "start"), on_event)
    started = datetime.now(UTC)
    reported: list[NightOutcome] = []
    lock = threading.Lock()

    def report(outcome: NightOutcome) -> None:
        """Report the end exactly once, even if a signal arrives meanwhile."""
        with lock:
            if reported:
                return
            # If another job was running, that job writes the metrics.
            if metrics is not None and outcome.exit_code != BusyError.exit_code:
                _note(write_metrics(metrics, outcome), on_event)
            if url and (what := report_for(outcome.exit_code)) is not None:
                _note(ping(url, what), on_event)
            reported.append(outcome)

    def report_failure(exit_code: int) -> None:
        report(NightOutcome("", started, datetime.now(UTC), None, exit_code, {}, {}))

    with reporting_end(report_failure):
        try:
            outcome = night()
        except BaseException as error:
            report_failure(exit_code_of(error))
            raise
        report(outcome)
    return outcome


def _note(fault: str, on_event: NightEventHandler) -> None:
    """Report a fault as an event, unless it is ""."""
    if fault:
        on_event(NightEvent("publish", "note", fault))


def check_url(url: str) -> None:
    """Check that a text can be the address of a check at a monitoring service.

    Raises RequestError if the address is not http or https, has no host, a bad port, a user name or
    bad characters.
    """
    try:
        parts = urlsplit(url)
        usable = parts.scheme in {"http", "https"} and bool(parts.hostname) and parts.port != 0
        usable = (
            usable
            and parts.username is None
            and url.isascii()
            and url.isprintable()
            and " " not in url
        )
    except ValueError:
        usable = False
    if not usable:
        # The value is not repeated: it may be a credential in the wrong place.
        fault = (
            "--ping is not a usable address: give the address of the check, as in "
            "https://HOST/ID, without a user name"
        )
        raise RequestError(fault)


def report_for(exit_code: int) -> Ping | None:
    """Return the report for an exit code of a night; None for no report."""
    if exit_code in _UNTOLD:
        return None
    return "success" if exit_code in SUCCESSES else "failure"


def ping(url: str, what: Ping) -> str:
    """Send a report to the service; return "" or one line on why that failed, without raising.

    URL/start, URL or URL/fail is requested, as healthchecks.io and similar services expect. The
    service sends an alert if no report arrives, which covers a job that did not run. The address
    is a credential, so messages show only its host. :func:`check_url` must accept the address. The
    call takes at most `_DEADLINE_S`.
    """
    parts = urlsplit(url)
    address = urlunsplit(parts._replace(path=parts.path.rstrip("/") + _ENDINGS[what], fragment=""))
    answers: list[str] = []
    thread = threading.Thread(target=lambda: answers.append(_asked(address)), daemon=True)
    thread.start()
    thread.join(_DEADLINE_S)
    fault = answers[0] if answers else f"no answer within {_DEADLINE_S:g} s"
    host = f"{parts.hostname}:{parts.port}" if parts.port else parts.hostname
    return f"--ping: reporting the {what} to {host} failed: {fault}" if fault else ""


def _asked(address: str) -> str:
    """Request an address; return "" or the reason of a failure, without the address."""
    try:
        with urllib.request.urlopen(address, timeout=_TIMEOUT_S):  # noqa: S310 - http or https alone
            return ""
    except urllib.error.HTTPError as error:
        with error:
            return f"it answered {error.code}"
    except urllib.error.URLError as error:
        reason = error.reason
        return (
            reason.strerror or type(reason).__name__ if isinstance(reason, OSError) else "refused"
        )
    except (OSError, http.client.HTTPException, ValueError) as error:
        # The error's text is left out: it may quote the address.
        return type(error).__name__


def write_metrics(path: Path, outcome: NightOutcome) -> str:
    """Replace the file atomically with a night's metrics; return "" or the reason of a failure.

    Prometheus' node exporter reads the file
    (https://prometheus.io/docs/instrumenting/exposition_formats/, text, version 0.0.4). It has
    timestamps instead of ages, because timestamps stay correct if the file is not updated. After a
    failed night the timestamps of the last success stay. The caller does not call this for a job
    that ended because another one was running (exit code 4).
    """
    from prometheus_client import generate_latest

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as file:
            file.write(generate_latest(_registry(outcome, _last_success(path))))
    except OSError as error:
        return f"--metrics: can't write {path}: {error.strerror or error}"
    return ""


def _registry(outcome: NightOutcome, earlier: Mapping[str, float]) -> "CollectorRegistry":
    """Return the metrics of a night; `earlier` has the timestamps of the last success before it."""
    from prometheus_client import CollectorRegistry, Gauge

    times = dict(earlier)
    if outcome.exit_code in SUCCESSES:
        times[_LAST_SUCCESS] = outcome.finished.timestamp()
        if outcome.reference_time is not None:
            times[_FORECAST] = outcome.reference_time.timestamp()
    times["renew_nightly_last_run_timestamp_seconds"] = outcome.finished.timestamp()
    single = {**times, "renew_nightly_last_exit_code": outcome.exit_code}
    registry = CollectorRegistry()
    for name, value in single.items():
        Gauge(name, _HELP[name], registry=registry).set(value)
    for name, label, values in (
        ("renew_nightly_stage_seconds", "stage", outcome.seconds_by_stage),
        ("renew_nightly_cases", "outcome", outcome.cases_by_outcome),
    ):
        gauge = Gauge(name, _HELP[name], [label], registry=registry)
        for key, number in values.items():
            gauge.labels(key).set(round(number, 3))
    return registry


def _last_success(path: Path) -> dict[str, float]:
    """Return the timestamps of the last success in an earlier file, or {} without such a file."""
    from prometheus_client.parser import text_string_to_metric_families

    try:
        families = list(text_string_to_metric_families(path.read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return {}
    return {
        family.name: family.samples[0].value
        for family in families
        if family.name in {_LAST_SUCCESS, _FORECAST}
    }
