"""Line numbers of the keys of a TOML file, for messages about their values."""

import re
from dataclasses import dataclass, field

_HEADER = re.compile(r"^\s*(\[\[?)\s*([\w.\-]+)\s*\]\]?\s*(?:#.*)?$")
_KEY = re.compile(r"^\s*([\w\-]+)\s*=")
# The path that a fault of `pipeline.scenario.messages` begins with: `cases[0].departures.every`.
_PATH = re.compile(r"(?:unknown key )?([A-Za-z_][\w\-]*(?:\[\d+\])?(?:\.[\w\-]+(?:\[\d+\])?)*)")


@dataclass
class TomlLines:
    """Line numbers of a TOML file's keys; a key in an inline table has the table's line."""

    text: str
    _lines: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Read the tables' headers and the keys at the beginning of lines."""
        table, counts = "", dict[str, int]()
        for number, line in enumerate(self.text.splitlines(), start=1):
            if header := _HEADER.match(line):
                table = header[2]
                if header[1] == "[[":
                    counts[table] = counts.get(table, -1) + 1
                    table = f"{table}[{counts[table]}]"
                self._lines.setdefault(table, number)
            elif key := _KEY.match(line):
                path = f"{table}.{key[1]}" if table else key[1]
                self._lines.setdefault(path, number)

    def line(self, path: str) -> int:
        """Return the line (from 1) of a key or, if it is missing, of the table around it."""
        while path:
            if path in self._lines:
                return self._lines[path]
            shorter = path.rpartition(".")[0]
            path = shorter or ("" if "[" not in path else path.partition("[")[0])
        return 1

    def located(self, fault: str, file: str) -> str:
        """Put file and line before a fault that begins with a key's path."""
        found = _PATH.match(fault)
        return f"{file}, line {self.line(found[1]) if found else 1}: {fault}"
