"""Two forecasts under one pattern: the later one counts in its span, and that is said."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path

import numpy as np

from pipeline.sources.cf.axes import latest_steps
from pipeline.sources.cf.contents import read_contents
from tests.pipeline.nightly.nights import REFERENCE, write_forecast


def test_the_later_forecast_wins_in_its_span_and_a_note_says_so(tmp_path: Path) -> None:
    early = write_forecast(tmp_path / "b.nc", steps=5, seed=1)
    late = write_forecast(tmp_path / "a.nc", REFERENCE + timedelta(hours=12), steps=5, seed=2)
    found = read_contents((late, early))
    # Steps at 0, 6 | 12, 18, 24, 30, 36 h: those of the early one at 12, 18 and 24 h give way.
    assert found.steps.moments == tuple(REFERENCE + i * timedelta(hours=6) for i in range(7))
    assert [found.u[file].file.name for file, _ in found.u_index] == ["b.nc"] * 2 + ["a.nc"] * 5
    assert [step for _, step in found.u_index] == [0, 1, 0, 1, 2, 3, 4]
    assert found.u_index == found.v_index
    assert found.reference_time == REFERENCE + timedelta(hours=12)
    (note,) = (note for note in found.notes if note.kind == "forecasts-overlap")
    assert dict(note.values) == {"count": 3, "reference": found.reference_time}
    assert note.is_decision


def test_steps_between_those_of_a_later_forecast_give_way_too() -> None:
    at = REFERENCE
    hours = {(0, i): i for i in range(9)} | {(1, i): 4 + 3 * i for i in range(3)}
    times = {step: at + timedelta(hours=hour) for step, hour in hours.items()}
    index = sorted(times, key=times.__getitem__)
    left = latest_steps(index, times, [1, 2])
    assert [hours[step] for step in left] == [0, 1, 2, 3, 4, 7, 10]
    assert latest_steps(index, times, [1, None]) == index
    assert latest_steps(index, times, [2, 2]) == index


def test_the_latest_of_many_forecasts_is_found_at_once() -> None:
    """Each of 2,000 daily files has ten days: of all but the last the first day is left."""
    starts = np.arange(2_000)
    times = {(int(file), day): int(file) + day for file in starts for day in range(10)}
    left = latest_steps(sorted(times, key=times.__getitem__), times, list(starts + 1))
    assert left == [(file, 0) for file in range(1_999)] + [(1_999, day) for day in range(10)]
