"""The house grows by decision: lines and types of each room, and places that spell a feature.

A figure that falls is lowered here. One that would rise asks first for what could go, or for the
table or the type that is missing.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.conftest import ROOT

# Room -> largest number of lines, and of types.
ROOMS = {
    "renew": (1_542, 29),
    "pipeline": (1_099, 12),
    "pipeline/cli": (2_394, 6),
    "pipeline/findings": (3_749, 18),
    "pipeline/formats": (6_633, 13),
    "pipeline/geo": (832, 4),
    "pipeline/machine": (1_560, 10),
    "pipeline/model": (1_460, 35),
    "pipeline/nightly": (3_047, 27),
    "pipeline/scenario": (2_209, 37),
    "pipeline/serve": (1_649, 9),
    "pipeline/sources": (9_914, 46),
    "pipeline/stages": (4_908, 14),
    "pipeline/voyage": (2_069, 8),
    "renew/bounds": (1_604, 8),
    "renew/classes": (2_454, 14),
    "renew/inputs": (2_264, 24),
    "renew/kernels": (2_428, 19),
    "renew/paths": (1_853, 9),
    "renew/planner": (4_174, 16),
    "renew/steering": (898, 1),
    "renew/turns": (1_652, 13),
    "renew/underway": (2_242, 13),
    "renew/vary": (1_797, 9),
    "renew/voyage": (937, 6),
}
MOST_FILES = 228
# Word -> largest number of files of pipeline/ that hold it, and of their lines with it.
WORDS = {"endurance": (7, 25), "optimality_gap": (5, 11), "seasons?": (60, 553)}


def modules(room: str) -> dict[Path, str]:
    """Modules of a room, with their texts; of a package those beside its rooms."""
    pattern = "**/*.py" if "/" in room else "*.py"
    return {path: path.read_text(encoding="utf-8") for path in (ROOT / room).glob(pattern)}


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_has_no_more_lines_and_types_than_it_had(room: str) -> None:
    texts = modules(room).values()
    lines = sum(text.count("\n") for text in texts)
    types = sum(len(re.findall(r"^ *class ", text, re.MULTILINE)) for text in texts)
    most_lines, most_types = ROOMS[room]
    assert lines <= most_lines
    assert types <= most_types


def test_all_rooms_are_counted() -> None:
    rooms = {
        f"{package}/{path.name}"
        for package in ("renew", "pipeline")
        for path in (ROOT / package).iterdir()
        if any(path.glob("*.py"))
    }
    assert rooms | {"renew", "pipeline"} == ROOMS.keys()
    assert sum(len(modules(room)) for room in ROOMS) <= MOST_FILES


@pytest.mark.parametrize("word", WORDS)
def test_a_feature_is_spelled_in_no_more_places_than_it_was(word: str) -> None:
    rooms = (room for room in ROOMS if room.startswith("pipeline"))
    texts = [text for room in rooms for text in modules(room).values()]
    counts = [len(re.findall(rf"^.*\b{word}\b.*$", text, re.MULTILINE)) for text in texts]
    most_files, most_lines = WORDS[word]
    assert sum(count > 0 for count in counts) <= most_files
    assert sum(counts) <= most_lines
