"""Each note that the program makes has words, and the words need only values that the note has."""

import ast
import inspect
import json
import string
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

import pipeline
import renew
from pipeline.findings.note_words import WORDS, note_json, note_text, rejections
from pipeline.findings.result import RunResult
from pipeline.findings.text import json_value
from pipeline.geo.projection import position_text
from pipeline.model import Note, Place, of_cases
from renew.errors import InfeasibleError, Moment, Strait, Text, TooLateError
from tests.pipeline.formats import small_run
from tests.pipeline.results import with_case


def made_notes() -> Iterator[tuple[str, set[str]]]:
    """Kinds of the notes that the sources make, and the names of their values."""
    paths = Path(pipeline.__file__).parent.rglob("*.py")
    trees = (ast.parse(path.read_text(encoding="utf-8")) for path in paths)
    functions = (node for tree in trees for node in ast.walk(tree))
    for function in functions:
        if not isinstance(function, ast.FunctionDef):
            continue
        nodes = list(ast.walk(function))
        texts = {str(one.value) for one in nodes if isinstance(one, ast.Constant)}
        calls = [one for one in nodes if isinstance(one, ast.Call)]
        made = [call for call in calls if ast.unparse(call.func) in {"Note.of", "model.Note.of"}]
        literal = {one.args[0].value for one in made if isinstance(one.args[0], ast.Constant)}
        for call in made:
            names = {str(one.arg) for one in call.keywords}
            kind = call.args[0]
            # A kind that is a variable is one of those that stand elsewhere in the function.
            some = [kind.value] if isinstance(kind, ast.Constant) else texts & {*WORDS} - literal
            yield from ((str(one), names) for one in some)


def asked_values(words: object) -> set[str]:
    """The names of the values that words ask for."""
    if callable(words):
        return set(inspect.signature(words).parameters)
    return {
        name.partition("[")[0] for _, name, _, _ in string.Formatter().parse(str(words)) if name
    }


def test_every_note_has_words_for_its_values() -> None:
    made = list(made_notes())
    assert len(made) > 40
    assert {kind for kind, _ in made} == {*WORDS}
    for kind, names in made:
        words = WORDS[kind]
        asked = asked_values(words)
        # A function takes all values, a sentence names those that it needs.
        assert asked == names if callable(words) else asked <= names, (kind, asked, names)


def test_values_are_in_the_sentence_and_in_json() -> None:
    crossing = Note.of("crossing", length_m=120.4, place=Place(-70.5, 42.25), routes=(1, 3))
    note = Note.of("second-shoreline", crossings=(crossing,)).about("july", "2024-07-01t0600z")
    assert note_text(note).startswith("july, departure 2024-07-01 06:00 UTC: a second, ")
    assert note_text(note).endswith(": 120 m at 70.5000 W 42.2500 N on routes 1, 3")
    assert note_json(note) == {
        "text": note_text(note),
        "kind": "second-shoreline",
        "seasons": ["july", "2024-07-01t0600z"],
        "values": {
            "crossings": [
                {
                    "kind": "crossing",
                    "length_m": 120.4,
                    "place": {"lon": -70.5, "lat": 42.25},
                    "routes": [1, 3],
                }
            ]
        },
    }


def test_moments_are_dates_or_seconds_and_braces_in_names_are_left() -> None:
    begin = datetime(2026, 11, 22, 6, tzinfo=UTC)
    dated = Note.of("area-shut", area="{0}", begin=begin, until=None)
    assert "area '{0}', which is shut from 2026-11-22 06:00 UTC; a vessel" in note_text(dated)
    assert note_json(dated)["values"] == {"area": "{0}", "begin": begin.isoformat(), "until": None}
    counted = Note.of("area-shut", area="", begin=None, until=1800.0)
    assert "an area, which is shut until 1800 s; a vessel" in note_text(counted)
    always = Note.of("area-shut", area="", begin=None, until=None)
    assert "an area, always shut; a vessel" in note_text(always)
    planar = Note.of(
        "margin-narrowed", margin_m=5.0, width_m=3.0, place=Place(1.5, 2, is_planar=True)
    )
    assert "the narrowest place, at (1.5, 2) m, is 3.00 m wide" in note_text(planar)
    assert planar.is_decision


