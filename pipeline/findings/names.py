"""Names in a run's outputs: folders, files, and their columns by one table, `columns.toml`."""

import hashlib
import re
import unicodedata
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from pipeline.texts import table_beside, with_texts

if TYPE_CHECKING:
    from pipeline.model import RouteMetrics


MANIFEST = "manifest.json"
# Maximum length of a file name that is derived from a text, in characters.
_MAX_NAME = 80
# Names that Windows reserves for devices.
_DEVICES = r"con|prn|aux|nul|com\d|lpt\d"


def output_directory(root: Path, name: str) -> Path:
    """Return the folder in `root` for the files of the scenario called `name`."""
    return root / safe_name(name)


def safe_name(name: str) -> str:
    """Return a file name that every system accepts; different texts give different names.

    Letters and digits of any script, `.`, `_` and `-` stay. If the text had to be changed, or is a
    device name in Windows, the name gets a short hash. At most 80 characters and 240 bytes.
    """
    normal = unicodedata.normalize("NFC", name)
    plain = re.sub(r"[^\w.-]+", "-", normal).strip("-.")[:_MAX_NAME]
    is_device = re.fullmatch(_DEVICES, plain.partition(".")[0], re.IGNORECASE)
    if plain and plain == name and len(plain.encode()) <= 240 and not is_device:
        return plain
    digest = hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()[:8]
    short = plain.encode()[:64].decode(errors="ignore").strip("-.")
    if is_device:
        return f"{digest}-{short}"
    return f"{short}-{digest}" if short else digest


SCHEMA_VERSION = 1
# An absolute path inside a text, of at least two parts: no address, fraction or tag.
_ABSOLUTE = re.compile(r"(?<![\w/:.])/(?:[^\s/'\"]+/)+([^\s/'\",;]+)")


def without_folders(value: object) -> object:
    """Return a value for JSON in whose texts files are named without their folders."""

    def named(text: str) -> str:
        return Path(text).name if Path(text).is_absolute() else _ABSOLUTE.sub(r"\1", text)

    return with_texts(value, named)


class Column(NamedTuple):
    """A column: its name for readers with the unit in brackets, its meaning, and its type.

    Attributes
    ----------
    type : "number", "whole", "text", "flag" or "time".
    attribute : of RouteMetrics, if the column is one of a route's figures.
    files : in which files that figure stands: "csv", "layer", "json" and "night".
    optional : whether it is left out where no row has a value.
    """

    alias: str
    meaning: str
    type: str = "number"
    attribute: str = ""
    files: tuple[str, ...] = ()
    optional: bool = False


COLUMNS = {
    name: Column(**{"attribute": name, **fields})
    for name, fields in table_beside(__file__, "columns.toml").items()
}


def figure_columns(file: str) -> tuple[str, ...]:
    """Return the columns of a route's figures in a kind of file."""
    return tuple(name for name, column in COLUMNS.items() if file in column.files)


def figures(metrics: "RouteMetrics", file: str) -> dict[str, Any]:
    """Return a route's figures for a kind of file, by column."""
    return {name: getattr(metrics, COLUMNS[name].attribute) for name in figure_columns(file)}


def used(columns: Iterable[str], rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return columns without the optional ones that are empty in all rows."""
    filled = {name for row in rows for name, value in row.items() if value not in {None, ""}}
    optional = {name for name, column in COLUMNS.items() if column.optional}
    return [name for name in columns if name in filled or name not in optional]
