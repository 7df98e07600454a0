"""What several writers need: values for JSON, templates, and errors of the system."""

import errno
import json
import math
import re
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup, escape

if TYPE_CHECKING:
    from jinja2 import Environment

# Characters in an attribute that a reader of XML would take for other white space.
_WHITE_SPACE = {"\t": "&#9;", "\n": "&#10;", "\r": "&#13;"}
XML_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 can't write, among them lone halves of a surrogate pair."""

# Free space, bytes, below which a failed write means a full disk; more than SQLite's journal.
_FULL_BELOW_BYTES = 16 * 2**20


def write_json(path: Path, content: object, indent: int | None = 2) -> None:
    """Write a new file of JSON (UTF-8), with `null` for numbers that are not finite."""
    text = json.dumps(json_value(content), indent=indent, ensure_ascii=False, allow_nan=False)
    path.write_text(f"{text}\n", encoding="utf-8")


def json_value(value: Any) -> Any:  # noqa: ANN401 - any value in, one that JSON knows out
    """Convert a value, and everything nested in it, for JSON.

    NumPy's types become Python's, numbers that are not finite become None, texts encodable.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, str):
        return encodable_text(value)
    if isinstance(value, dict):
        return {key: json_value(item) for key, item in value.items()}
    if isinstance(value, list):
        return [json_value(item) for item in value]
    return value


def encodable_text(text: str) -> str:
    """Replace lone halves of a surrogate pair, which no encoding has, by U+FFFD."""
    return text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")


def environment(
    *packages: str, finalize: Callable[[object], object] | None = None
) -> "Environment":
    """Load the templates of some packages; values are escaped, and a missing one is an error.

    If several packages have a template, the first one's is used.
    """
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=ChoiceLoader([PackageLoader(package) for package in packages]),
        autoescape=True,
        finalize=finalize,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


@cache
def xml_environment(package: str) -> "Environment":
    """Load a package's templates of XML; characters that XML forbids are replaced."""
    return environment(package, finalize=_escaped)


def _escaped(value: object) -> Markup:
    """Escape a value for an attribute or an element, unless it is XML already."""
    if isinstance(value, Markup):
        return value
    text = escape(xml_text(str(value)))
    for character, reference in _WHITE_SPACE.items():
        text = text.replace(character, Markup(reference))  # noqa: S704 - our own
    return text


def xml_text(text: str) -> str:
    """Replace characters that XML forbids by U+FFFD; markup is not escaped here."""
    return XML_FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)


def os_error(path: Path, error: Exception) -> OSError:
    """Turn an error of GDAL, SQLite or HDF5 into an OSError: ENOSPC if the disk is full, else EIO.

    These libraries hide the system's own error.
    """
    full = shutil.disk_usage(path.parent).free < _FULL_BELOW_BYTES
    return OSError(errno.ENOSPC if full else errno.EIO, f"{path.name}: {error}")
