"""Report a night: its progress as JSON, its end to a monitoring service."""

import http.client
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Literal
from urllib.parse import urlsplit, urlunsplit

from pipeline.cli.failures import exit_code_of, reporting_end
from pipeline.cli.terminal import json_lines, log_event
from pipeline.errors import RequestError
from pipeline.nightly.night import NightEvent, NightEventHandler, NightOutcome

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
    night: Callable[[], NightOutcome], *, url: str | None, on_event: NightEventHandler
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
        is_plain = url.isascii() and url.isprintable() and " " not in url
        usable = usable and parts.username is None and is_plain
    except ValueError:
        usable = False
    if not usable:
        # The value is not repeated: it may be a credential in the wrong place.
        raise RequestError(
            "--ping is not a usable address: give the address of the check, as in "
            "https://HOST/ID, without a user name"
        )


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
