"""Tells a service that watches jobs that a night begins, ends well, or fails: `--ping URL`.

In the manner of healthchecks.io and what speaks like it: URL/start, URL, URL/fail. The service
calls somebody when nothing comes, which no job can do for itself. An address is a credential: no
message here has more of it than the host.
"""

from __future__ import annotations

import http.client
import threading
import urllib.error
import urllib.request
from typing import Literal
from urllib.parse import SplitResult, urlsplit, urlunsplit

from pipeline.errors import RequestError
from pipeline.nightly.prometheus import SUCCESSES

Ping = Literal["start", "success", "failure"]
_ENDINGS: dict[Ping, str] = {"start": "/start", "success": "", "failure": "/fail"}
# Exit codes that are not reported: another job is at work, and the currents are not there yet.
# If no later try succeeds, the service misses the success, and says so.
_UNTOLD = frozenset({4, 5})
# Time for each step of a connection, and for all of it, s: looking a name up knows no limit.
_TIMEOUT_S, _DEADLINE_S = 5.0, 10.0


def check_url(url: str) -> None:
    """Refuse what is no address to be asked.

    Raises
    ------
    RequestError
        No http or https, no host, no number as its port, or a user's name in it.
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
            "--ping is no address that can be asked: give that of the check, as in "
            "https://HOST/ID, without a user name"
        )
        raise RequestError([fault])


def told_by(exit_code: int) -> Ping | None:
    """What to tell of a night that ended with an exit code; None for nothing."""
    if exit_code in _UNTOLD:
        return None
    return "success" if exit_code in SUCCESSES else "failure"


def ping(url: str, what: Ping) -> str:
    """Tell the service; "" or one line why it could not be told. It never raises.

    `url` is one that :func:`check_url` accepts. It ends within `_DEADLINE_S`.
    """
    parts = urlsplit(url)
    address = urlunsplit(parts._replace(path=parts.path.rstrip("/") + _ENDINGS[what], fragment=""))
    answers: list[str] = []
    thread = threading.Thread(target=lambda: answers.append(_asked(address)), daemon=True)
    thread.start()
    thread.join(_DEADLINE_S)
    fault = answers[0] if answers else f"no answer within {_DEADLINE_S:g} s"
    return f"--ping: {_host(parts)} was not told of the {what}: {fault}" if fault else ""


def _asked(address: str) -> str:
    """Ask for an address; "" or what went wrong, without the address."""
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
        # Not the text of it, which may quote the address.
        return type(error).__name__


def _host(parts: SplitResult) -> str:
    """The host of an address, and its port where that is given."""
    return f"{parts.hostname}:{parts.port}" if parts.port else str(parts.hostname)
