"""Runs of one planner in one case as one row: mean, spread and the best seed."""

from __future__ import annotations

import csv
import math
import statistics
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from experiments.jobs import Judged, Result
from experiments.referee.referee import Judgement

Cell: TypeAlias = str | float | int | None
Row: TypeAlias = dict[str, Cell]


@dataclass(frozen=True)
class Table:
    """A table of the report, whose template holds its title and note, and of one CSV file.

    `seconds` columns are measured and differ from run to run; all others depend on the seeds only.
    """

    name: str
    rows: tuple[Row, ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """All columns, in the order in which rows name them."""
        return tuple(dict.fromkeys(column for row in self.rows for column in row))

    def write_csv(self, folder: Path) -> Path:
        """Write `<name>.csv` to a folder, figures to six digits: more than any was measured to."""
        path = folder / f"{self.name}.csv"
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, self.columns, lineterminator="\n")
            writer.writeheader()
            for row in self.rows:
                writer.writerow(
                    {k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()}
                )
        return path


@dataclass(frozen=True)
class Runs:
    """All runs of a planner in a case: the judged paths of one kind, and how many runs failed."""

    paths: Sequence[Judged]
    failed: int = 0

    @classmethod
    def of(cls, results: Iterable[Result], *, is_smoothed: bool | None = None) -> Runs:
        """Take each run's smoothed or unsmoothed path; by default the better of both.

        A path over land, or through too strong a current, counts as a failure.
        """
        paths, failed = [], 0
        for result in results:
            found = [
                one
                for one in result.paths
                if is_smoothed in (None, one.candidate.is_smoothed)
                and math.isfinite(one.judgement.fuel)
                and not one.judgement.crosses_land
            ]
            if found:
                paths.append(min(found, key=lambda one: one.judgement.fuel))
            else:
                failed += 1
        return cls(paths, failed)

    def row(self) -> Row:
        """Figures of the runs: means; of fuel also the spread, and the best seed's."""
        if not self.paths:
            return {"runs": 0, "failed": self.failed}
        fuels = [one.judgement.fuel for one in self.paths]
        kept = [one.kept for one in self.paths if one.kept is not None]
        tried = sum(one.classes for one in self.paths if one.kept is not None)
        return {
            "runs": len(self.paths),
            "failed": self.failed,
            "fuel": _mean(fuels),
            "fuel_sd": statistics.stdev(fuels) if len(fuels) > 1 else None,
            "fuel_best": min(fuels),
            "clearance_m": self._mean(lambda one: one.clearance),
            "fuel_per_distance": self._mean(lambda one: one.fuel_per_distance),
            "states": _mean([one.candidate.states for one in self.paths]),
            "length_m": self._mean(lambda one: one.length),
            "collisions": sum(one.judgement.collisions for one in self.paths),
            "trials": sum(one.judgement.trials for one in self.paths),
            "steerable": f"{sum(one.judgement.is_steerable for one in self.paths)}"
            f"/{len(self.paths)}",
            "class_kept": f"{sum(kept)}/{tried}" if kept else None,
            "side": _counted([one.side for one in self.paths]),
            "seconds": _mean([one.candidate.seconds for one in self.paths]),
        }

    def _mean(self, figure: Callable[[Judgement], float]) -> float:
        return _mean([figure(one.judgement) for one in self.paths])


def _counted(sides: Sequence[str]) -> str | None:
    """Sides with the number of paths on each, the most frequent first; None if none is named."""
    count = Counter(filter(None, sides))
    alone = len(count) == 1
    return (
        ", ".join(f"{side}" if alone else f"{side} {n}" for side, n in count.most_common()) or None
    )


def _mean(values: Sequence[float]) -> float:
    """Mean; exact for equal values."""
    return math.fsum(values) / len(values)
