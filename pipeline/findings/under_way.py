"""What planning again under way answered, in sentences."""

import math
from collections.abc import Iterator

from pipeline.findings import text
from pipeline.findings.result import RunResult
from pipeline.model import Note, Replanned

# Smallest fuel that is mentioned, as a share of the fuel planned.
_LEAST = 5e-5
# Smallest time that is mentioned, s.
_LEAST_S = 30.0
# Smallest distance that is mentioned, m.
_LEAST_M = 1.0


def replanned_notes(result: RunResult) -> Iterator[Note]:
    """Yield what planning again answered for the case that is sailed."""
    for one in result.results:
        if one.replanned is not None:
            yield Note.of("replanned", found=one.replanned).about(one.name)


def replanned_text(found: Replanned) -> tuple[str, ...]:
    """Say in sentences whether the planned way is kept, at what fuel, and what changed the fuel."""
    margin = "in the margin around land; the plan begins in the water, {} from there"
    moved = f", {margin.format(text.distance(found.moved_m))}" if found.moved_m > 0 else ""
    return f"{_answer(found)}.", f"The vessel is {_place(found)}{moved}.", f"{_causes(found)}."


def _answer(found: Replanned) -> str:
    """Say which way to take, with the fuel of each side."""
    fuel = text.number(found.fuel)
    if found.answer == "kept":
        return f"Kept: stay on the way that was planned, which needs {fuel} of fuel from here"
    if math.isfinite(found.kept_fuel):
        return (
            f"Switched: take the other way, which needs {fuel} of fuel from here; the way that was "
            f"planned would need {text.number(found.kept_fuel)}"
        )
    reason = f" ({found.kept_reason})" if found.kept_reason else ""
    return (
        f"Switched: take the other way, which needs {fuel} of fuel from here; the way that was "
        f"planned can't be sailed from here{reason}"
    )


def _place(found: Replanned) -> str:
    """Say where and when the vessel is beside its plan."""
    off = f"{text.distance(found.off_m)} off its plan" if found.off_m >= _LEAST_M else "on its plan"
    if abs(found.late_s) < _LEAST_S:
        return f"{off} and on time"
    early_or_late = "late" if found.late_s > 0 else "early"
    return f"{off} and {text.hours(abs(found.late_s))} {early_or_late}"


def _causes(found: Replanned) -> str:
    """Say what changed the fuel of the whole voyage."""
    changes = [
        f"{words} {'costs' if fuel > 0 else 'saves'} {text.number(abs(fuel))}"
        for words, fuel in (
            ("being off the plan, late or early", found.by_drift),
            ("the new forecast", found.by_forecast),
            ("the way ahead, against the planned one,", -found.saved),
        )
        if math.isfinite(fuel) and abs(fuel) > _LEAST * found.planned_fuel
    ]
    if not math.isfinite(found.by_drift):
        changes = ["no straight leg leads back to the planned way"]
    why = f": {', '.join(changes)}" if changes else ", as planned"
    return (
        f"The plan needed {text.number(found.planned_fuel)} of fuel, of which "
        f"{text.number(found.burnt)} is burnt; the whole voyage now needs "
        f"{text.number(found.burnt + found.fuel)}{why}"
    )
