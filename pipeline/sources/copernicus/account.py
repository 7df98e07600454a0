"""The account at the Copernicus Marine Service: whether there is one, keeping it secret, its login.

The client itself checks the login in a process of its own, for which this file is run as a module:
the client takes seconds to import, and waits for an answer without a limit of time.
"""

import base64
import binascii
import contextlib
import os
import re
import sys
from pathlib import Path
from urllib.parse import quote, quote_plus

from pipeline.machine.interpreters import run_python

USERNAME = "COPERNICUSMARINE_SERVICE_USERNAME"
PASSWORD = "COPERNICUSMARINE_SERVICE_PASSWORD"  # noqa: S105 - the variable's name
LOGIN = f"{USERNAME} and {PASSWORD}, or run `copernicusmarine login`"
"""The client's means to sign in, for a message behind "set" or "check"."""
# The client's own file, under COPERNICUSMARINE_CREDENTIALS_DIRECTORY or the home directory.
_FOLDER, _FILE = ".copernicusmarine", ".copernicusmarine-credentials"
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
    """Path of the file in which `copernicusmarine login` stores the credentials."""
    folder = os.environ.get("COPERNICUSMARINE_CREDENTIALS_DIRECTORY")
    return (Path(folder) if folder else Path.home()) / _FOLDER / _FILE


def without_secrets(text: str) -> str:
    """Replace in a text all credentials that are known here, and any in an address."""
    secrets = _secrets()
    # As they are, and as an address or a form encodes them.
    encoded = {encode(secret) for secret in secrets for encode in (str, quote, quote_plus)}
    for secret in sorted(encoded, key=len, reverse=True):
        text = text.replace(secret, _HIDDEN)
    return _IN_ADDRESSES.sub(_HIDDEN, text)


def _secrets() -> set[str]:
    """User names and passwords of the environment and of the client's own file."""
    found = {os.environ.get(USERNAME, ""), os.environ.get(PASSWORD, "")}
    try:
        stored = base64.standard_b64decode(credentials_file().read_bytes()).decode("utf-8")
    except (OSError, binascii.Error, UnicodeDecodeError):
        stored = ""
    # As configparser reads it; in a damaged file, every line.
    for line in stored.splitlines():
        name, _, value = line.replace(":", "=", 1).partition("=")
        found.add(value.strip() if value else name.strip("[] "))
    return found - {"", "credentials"}


_VALID, _REFUSED, _UNREACHABLE = 0, 3, 4
# Maximum length of the client's message in a fault, characters.
_MAX_MESSAGE_LENGTH = 200
_REACH = "check the connection to auth.marine.copernicus.eu, and the proxy"


def login_fault(deadline_s: float) -> tuple[str, str]:
    """Return why the account can't be used now, and the remedy; two empty texts if it can."""
    result = run_python(["-m", __name__], "", deadline_s)
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
