"""Text on a terminal: lines are as long as the terminal is wide, and break between words only."""

import re
import shutil
import sys
import textwrap
from collections.abc import Sequence

import typer

# Least width to which text is wrapped, in characters, and least width of a table's wrapped column.
_MIN_WIDTH, _MIN_COLUMN = 40, 16
# The beginning of an entry of a list, whose further lines are indented.
_ENTRY = re.compile(r"- |error: |note: ")


def say(text: str, *, err: bool = False) -> None:
    """Print a text, wrapped if it goes to a terminal."""
    typer.echo(wrapped(text, terminal_width(err=err)), err=err)


def terminal_width(*, err: bool = False) -> int | None:
    """Return the width of the terminal, in characters; None for a file or a pipe."""
    stream = sys.stderr if err else sys.stdout
    return max(_MIN_WIDTH, shutil.get_terminal_size().columns) if stream.isatty() else None


def wrapped(text: str, width: int | None) -> str:
    """Break lines between words where they are longer than `width`; None keeps them."""
    if width is None:
        return text
    return "\n".join(
        textwrap.fill(
            line,
            width,
            subsequent_indent="  " if _ENTRY.match(line) else "",
            break_long_words=False,
            break_on_hyphens=False,
        )
        if len(line) > width
        else line
        for line in text.split("\n")
    )


def table(rows: Sequence[Sequence[str]], left: int, width: int | None) -> list[str]:
    """Return the lines of a table whose first `left` columns are aligned on their left.

    If it is wider than `width`, the last of these columns is wrapped.
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    excess = 0 if width is None else sum(widths) + 2 * (len(widths) - 1) - width
    if excess > 0:
        widths[left - 1] = max(min(widths[left - 1], _MIN_COLUMN), widths[left - 1] - excess)
    lines = []
    for row in rows:
        parts = [row[left - 1]]
        if len(parts[0]) > widths[left - 1]:
            parts = textwrap.wrap(parts[0], widths[left - 1], break_on_hyphens=False)
        for part in parts:
            cells = [cell if part is parts[0] else "" for cell in row]
            cells[left - 1] = part
            lines.append(
                "  ".join(
                    cell.ljust(size) if i < left else cell.rjust(size)
                    for i, (cell, size) in enumerate(zip(cells, widths, strict=True))
                ).rstrip()
            )
    return lines
