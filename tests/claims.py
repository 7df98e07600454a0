"""Figures in the documents: where each stands (claims.toml), and what was measured."""

from __future__ import annotations

import csv
import math
import re
import tomllib
from pathlib import Path
from types import SimpleNamespace

from pipeline.findings.text import rounded_down, rounded_up
from tests.bench.history import HISTORY
from tests.bench.record import FOLDER, recorded
from tests.conftest import ROOT
from tests.readme_table import METRICS

PAGES = tomllib.loads((ROOT / "tests" / "claims.toml").read_text("utf-8"))
"""Texts (`quoted`) and figures that are measured by nobody (`given`), by page."""


# Figures that are limits, by their names: the greatest that may be, and the least.
_GREATEST = re.compile(r"gap|most|worst|above|dearest|beside|from_a_point|filled")
_LEAST = re.compile(r"bound|clearance|least")


class Limit(float):
    """A figure that is written on its safe side: a greatest one rounded up, a least one down."""

    is_greatest: bool

    @classmethod
    def of(cls, name: str, value: float) -> float:
        """Return a figure as its name asks for it; as it is where it is no limit."""
        if not (_GREATEST.search(name) or _LEAST.search(name)):
            return value
        limit = cls(value)
        limit.is_greatest = _GREATEST.search(name) is not None
        return limit

    def __format__(self, spec: str) -> str:
        """Write it with the decimals of a format such as .2f."""
        digits = re.fullmatch(r",?\.(\d)f", spec)
        if digits is None:
            return format(float(self), spec)
        rounded = rounded_up if self.is_greatest else rounded_down
        return format(rounded(float(self), int(digits[1])), spec)


def measured() -> list[Path]:
    """Files of figures that a bench wrote for pages to quote."""
    return [path for path in FOLDER.glob("*.csv") if path not in {METRICS, HISTORY}]


def figures() -> dict[str, SimpleNamespace]:
    """All recorded figures: by suite, and by their names in it."""
    suites = {path.stem: recorded(path.stem) for path in measured()}
    found = {
        suite: SimpleNamespace(**{name: Limit.of(name, value) for name, value in rows.items()})
        for suite, rows in suites.items()
    }
    return {**found, "palawan": _palawan(), "by_side": _by_side(recorded("sides"))}


def _by_side(measured: dict[str, float]) -> SimpleNamespace:
    """Of each case of `sides` the fuel west and east about, or "shut"; as `CASE_best` the side."""
    texts: dict[str, str] = {}
    for case in {name.rsplit("_", 1)[0] for name in measured if name.endswith("_west")}:
        fuel = {side: measured.get(f"{case}_{side}", math.inf) for side in ("west", "east")}
        shown = ["shut" if math.isinf(one) else _fuel(one) for one in fuel.values()]
        texts |= {case: ", ".join(shown), f"{case}_best": min(fuel, key=fuel.__getitem__)}
    return SimpleNamespace(**texts)


def _fuel(value: float) -> str:
    """Fuel with a digit behind the point, but for that at true scale."""
    return f"{value:.1f}" if value < 1e4 else f"{value:,.0f}"


def _palawan() -> SimpleNamespace:
    """The routes of palawan-season by season and rank."""
    with METRICS.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return SimpleNamespace(
        **{
            f"{row['season']}_{row['rank']}": SimpleNamespace(
                side=row["way"].split()[0],
                per_distance=float(row["fuel_per_distance"]),
                filled=Limit.of("filled", 100 * float(row["filled_share"])),
            )
            for row in rows
        }
    )