def test_counts_take_their_nouns() -> None:
    one, many = (Note.of("areas-repaired", source="a.shp", count=count) for count in (1, 2107))
    assert "a.shp: 1 area was invalid and was repaired" in note_text(one)
    assert "a.shp: 2,107 areas were invalid and were repaired" in note_text(many)
    assert one.is_decision


def test_a_note_of_several_seasons_is_listed_once() -> None:
    tide, depth = Note.of("current-without-tide"), Note.of("current-at-depth", depth_m=5.0)
    merged = of_cases({"summer": (tide, depth, tide), "winter": (tide,)})
    assert merged == (tide.about("summer", "winter"), depth.about("summer"))


# --- The values that programs read of a rejected class agree with its sentence ---


BEGUN = datetime(2026, 1, 1, tzinfo=UTC)


def with_rejected(
    result: RunResult, cause: renew.PlanningError, strait: Strait | None
) -> RunResult:
    """Let one class of the first season be rejected."""
    entry = result.results[0]
    assert entry.plan is not None
    channel = entry.plan.best.channel
    gone = renew.Rejected("p1", str(cause), channel, strait, cause)
    plan = replace(entry, plan=replace(entry.plan, rejected=(gone,)))
    begun = with_case(result, entry.name, departure=BEGUN)
    return replace(begun, results=(plan, *result.results[1:]))


def test_places_and_widths_are_those_of_the_sentence() -> None:
    result = small_run.parts()
    gap = np.array([result.stops[0], result.stops[0] + np.array([40.0, 0.0])])
    strait = Strait(gap, 0, 1, 2, 25.0, 30.0)
    shut = with_rejected(result, InfeasibleError("blocked at {0}", gap.mean(axis=0)), strait)
    (found,) = rejections(shut.case(shut.results[0].name))
    assert json.loads(json.dumps(json_value(found))) == found
    places = found["places"]
    assert isinstance(places, list)
    (place,) = places
    assert found["reason"] == f"blocked at {position_text(place['lon'], place['lat'])}"
    assert (found["class"], found["kind"], found["moments"]) == ("p1", "InfeasibleError", [])
    values = found["strait"]
    assert isinstance(values, dict)
    scale = result.water.projection.scale
    assert values["width_m"] == pytest.approx(40.0 * scale, rel=0.01)
    assert (values["padding_left_m"], values["padding_right_m"]) == (25.0 * scale, 30.0 * scale)


def test_lengths_of_a_sentence_are_true_ones_at_a_scale() -> None:
    result = small_run.parts()
    assert result.water.projection.scale == 1000
    gap = np.array([result.stops[0], result.stops[0] + np.array([4.15, 0.0])])
    strait = Strait(gap, 0, 1, 2, 3.84, 0.25)
    shut = with_rejected(result, InfeasibleError.at_strait(strait), strait)
    (found,) = rejections(shut.case(shut.results[0].name))
    assert found["lengths_m"] == pytest.approx([4150.0, 4090.0, 3840.0, 250.0])
    assert str(found["reason"]).endswith(
        "the gap is 4.15 km wide, and 4.09 km are needed, with 3.84 km on the left and 250.0 m on "
        "the right bank for padding"
    )


def test_moments_are_dates() -> None:
    late = TooLateError(Text("known until {0}", (Text("{0}", (Moment(3600.0),)),)))
    result = with_rejected(small_run.parts(), late, None)
    (found,) = rejections(result.case(result.results[0].name))
    assert found["moments"] == ["2026-01-01T01:00:00+00:00"]
    assert found["strait"] is None


def test_turns_of_an_adaptive_plan_that_meet_land_are_not_said_to_be_verified() -> None:
    note = Note.of(
        "not-safe-everywhere",
        collisions=2, turns=9, no_go="land", rank=1, place=Place(1.0, 2.0), padding="adaptive",
    )  # fmt: skip
    assert "(it was 'adaptive') alone, not around a start or goal too close to" in note_text(note)
