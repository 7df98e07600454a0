"""Checks the login at the Copernicus Marine Service, by the client's own check.

Run as a process of its own: the client takes seconds to import, and waits for an answer without a
limit of time.
"""

import contextlib
import os
import sys

from pipeline.machine.interpreters import run_python
from pipeline.sources.currents.copernicus.account import LOGIN, without_secrets

_VALID, _REFUSED, _UNREACHABLE = 0, 3, 4
# Maximum length of the client's message in a fault, characters.
_MAX_MESSAGE_LENGTH = 200
_REACH = "check the connection to auth.marine.copernicus.eu, and the proxy"


def login_fault(deadline_s: float) -> tuple[str, str]:
    """Return why the account can't be used now, and the remedy; two empty texts if it can."""
    module = "pipeline.sources.currents.copernicus.login"
    result = run_python(["-m", module], "", deadline_s)
    if result.exit_code is None:
        return f"no answer within {deadline_s:g} s", _REACH
    last = without_secrets(result.stderr.strip().rpartition("\n")[2])[:_MAX_MESSAGE_LENGTH]
    return {
        _VALID: ("", ""),
        _REFUSED: (
            "the service refuses the user name or the password",
            f"check {LOGIN}",
        ),
        _UNREACHABLE: ("the service can't be reached", _REACH),
    }.get(result.exit_code, (f"the client failed: {last}", "install copernicusmarine again"))


def main() -> int:
    """Ask the service; return the exit code."""
    import copernicusmarine

    try:
        with contextlib.redirect_stdout(sys.stderr):
            is_valid = copernicusmarine.login(check_credentials_valid=True)
    except copernicusmarine.CouldNotConnectToAuthenticationSystem:
        return _UNREACHABLE
    return _VALID if is_valid else _REFUSED


if __name__ == "__main__":
    code = main()
    sys.stderr.flush()
    # Not `sys.exit`, which waits for the client's threads.
    os._exit(code)
