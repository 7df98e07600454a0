"""A printed limit is never on its unsafe side: least figures rounded down, greatest ones up."""

import re
from dataclasses import replace
from datetime import UTC, datetime

import pytest
from hypothesis import given, strategies as st

from pipeline.findings import text as texts
from pipeline.findings.note_words import note_text
from pipeline.findings.sentences import CaseFacts
from pipeline.model import Note, Place
from tests.pipeline.findings.test_sentences import BEST, OTHER

NUMBER = r"([\d,]+(?:\.\d+)?) ?(%|km|m/s|m\b|million|billion|thousand|h\b|min|s\b|times)?"
UNITS = {
    "%": 0.01,
    "km": 1e3,
    "million": 1e6,
    "billion": 1e9,
    "thousand": 1e3,
    "h": 3600,
    "min": 60,
}
SAFE = 1 + 1e-7
"""Factor on a limit that is the value's own rounding error."""
PLACE = Place(119.0, 10.0)
NOW = datetime(2026, 11, 28, tzinfo=UTC)

fuels = st.floats(1.0, 9e9)
shares = st.floats(1e-5, 0.999)
metres = st.floats(0.02, 2e6)


def figure(text: str, before: str) -> float:
    """The figure that follows some words of a text, in its unit of SI."""
    found = re.search(re.escape(before) + NUMBER, text)
    assert found is not None, (before, text)
    return float(found[1].replace(",", "")) * UNITS.get(found[2] or "", 1.0)


@given(shares)
def test_gaps_and_savings_are_rounded_up(gap: float) -> None:
    saved = gap / (1 + gap)
    facts = CaseFacts([replace(BEST, optimality_gap=gap), OTHER])
    said = " ".join(facts.verdict())
    assert figure(texts.gap_figure(gap), "") * SAFE >= gap
    assert figure(said, "this one is within ") * SAFE >= gap
    assert figure(said, "a way on any side may save up to ") * SAFE >= saved


@given(fuels, st.floats(1e-4, 0.999))
def test_a_bound_on_fuel_is_rounded_down(fuel: float, gap: float) -> None:
    said = " ".join(CaseFacts([replace(BEST, fuel=fuel, optimality_gap=gap)]).verdict())
    least = fuel / (1 + gap)
    shown = figure(said, "needs less than ") * BEST.still_fuel  # of that in still water
    assert shown <= least * SAFE
    assert shown >= 0.998 * least


@given(st.floats(0.3, 3.0))
def test_what_is_known_of_the_other_side_is_not_overstated(ratio: float) -> None:
    facts = CaseFacts([BEST, OTHER], other_sides_fuel=ratio * BEST.fuel)
    said = facts.certainty()
    if ratio <= 1:
        # The gap is a quarter of the bound on any side.
        assert figure(said, "may save up to ") * SAFE >= min(1 - ratio, 0.2)
    elif "at least" in said:
        assert figure(said, "needs at least ") <= (ratio - 1) * SAFE
    else:
        assert said.endswith("needs more.")


@given(metres)
def test_a_clearance_is_rounded_down(least_m: float) -> None:
    said = " ".join(CaseFacts([replace(BEST, clearance_m=least_m)]).verdict())
    for shown in (figure(texts.clearance(least_m), ""), figure(said, "keeps at least ")):
        assert shown <= least_m * SAFE
        assert shown >= 0.89 * least_m
    yields = Note.of("offing-yields", offing_m=900.0, length_m=1e3, least_m=least_m, place=PLACE)
    assert figure(note_text(yields), "beyond the region: at least ") <= least_m * SAFE


@given(st.floats(0.06, 1e6))
def test_the_longest_time_is_rounded_up(seconds: float) -> None:
    assert figure(texts.at_most_hours(seconds), "") * SAFE >= seconds


@given(st.floats(0.01, 30.0))
def test_limits_in_notes_are_on_the_safe_side(value: float) -> None:
    least = Note.of(
        "least-water", least_m=value, early_m=value, late_m=value,
        at=None, begin=None, until=None, place=PLACE,
    )  # fmt: skip
    for before in ("the best route has ", "early ", "late "):
        assert figure(note_text(least), before) <= value * SAFE
    streams = Note.of("tidal-streams", names=("M2",), step_min=10, error_m_s=value, has_mean=False)
    shut = Note.of("water-shut", share=0.1, speed_m_s=1.0, most_m_s=value, place=PLACE)
    hours = Note.of(
        "water-shut-for-hours", share=0.1, speed_m_s=1.0, most_m_s=value, place=PLACE,
        hours=((NOW, NOW),),
    )  # fmt: skip
    low = Note.of("tide-too-low", area="a bar", need_m=value, begin=None, until=None)
    far = Note.of("current-lacking", share=0.2, distance_m=1e3 * value)
    room = Note.of("room-kept", turns_m=value, offing_m=5.0)
    for note, before, most in (
        (streams, "within ", value),
        (shut, "up to ", value),
        (hours, "up to ", value),
        (low, "which needs ", value),
        (far, "up to ", 1e3 * value),
        (room, "up to ", value),
    ):
        assert figure(note_text(note), before) * SAFE >= most, note_text(note)


@pytest.mark.parametrize(
    ("turns_m", "decides"),
    [
        (36.1, "the offing is 694 m: the offing decides"),
        (4390.2, "the offing is 694 m: the wider of them decides"),
        (0.0, "neither hard-over turns nor the offing of 694 m decide"),
    ],
)
def test_it_is_said_whether_turns_or_the_offing_bind(turns_m: float, decides: str) -> None:
    said = note_text(Note.of("room-kept", turns_m=turns_m, offing_m=694.0))
    assert decides in said
