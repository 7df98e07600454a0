"""A canal that joins the seas of start and goal is named, but not where land bars the way to it."""

from __future__ import annotations

import pytest
from shapely import LineString

from pipeline.findings.note_words import note_text
from pipeline.stages.canals import Canal, canal_notes, canals
from tests.true_scale import GEOD

# Published lengths of ways around, km, from a place off one end to one off the other: by the Cape
# of Good Hope, Cape Horn, Skagen, the Mull of Kintyre, and around Cape Cod.
AROUND = {
    "Suez Canal": 21_000, "Panama Canal": 19_000, "Kiel Canal": 800, "Crinan Canal": 180,
    "Cape Cod Canal": 220, "Corinth Canal": 400, "Caledonian Canal": 420,
}  # fmt: skip


# Between the ends of long waterways many other canals are looked at first: 0.5 to 5 s each.
LONG_M = 90_000.0
PAIRS = [
    pytest.param(one, id=one.name, marks=[pytest.mark.slow] * (one.length_m > LONG_M))
    for one in canals()
]


@pytest.mark.gate_share(4)
@pytest.mark.parametrize("canal", PAIRS)
def test_each_pair_of_seas_is_joined_by_its_canal(canal: Canal) -> None:
    for ends, around_m in ((canal.ends, None), (canal.ends[::-1], 2.0 * canal.length_m)):
        (note,) = canal_notes(*ends, around_m)
        said = dict(note.values)
        assert said["canal"] == canal.name
        assert said["way_m"] == pytest.approx(canal.length_m, abs=1.0)
        assert canal.name in note_text(note)


def test_there_are_twenty_and_none_is_shorter_than_the_straight_line() -> None:
    assert len(canals()) == 20
    for canal in canals():
        (west, south), (east, north) = canal.ends
        straight = GEOD.inv(west, south, east, north)[2]
        assert LineString(canal.ends).length > 0
        # The places lie at sea, some kilometres off the mouths between which a length is given.
        assert canal.length_m > straight - 40_000


@pytest.mark.parametrize(("name", "around_km"), AROUND.items())
def test_a_way_around_is_compared(name: str, around_km: float) -> None:
    (canal,) = (one for one in canals() if one.name == name)
    (note,) = canal_notes(*canal.ends, 1000.0 * around_km)
    assert dict(note.values)["canal"] == name
    assert list(canal_notes(*canal.ends, canal.length_m)) == []


@pytest.mark.parametrize(
    ("start", "goal", "length_km"),
    [
        ((120.3, 12.8), (116.8, 7.7), 900.0),  # west or east of Palawan
        ((-6.0, 36.0), (5.0, 43.0), 1_500.0),  # Gibraltar to Marseille
        ((3.0, 51.6), (1.5, 51.0), 150.0),  # across the North Sea
        ((-74.0, 40.4), (-5.0, 49.0), 5_300.0),  # New York to the Channel
    ],
)
def test_other_voyages_are_told_of_none(
    start: tuple[float, float], goal: tuple[float, float], length_km: float
) -> None:
    assert list(canal_notes(start, goal, 1000.0 * length_km)) == []
    assert list(canal_notes(start, goal, None)) == []
