"""The values that programs read of a rejected class agree with its sentence."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

import renew
from pipeline.findings.note_words import rejections
from pipeline.findings.result import RunResult
from pipeline.findings.text import json_value
from pipeline.geo.lonlat import position_text
from renew.errors import InfeasibleError, Moment, Strait, Text, TooLateError
from tests.pipeline.formats import small_run
from tests.pipeline.results import with_case

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
    assert found["lengths_m"] == pytest.approx([4150.0, 3840.0, 250.0])
    assert str(found["reason"]).endswith(
        "the gap is 4.15 km wide, and the padding takes 3.84 km on the left and 250.0 m on the "
        "right bank"
    )


def test_moments_are_dates() -> None:
    late = TooLateError(Text("known until {0}", (Text("{0}", (Moment(3600.0),)),)))
    result = with_rejected(small_run.parts(), late, None)
    (found,) = rejections(result.case(result.results[0].name))
    assert found["moments"] == ["2026-01-01T01:00:00+00:00"]
    assert found["strait"] is None
