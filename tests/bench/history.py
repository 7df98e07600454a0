"""Times over commits: `python -m tests.bench --save` appends them to docs/figures/bench.csv."""

from __future__ import annotations

import csv
import os
import platform
import statistics
import time
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from tests.bench.figure import FOLDER, code_commit
from tests.conftest import ROOT

HISTORY = FOLDER / "bench.csv"
PICTURE = ROOT / "docs" / "pictures" / "bench.svg"
LAST = 5
SLOWER = 1.3
_COLUMNS = 2


class Time(NamedTuple):
    """A time that was measured at a commit on a machine.

    `loop_s` is what `loop_s()` took beside it: virtual machines of one name run at speeds that
    differ by a factor of two from day to day, so times are compared as multiples of it.
    """

    measured: str
    commit: str
    machine: str
    figure: str
    seconds: float
    loop_s: float

    @property
    def loops(self) -> float:
        """Time as a multiple of the loop's."""
        return self.seconds / self.loop_s


def now(figure: str, seconds: float, loop_s: float) -> Time:
    """Give a time its day, commit and machine."""
    day = f"{datetime.now(UTC):%Y-%m-%d}"
    return Time(day, code_commit(), machine(), figure, seconds, loop_s)


def loop_s() -> float:
    """CPU time of ten million additions in Python (s), the least of three."""
    took = []
    for _ in range(3):
        began, total = time.process_time(), 0
        for number in range(10_000_000):
            total += number
        took.append(time.process_time() - began)
    return min(took)


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
        rows = list(csv.reader(opened))[1:]
    return [Time(*row[:4], float(row[4]), float(row[5])) for row in rows]  # type: ignore[call-arg, arg-type]


def save(times: Iterable[Time], file: Path = HISTORY) -> None:
    """Append times."""
    is_new = not file.is_file()
    with file.open("a", newline="", encoding="utf-8") as opened:
        writer = csv.writer(opened, lineterminator="\n")
        if is_new:
            writer.writerow(Time._fields)
        writer.writerows((*one[:4], *(f"{s:.4g}" for s in one[4:])) for one in times)


def slower(latest: Time, before: Iterable[Time]) -> str:
    """Sentence on a time that is slower than the last ones on its machine; else nothing."""
    alike = [one for one in before if (one.machine, one.figure) == (latest.machine, latest.figure)]
    if not alike:
        return ""
    last = [one.loops for one in alike[-LAST:]]
    ratio = latest.loops / statistics.median(last)
    if ratio <= SLOWER:
        return ""
    runs = f"the last {len(last)} runs" if len(last) > 1 else "the last run"
    return (
        f"SLOWER: {latest.figure}: {latest.seconds:.4g} s, {latest.loops:.2f} times a fixed loop, "
        f"is {ratio:.2f} times the median of {runs} on this machine"
    )


def draw(times: list[Time], file: Path = PICTURE) -> None:
    """Draw the times over commits, a panel for each figure and a line for each machine."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    names, commits, machines = (
        list(dict.fromkeys(getattr(one, key) for one in times))
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
                here = [t for t in times if (t.figure, t.machine) == (name, one)]
                places = [commits.index(t.commit) for t in here]
                loops = [t.loops for t in here]
                (lines[one],) = panel.plot(places, loops, ".-", color=f"C{number}")
            panel.set_ylim(bottom=0)
            panel.set_ylabel("time / loop")
            panel.set_xticks(range(len(commits)), commits, rotation=90)
        drawing.legend([*lines.values()], [*lines], loc="outside lower center", frameon=False)
        drawing.savefig(file, format="svg", metadata={"Date": None})
