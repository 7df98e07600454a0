"""Report to a monitoring service that a night begins, succeeds or fails: `--ping URL`.

URL/start, URL or URL/fail is requested, as healthchecks.io and similar services expect. The service
sends an alert if no report arrives, which a job that did not run can't do. The address is a
credential: messages show only its host.
"""

import http.client
import threading
import urllib.error
import urllib.request
from typing import Literal
from urllib.parse import urlsplit, urlunsplit

from pipeline.errors import RequestError
from pipeline.nightly.prometheus import SUCCESSES

Ping = Literal["start", "success", "failure"]
_ENDINGS: dict[Ping, str] = {"start": "/start", "success": "", "failure": "/fail"}
# Exit codes that are not reported: another job is running, and the currents are not available yet.
# If no later run succeeds, the service gets no report and sends an alert.
_UNTOLD = frozenset({4, 5})
# Time limits for each step of a connection, and for the whole, s: a name lookup has no own limit.
_TIMEOUT_S, _DEADLINE_S = 5.0, 10.0


def check_url(url: str) -> None:
    """Check that a text can be the address of a check at a monitoring service.

    Raises
    ------
    RequestError
        The address is not http or https, has no host, a bad port, a user name or bad characters.
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
        raise RequestError([fault])


def report_for(exit_code: int) -> Ping | None:
    """Return the report for an exit code of a night; None for no report."""
    if exit_code in _UNTOLD:
        return None
    return "success" if exit_code in SUCCESSES else "failure"


def ping(url: str, what: Ping) -> str:
    """Send a report to the service; return "" or one line on why that failed, without raising.

    :func:`check_url` must accept `url`. The call takes at most `_DEADLINE_S`.
    """
    parts = urlsplit(url)
    address = urlunsplit(parts._replace(path=parts.path.rstrip("/") + _ENDINGS[what], fragment=""))
    answers: list[str] = []
    thread = threading.Thread(target=lambda: answers.append(_asked(address)), daemon=True)
    thread.start()
    thread.join(_DEADLINE_S)
    fault = answers[0] if answers else f"no answer within {_DEADLINE_S:g} s"
    host = f"{parts.hostname}:{parts.port}" if parts.port else parts.hostname
    return f"--ping: {host} was not told of the {what}: {fault}" if fault else ""


def _asked(address: str) -> str:
    """Request an address; return "" or why that failed, without the address."""
    try:
        with urllib.request.urlopen(address, timeout=_TIMEOUT_S):  # noqa: S310 - http or https alone
            return ""
    except urllib.error.HTTPError as error:
        return f"it answered {error.code}"
    except urllib.error.URLError as error:
        reason = error.reason
        return (
            reason.strerror or type(reason).__name__ if isinstance(reason, OSError) else "refused"
        )
    except (OSError, http.client.HTTPException, ValueError) as error:
        # The error's text is left out: it may quote the address.
        return type(error).__name__
