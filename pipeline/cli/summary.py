"""The season table that a run ends in, as plain text: it reads the same in a pipe."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from pipeline.formats.shared.text import days, hours

if TYPE_CHECKING:
    from pipeline.model import RouteMetrics
    from pipeline.run import Outcome

_HEAD = (
    "season",
    "rank",
    "side",
    "length {unit}",
    "duration",
    "clearance {unit}",
    "fuel",
    "F/D",
    "gap",
    "turns",
)
_LEFT = 3
_SHORT_M = 10_000.0


def season_table(outcome: Outcome) -> str:
    """The best route of each season, and of every other side that it has a route for."""
    # A plane of a hundred metres wants its metres.
    lengths = [row.length_m for row in outcome.evaluation.routes]
    unit = "m" if max(lengths, default=0.0) < _SHORT_M else "km"
    head = tuple(name.format(unit=unit) for name in _HEAD)
    rows: list[tuple[str, ...]] = [head]
    for plan in outcome.plans:
        if plan.plan is None:
            rows.append((plan.season, "-", "not planned", *("",) * (len(_HEAD) - _LEFT)))
            continue
        seen: set[str] = set()
        for row in outcome.evaluation.routes:
            if row.season == plan.season and row.side not in seen:
                seen.add(row.side)
                rows.append(_row(row, 1.0 if unit == "m" else 1000.0))
    widths = [max(len(row[i]) for row in rows) for i in range(len(_HEAD))]
    lines = [
        "  ".join(
            cell.ljust(width) if i < _LEFT else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
    fallen = sum(len(plan.plan.rejected) for plan in outcome.plans if plan.plan is not None)
    lines.append(
        f"\nThe best of each side. {len(outcome.evaluation.routes)} routes in all, and {fallen} "
        "classes that fell away, with their reasons, are in report.html."
    )
    return "\n".join(lines)


def _row(row: RouteMetrics, unit_m: float) -> tuple[str, ...]:
    """One route's figures; `turns` is hard-over turns that met land of all flown."""
    clearance = "-" if math.isinf(row.clearance_m) else f"{row.clearance_m / unit_m:.2f}"
    return (
        row.season,
        str(row.rank),
        row.side or "-",
        f"{row.length_m / unit_m:.1f}",
        days(row.duration_s) or hours(row.duration_s),
        clearance,
        f"{row.fuel:.5g}",
        f"{row.fuel_per_distance:.3f}",
        f"{row.optimality_gap:.1%}" if math.isfinite(row.optimality_gap) else "-",
        f"{row.collisions}/{row.trials}",
    )
