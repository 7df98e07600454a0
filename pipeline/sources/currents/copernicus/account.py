"""The account at the Copernicus Marine Service: whether there is one, and keeping it secret."""

import base64
import binascii
import os
import re
from pathlib import Path
from urllib.parse import quote, quote_plus

USERNAME = "COPERNICUSMARINE_SERVICE_USERNAME"
PASSWORD = "COPERNICUSMARINE_SERVICE_PASSWORD"  # noqa: S105 - the variable's name
LOGIN = f"{USERNAME} and {PASSWORD}, or run `copernicusmarine login`"
"""What the client signs in with, behind "set" or "check"."""
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
