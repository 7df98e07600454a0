"""Times over commits: `python -m tests.bench --save` appends them to docs/figures/bench.csv."""

from __future__ import annotations

import csv
import os
import platform
import statistics
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from tests.bench.record import FOLDER, code_commit
from tests.conftest import ROOT

HISTORY = FOLDER / "bench.csv"
PICTURE = ROOT / "docs" / "pictures" / "bench.svg"
LAST = 5
SLOWER = 1.3
_COLUMNS = 2


class Time(NamedTuple):
    """A time that was measured at a commit on a machine."""

    measured: str
    commit: str
    machine: str
    figure: str
    seconds: float


def now(figure: str, seconds: float) -> Time:
    """Give a time its day, commit and machine."""
    return Time(f"{datetime.now(UTC):%Y-%m-%d}", code_commit(), machine(), figure, seconds)


def machine() -> str:
    """Name of the processor and the number of cores that this process may use; no host name."""
    cores = len(os.sched_getaffinity(0))
    return f"{_processor(Path('/proc/cpuinfo'))}, {cores} core{'s' * (cores > 1)}"


def _processor(file: Path) -> str:
    """Name that Linux gives, else Python's for the kind."""
    lines = file.read_text("utf-8").splitlines() if file.is_file() else []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "") or platform.machine()


def saved(file: Path = HISTORY) -> list[Time]:
    """All times that were saved, the oldest first."""
    if not file.is_file():
        return []
    with file.open(newline="", encoding="utf-8") as opened:
        return [
            Time(**{**row, "seconds": float(row["seconds"])})  # type: ignore[arg-type]
            for row in csv.DictReader(opened)
        ]


def save(times: Iterable[Time], file: Path = HISTORY) -> None:
    """Append times."""
    is_new = not file.is_file()
    with file.open("a", newline="", encoding="utf-8") as opened:
        writer = csv.writer(opened, lineterminator="\n")
        if is_new:
            writer.writerow(Time._fields)
        writer.writerows((*time[:-1], f"{time.seconds:.4g}") for time in times)


def slower(time: Time, before: Iterable[Time]) -> str:
    """Sentence on a time that is slower than the last ones on its machine; else nothing."""
    alike = [
        one.seconds for one in before if (one.machine, one.figure) == (time.machine, time.figure)
    ]
    if not alike:
        return ""
    median = statistics.median(alike[-LAST:])
    ratio = time.seconds / median
    if ratio <= SLOWER:
        return ""
    number = len(alike[-LAST:])
    runs = f"the last {number} runs" if number > 1 else "the last run"
    return (
        f"SLOWER: {time.figure}: {time.seconds:.4g} s is {ratio:.2f} times the median "
        f"({median:.4g} s) of {runs} on this machine"
    )


def draw(times: list[Time], file: Path = PICTURE) -> None:
    """Draw the times over commits, a panel for each figure and a line for each machine."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    names, commits, machines = (
        list(dict.fromkeys(getattr(time, key) for time in times))
        for key in ("figure", "commit", "machine")
    )
    rows = -(-len(names) // _COLUMNS)
    # Text as text, so that it can be searched; no date and no random ids, so that a picture of
    # the same times is the same file.
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "bench", "font.size": 8}):
        drawing = Figure(figsize=(9.0, 1.0 + 1.7 * rows), layout="constrained")
        panels = list(drawing.subplots(rows, _COLUMNS, squeeze=False, sharex=True).flat)
        for panel in panels[len(names) :]:
            panel.set_visible(False)
        lines = {}
        for panel, name in zip(panels, names, strict=False):
            panel.set_title(name, fontsize=8)
            for number, one in enumerate(machines):
                here = [time for time in times if (time.figure, time.machine) == (name, one)]
                places = [commits.index(time.commit) for time in here]
                seconds = [time.seconds for time in here]
                (lines[one],) = panel.plot(places, seconds, ".-", color=f"C{number}")
            panel.set_ylim(bottom=0)
            panel.set_ylabel("s")
            panel.set_xticks(range(len(commits)), commits, rotation=90)
        drawing.legend([*lines.values()], [*lines], loc="outside lower center", frameon=False)
        drawing.savefig(file, format="svg", metadata={"Date": None})
