"""Lines on a terminal: as long as it is wide, and broken between words only."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from pipeline.cli.terminal import table, wrapped

ROWS = (
    ("season", "rank", "way", "fuel"),
    ("july", "1", "west of Palawan and south-east of Bugsuk", "695.6"),
    ("july", "2", "east of Palawan", "+4.1 %"),
)


def test_a_wide_table_wraps_its_way() -> None:
    assert table(ROWS, 3, None) == table(ROWS, 3, 200)
    lines = table(ROWS, 3, 44)
    assert max(map(len, lines)) <= 44
    assert lines == [
        "season  rank  way                       fuel",
        "july    1     west of Palawan and      695.6",
        "              south-east of Bugsuk",
        "july    2     east of Palawan         +4.1 %",
    ]


def test_lines_break_between_words() -> None:
    text = "- the narrowest place needs --turning-circle, or a word-that-is-long\n\nend"
    assert wrapped(text, None) == text
    assert wrapped(text, 30).splitlines() == [
        "- the narrowest place needs",
        "  --turning-circle, or a",
        "  word-that-is-long",
        "",
        "end",
    ]


@pytest.mark.parametrize("columns", [60, 100])
def test_an_error_fits_the_terminal(columns: int, tmp_path: Path) -> None:
    """The program's standard error is a terminal of so many columns."""
    controller, terminal = pty.openpty()
    script = textwrap.dedent(
        """
        from pipeline.cli.main import app
        app(["run", "palawan-saeson", "--currents", "nowhere"])
        """
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        stderr=terminal,
        stdout=subprocess.DEVNULL,
        cwd=tmp_path,
        env={**os.environ, "COLUMNS": str(columns)},
        check=False,
        timeout=120,
    )
    os.close(terminal)
    lines = os.read(controller, 10_000).decode().splitlines()
    os.close(controller)
    assert done.returncode == 2
    assert lines[0].startswith("error: no scenario 'palawan-saeson'")
    assert max(map(len, lines)) <= columns
    assert len(lines) == (2 if columns == 60 else 1)
