"""The table of seasons that a run prints at its end, as plain text."""

import math
from collections.abc import Iterator

from pipeline.formats.shared.note_words import note_texts
from pipeline.formats.shared.result import unknowns
from pipeline.formats.shared.text import (
    capitalised,
    clearance,
    count,
    days,
    fuel,
    gap_figure,
    gap_text,
    hours,
    season_name,
)
from pipeline.model import RouteMetrics
from pipeline.running.outcome import Outcome

_HEAD = (
    "season",
    "rank",
    "way",
    "length {unit}",
    "duration",
    "clearance",
    "fuel",
    "F/D",
    "gap",
    "turns",
)
# Number of the first columns that are left-aligned.
_LEFT_ALIGNED = 3
# If the longest route is shorter than this, lengths are in metres, not kilometres.
_SHORT_M = 10_000.0


def season_table(outcome: Outcome) -> str:
    """Return the run's table, with notes before and after it.

    For each season it has the best route on each side of the main island.
    """
    lengths = [row.length_m for row in outcome.evaluation.routes]
    unit = "m" if max(lengths, default=0.0) < _SHORT_M else "km"
    head = tuple(name.format(unit=unit) for name in _HEAD)
    rows: list[tuple[str, ...]] = [head]
    passed: set[str] = set()
    for plan in outcome.plans:
        if plan.plan is None:
            rows.append(
                (
                    season_name(plan.season),
                    "-",
                    "not planned",
                    *("",) * (len(_HEAD) - _LEFT_ALIGNED),
                )
            )
            continue
        seen: set[str] = set()
        for row in outcome.evaluation.routes:
            if row.season == plan.season and row.main_passage not in seen:
                seen.add(row.main_passage)
                passed.update(name for passage in row.passages for name in passage.islands)
                rows.append(_row(row, 1.0 if unit == "m" else 1000.0))
    widths = [max(len(row[i]) for row in rows) for i in range(len(_HEAD))]
    lines = [*_unused_currents(outcome)]
    lines += [f"{capitalised(choice)}." for choice in outcome.choices]
    lines += [""] * bool(outcome.choices)
    found = unknowns(outcome.result)
    lines += ["Not known:", *(f"- {text}" for text in note_texts(found)), ""] * bool(found)
    lines += [
        "  ".join(
            cell.ljust(width) if i < _LEFT_ALIGNED else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
    if places := [
        f"{'island ' * (not island.name)}{island.label} at {island.place}"
        for island in outcome.evaluation.islands
        if island.label in passed
    ]:
        lines.append(f"\nPassed: {'; '.join(places)}.")
    no_go = outcome.fetched.land.no_go_name
    lines += [
        f"\n{season_name(one.season)}: {gap_text(one, no_go)}"
        for one in outcome.evaluation.gap_shares
    ]
    rejected = sum(len(plan.plan.rejected) for plan in outcome.plans if plan.plan is not None)
    routes = count(len(outcome.evaluation.routes), "route", "routes")
    classes = count(rejected, "rejected class", "rejected classes")
    lines.append(
        "\nThe best route on each side of the main island. In report.html: "
        f"{routes}; {classes}, with reasons."
    )
    return "\n".join(lines)


def _unused_currents(outcome: Outcome) -> Iterator[str]:
    """Yield one line on preferred currents that were not used, if there are any."""
    unused: dict[str, list[str]] = {}
    for grid in outcome.fetched.currents:
        for passed in grid.passed_over:
            unused.setdefault(f"{passed.source} ({passed.reason})", []).append(
                season_name(grid.season)
            )
    if unused:
        reasons = (f"{', '.join(names)}: {reason}" for reason, names in unused.items())
        yield f"Currents NOT used: {'; '.join(reasons)}\n"


def _row(row: RouteMetrics, unit_m: float) -> tuple[str, ...]:
    """Return one route's cells; the last is "collisions/all" of the simulated hard-over turns."""
    kept = clearance(row.clearance_m) if row.has_land else "-"
    return (
        season_name(row.season),
        str(row.rank),
        row.way or "-",
        f"{row.length_m / unit_m:.1f}",
        days(row.duration_s) or hours(row.duration_s),
        kept,
        fuel(row.fuel),
        f"{row.fuel_per_distance:.3f}",
        gap_figure(row.optimality_gap) if math.isfinite(row.optimality_gap) else "-",
        f"{row.collisions}/{row.trials:,}" if row.has_land else "-",
    )
