"""Texts from outside: names in charts, attributes, keys of TOML, messages of libraries, cells.

They end on a terminal, in XML, in a spreadsheet. Each passes `clean` where it comes in, so no
output has to look again. Texts of our own are in tables, which `table_beside` reads.
"""

import re
import tomllib
import unicodedata
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

# Controls, halves of surrogate pairs and what is no character: terminals obey some (escape
# sequences set titles and the clipboard), and XML can't hold them.
_CONTROLS = re.compile("[\0-\x08\x0e-\x1b\x7f-\x84\x86-\x9f\ud800-\udfff\ufdd0-\ufdef\ufffe\uffff]")
# Format characters of Unicode (Cf) that turn the direction of text round or can't be seen. Joiners
# (U+200C, U+200D) stay, as Persian, Indic scripts and emoji need them.
_UNSEEN = re.compile(
    "[\xad\u061c\u180e\u200b\u200e\u200f\u202a-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb"
    "\U000e0000-\U000e007f]"
)
# Ends of lines, and tabs.
_LINES = re.compile("[\t-\r\x1c-\x1f\x85\u2028\u2029]")
# What a spreadsheet takes for a formula at the beginning of a cell.
_FORMULA = tuple("=+-@\t\r\uff1d\uff0b\uff0d\uff20")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)


def clean(text: str, limit: int = 2000) -> str:
    """Return a text on one line, composed (NFC), of at most `limit` characters.

    What a terminal obeys becomes U+FFFD; what can't be seen is dropped.
    """
    line = " ".join(unicodedata.normalize("NFC", seen(text[: 4 * limit])).split())
    return line if len(line) <= limit else f"{line[: limit - 1]}…"


def seen(text: str) -> str:
    """Return a text of several lines without what a terminal obeys or doesn't show."""
    return _UNSEEN.sub("", _CONTROLS.sub("\N{REPLACEMENT CHARACTER}", text))


def with_texts(value: object, change: Callable[[str], str]) -> object:
    """Return a value for JSON with its texts changed, except keys; tuples become lists."""
    if isinstance(value, str):
        return change(value)
    if isinstance(value, dict):
        return {key: with_texts(one, change) for key, one in value.items()}
    return [with_texts(one, change) for one in value] if isinstance(value, list | tuple) else value


def acts(name: str) -> str:
    """Say which character of a file's name `clean` would take out; empty if there is none."""
    acting = _CONTROLS.search(name) or _UNSEEN.search(name) or _LINES.search(name)
    if acting is None:
        return ""
    if "\ud800" <= acting[0] <= "\udfff":
        return "a byte that is not UTF-8"
    return f"U+{ord(acting[0]):04X}, which acts on screens"


def in_years(moment: datetime) -> datetime:
    """Return a moment; ValueError where its year is none in which every library's clock runs."""
    if not 1700 <= moment.year < 2200:
        raise ValueError(f"= {moment.isoformat()} is not in the years 1700 to 2199")
    return moment


def table_beside(module: str, name: str) -> dict[str, Any]:
    """Read one of our own tables, a file of TOML beside a module that gives its `__file__`."""
    return tomllib.loads(Path(module).with_name(name).read_text(encoding="utf-8"))


def cell(value: object) -> object:
    """Return a value for a CSV file; a text that a spreadsheet takes for a formula gets a '."""
    if not isinstance(value, str) or len(value) < 2 or _NUMBER.fullmatch(value):
        return value
    return f"'{value}" if value.startswith(_FORMULA) else value
