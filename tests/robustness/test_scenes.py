"""Odd scenes are planned as promised or refused with a reason, in bounded time and memory."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.commands import ran
from tests.robustness import scenes

SCENES = 400
SAMPLE = 10


def outcome(root: Path, first: int, last: int) -> dict[str, Any]:
    """Plan scenes in a process of its own."""
    ended = ran(sys.executable, "-m", "tests.robustness.scenes", str(first), str(last), cwd=root)
    found: dict[str, Any] = json.loads(ended)
    return found


def test_a_sample_of_odd_scenes_is_planned_or_refused() -> None:
    failures, met = scenes.outcomes(range(SAMPLE))
    assert not failures, "\n".join(failures)
    assert met["plan"] >= SAMPLE // 10


@pytest.mark.slow
def test_many_odd_scenes_are_planned_or_refused(root: Path) -> None:
    found = outcome(root, 0, SCENES)
    assert not found["failures"], "\n".join(found["failures"])
    assert found["met"]["plan"] >= SCENES // 5
    assert len(found["met"]) >= 6, "scenes of every kind of refusal"
