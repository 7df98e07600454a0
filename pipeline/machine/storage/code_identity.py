"""One hash of all code that results depend on: both packages with their data files.

After any edit all stages are computed again. The imports could tell which stage depends on which
module, but if one import were overlooked, an old result would pass for a new one.
"""

import hashlib
import subprocess
from functools import cache
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[3]
_PACKAGES = ("pipeline", "renew")


@cache
def code_hash() -> str:
    """Return the SHA-256, hexadecimal, of the sources and data files of both packages."""
    digest = hashlib.sha256()
    for file in code_files():
        digest.update(file.relative_to(_ROOT).as_posix().encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()


def code_files() -> tuple[Path, ...]:
    """Return the sources and data files of both packages, sorted."""
    files = (path for package in _PACKAGES for path in (_ROOT / package).rglob("*"))
    return tuple(
        sorted(path for path in files if path.is_file() and "__pycache__" not in path.parts)
    )


@cache
def code_commit() -> str:
    """Return the commit of this checkout, with "-dirty" if files differ; empty outside one."""
    # An installed package may lie inside another project's checkout.
    if _git("rev-parse", "--show-toplevel") != str(_ROOT):
        return ""
    return _git("describe", "--always", "--dirty", "--abbrev=40", "--match=")


def _git(*words: str) -> str:
    """Return git's output for this folder; empty without git, or outside a checkout."""
    command = ["git", "-C", str(_ROOT), *words]
    try:
        told = subprocess.run(command, capture_output=True, check=True, text=True)  # noqa: S603 - words are this module's
    except (OSError, subprocess.CalledProcessError):
        return ""
    return told.stdout.strip()
