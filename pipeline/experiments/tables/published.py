"""Published rows in the form of ours, and where the publication contradicts itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from pipeline.experiments.environments.model import EnvironmentSpec, Published
    from pipeline.experiments.tables.summary import Row

# Share by which a published F/D may differ from fuel / length: three digits, and means of ratios.
_SLIP = 0.02
# The total of A*'s collisions as it is printed; its rows are in the catalogue.
_PRINTED_A_STAR_COLLISIONS = 128


def published_row(row: Published) -> Row:
    """A published row with our columns; what was not published is left out."""
    figures: Row = {
        "form": "smoothed" if row.smoothed else "original",
        "fuel": row.fuel,
        "clearance_m": row.clearance,
        "fuel_per_distance": row.fuel_per_distance,
        "states": row.states,
        "length_m": row.length,
        "collisions": row.collisions,
        "trials": row.trials,
    }
    if row.classes:
        figures["form"] = f"k = {row.classes}"
    if row.way:
        figures["form"] = row.way
    return {name: value for name, value in figures.items() if value is not None}


def slips(specs: Sequence[EnvironmentSpec]) -> Iterator[Row]:
    """Published figures that contradict each other."""
    for spec in specs:
        for row in spec.published:
            ratio = row.fuel / row.length
            if row.fuel_per_distance and abs(row.fuel_per_distance / ratio - 1) > _SLIP:
                yield {
                    "environment": spec.title,
                    "planner": row.planner,
                    "figure": "F/D",
                    "printed": row.fuel_per_distance,
                    "from_its_rows": ratio,
                }
    collisions = [
        row.collisions
        for spec in specs
        for row in spec.published
        if row.planner == "A*" and row.collisions is not None
    ]
    if len(collisions) == 3:
        yield {
            "environment": "4-gyre, Hansando, Far East",
            "planner": "A*",
            "figure": "sum of collisions",
            "printed": _PRINTED_A_STAR_COLLISIONS,
            "from_its_rows": sum(collisions),
        }
