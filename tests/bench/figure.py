"""One figure: what was asked and what was reached; and the files of figures that pages quote."""

import csv
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from tests.conftest import ROOT


@dataclass(frozen=True, slots=True)
class Figure:
    """A measured figure beside the one asked for; `met` is None where nothing was asked.

    `values` are those that pages quote, by their names in docs/figures/SUITE.csv.
    """

    name: str
    asked: str
    reached: str
    met: bool | None = None
    values: dict[str, float] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """Return "met", "missed" or nothing."""
        return {True: "met", False: "missed", None: ""}[self.met]


def at_most(
    name: str, value: float, limit: float, unit: str = "", digits: int = 2, key: str = ""
) -> Figure:
    """Figure that should not be above a limit; pages quote it by `key`, if that is given."""
    text = f"{value:.{digits}f}{unit}"
    values = {key: value} if key else {}
    return Figure(name, f"<= {limit:g}{unit}", text, value <= limit, values)


def quoted(name: str, **values: float) -> Figure:
    """Figures that pages quote and that nothing is asked of."""
    return Figure(name, "", ", ".join(f"{value:.6g}" for value in values.values()), None, values)


FOLDER = ROOT / "docs" / "figures"
COLUMNS = ("figure", "value", "measured", "commit")
_CODE = ("renew", "pipeline", "catalog", "experiments")
_DIGITS = 10


def file_of(suite: str) -> Path:
    """Where a suite's figures are kept."""
    return FOLDER / f"{suite}.csv"


def record(suite: str, values: Mapping[str, float]) -> Path:
    """Write a suite's figures, with today's date and the last commit that changed the program."""
    today, commit = f"{datetime.now(UTC):%Y-%m-%d}", code_commit()
    path = file_of(suite)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for name, value in values.items():
            writer.writerow([name, f"{value:.{_DIGITS}g}", today, commit])
    return path


def recorded(suite: str) -> dict[str, float]:
    """A suite's figures by their names."""
    with file_of(suite).open(newline="", encoding="utf-8") as file:
        return {row["figure"]: float(row["value"]) for row in csv.DictReader(file)}


def code_commit() -> str:
    """Short name of the last commit that changed the program; with "+" where that is edited."""
    git = ["git", "-C", str(ROOT)]
    last = subprocess.run(
        [*git, "log", "-1", "--format=%h", "--", *_CODE], capture_output=True, text=True, check=True
    ).stdout.strip()
    clean = subprocess.run([*git, "diff", "--quiet", "HEAD", "--", *_CODE], check=False)
    return last if clean.returncode == 0 else f"{last}+"
