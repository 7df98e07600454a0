"""The account at the Copernicus Marine Service: whether there is one, and that nobody reads it."""

from __future__ import annotations

import base64
import binascii
import os
import re
from pathlib import Path
from urllib.parse import quote, quote_plus

USERNAME = "COPERNICUSMARINE_SERVICE_USERNAME"
PASSWORD = "COPERNICUSMARINE_SERVICE_PASSWORD"  # noqa: S105 - the variable's name
# The client's own file, under COPERNICUSMARINE_CREDENTIALS_DIRECTORY or the home directory.
_FOLDER, _FILE = ".copernicusmarine", ".copernicusmarine-credentials"
# The client puts the account's name into every address, and a proxy's password may stand in its.
_IN_ADDRESSES = re.compile(r"(?<=x-cop-user=)[^&\s'\"]+|(?<=://)[^/@\s'\"]+(?=@)")
_HIDDEN = "***"


def has_account() -> bool:
    """Whether the client will find a name and a password."""
    return bool(os.environ.get(USERNAME) and os.environ.get(PASSWORD)) or (
        credentials_file().is_file()
    )


def credentials_file() -> Path:
    """Where the client keeps the credentials of `copernicusmarine login`."""
    folder = os.environ.get("COPERNICUSMARINE_CREDENTIALS_DIRECTORY")
    return (Path(folder) if folder else Path.home()) / _FOLDER / _FILE


def without_secrets(text: str) -> str:
    """Blank every credential that is known here, and any in an address, out of a text."""
    secrets = _secrets()
    # As they are, and as they stand in an address or a form.
    spelled = {spell(secret) for secret in secrets for spell in (str, quote, quote_plus)}
    for secret in sorted(spelled, key=len, reverse=True):
        text = text.replace(secret, _HIDDEN)
    return _IN_ADDRESSES.sub(_HIDDEN, text)


def _secrets() -> set[str]:
    """User names and passwords of the environment and of the client's own file."""
    found = {os.environ.get(USERNAME, ""), os.environ.get(PASSWORD, "")}
    try:
        stored = base64.standard_b64decode(credentials_file().read_bytes()).decode("utf-8")
    except (OSError, binascii.Error, UnicodeDecodeError):
        stored = ""
    # As configparser would read it; and where it is not as it should be, whatever stands there.
    for line in stored.splitlines():
        name, _, value = line.replace(":", "=", 1).partition("=")
        found.add(value.strip() if value else name.strip("[] "))
    return found - {"", "credentials"}
