"""Routes on which turns met land, and those on weak tidal streams, are named."""

import math
import re
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
import shapely

import renew
from pipeline.findings.note_words import note_texts
from pipeline.findings.text import distance
from pipeline.model import CaseResult, Credit, CurrentGrid, Measures
from pipeline.stages.compare import (
    safety_notes,
    straits_of,
    unresolved_strait_notes,
    waiting_notes,
    weak_stream_notes,
)
from pipeline.stages.fetch import overpowering_notes
from tests.pipeline import tidal_run
from tests.pipeline.formats import small_run
from tests.pipeline.results import with_result
from tests.pipeline.tidal_run import planned, run, tide
from tests.renew.planner.test_hindrances import STRAIT, tide as tide_of_the_strait
from tests.strategies import PAPER_VESSEL
from tests.true_scale import GEOD


def test_turns_that_met_land_are_reported_with_the_first_place() -> None:
    result = small_run.parts()
    assert not list(safety_notes(result))
    measures = result.case("winter").measures
    best, turns = measures.routes[0], measures.turns[0]
    collided = np.zeros(len(turns.points), dtype=bool)
    collided[[5, 9]] = True
    measures = Measures((replace(best, collisions=2),), (replace(turns, collided=collided),))
    (note,) = note_texts(safety_notes(with_result(result, "winter", measures=measures)))
    lon, lat = result.water.projection.to_lonlat(turns.points[5])
    assert note.startswith("winter: not safe everywhere: 2 of ")
    assert f"met land, the first one from {lon:.4f} E {lat:.4f} N; turns are" in note


def test_routes_over_weak_constants_are_told_with_their_share() -> None:
    result = tidal_run.planned()
    (grid,) = result.fetched.currents
    assert list(weak_stream_notes(result)) == []
    lon = np.broadcast_to(grid.lon, grid.u[0].shape)
    for weak, share in ((lon < 119.0, None), (lon < 119.025, "22.2 %"), (lon > 0, "100.0 %")):
        other = replace(result.fetched, currents=(replace(grid, weak=weak),))
        notes = note_texts(weak_stream_notes(replace(result, fetched=other)))
        assert len(notes) == (share is not None)
        for note in notes:
            assert "tide: harmonic constants give less than 70% of the currents' variance" in note
            assert f"on {share} of route 1 and" in note


# --- Straits on the way are found with their widths, and named if the current's grid is too coarse.


# Two islands from the south to the north of the region, a mile apart; and the margin of its chart.
SOUTH = shapely.box(119.045, 9.501, 119.055, 9.522)
NORTH = shapely.box(119.045, 9.539, 119.055, 9.559)
MARGIN_DEG = 0.0005


def test_a_strait_between_two_islands_is_found_with_its_width() -> None:
    result = run(tide(12), (SOUTH, NORTH))
    best = result.routes[0].route
    found = list(straits_of(best, result.water))
    gap = GEOD.inv(119.05, 9.522 + MARGIN_DEG, 119.05, 9.539 - MARGIN_DEG)[2]
    narrowest, (lon, lat) = min(found)
    assert narrowest == pytest.approx(gap, rel=0.02)
    assert 119.044 < lon < 119.056
    assert lat == pytest.approx(9.5305, abs=2e-3)
    # Cells of 0.01 degrees are 1.1 km: more than half of the strait.
    (note,) = note_texts(unresolved_strait_notes(result))
    assert f"is {distance(narrowest)} wide" in note
    assert "the tide in the strait is not resolved" in note
    grid = result.fetched.currents[0]
    fine = replace(
        grid,
        lon=np.linspace(grid.lon[0], grid.lon[-1], 29),
        lat=np.linspace(grid.lat[0], grid.lat[-1], 21),
        u=np.zeros((2, 21, 29)),
        v=np.zeros((2, 21, 29)),
        times_s=np.array([0.0, 1e5]),
    )
    resolved = replace(result, fetched=replace(result.fetched, currents=(fine,)))
    assert note_texts(unresolved_strait_notes(resolved)) == []


def test_the_way_round_one_island_has_no_strait() -> None:
    assert list(straits_of(planned().routes[0].route, planned().water)) == []
    assert note_texts(unresolved_strait_notes(planned())) == []


# --- Water whose current is as fast as the vessel is noted, with its place ---


REGION = shapely.box(130.0, 30.0, 140.0, 40.0)


def grid(u: np.ndarray) -> CurrentGrid:
    """Return an eastward current on a grid of whole degrees that extends beyond the region."""
    lon, lat = np.arange(128.0, 143.0), np.arange(28.0, 43.0)
    return CurrentGrid(
        "winter", lon, lat, u[None], 0 * u[None], "2024-02", Credit("c", "current", "c", "")
    )


def test_share_strength_and_place() -> None:
    u = np.full((15, 15), 0.4)
    u[5, :] = 1.0  # 33 N: as fast as the vessel
    u[5, 7] = 1.6  # 135 E
    u[0, 0] = 3.0  # outside the region
    u[8:10, 3:6] = np.nan
    (note,) = note_texts(overpowering_notes(grid(u), REGION, 1.0))
    lat = np.arange(31.0, 40.0)
    row, cell = np.cos(np.radians(33.0)), np.cos(np.radians(lat)).sum()
    land = 3 * np.cos(np.radians([36.0, 37.0])).sum()
    assert f"in {9 * row / (9 * cell - land):.1%} of the water" in note
    assert "up to 1.6 m/s at 135.0000 E 33.0000 N" in note
    assert note.startswith("winter: ")


@pytest.mark.parametrize("strength", [0.99, np.nan])
def test_no_note_where_the_current_is_weaker(strength: float) -> None:
    assert note_texts(overpowering_notes(grid(np.full((15, 15), strength)), REGION, 1.0)) == []


def test_the_hours_when_the_current_shuts_water_are_reported() -> None:
    """A tide of 1.5 m/s and twelve hours is above 1 m/s where its cosine is above 2/3."""
    lon, lat = np.arange(128.0, 143.0), np.arange(28.0, 43.0)
    times = np.arange(-600.0, 24 * 3600.0 + 1, 600.0)
    tide_of_the_strait = np.cos(2 * np.pi * (times - 3 * 3600.0) / (12 * 3600.0))
    u = 0.5 * tide_of_the_strait[:, None, None] * np.ones((15, 15))
    u[:, 5, 7] = 1.5 * tide_of_the_strait  # 135 E 33 N
    known = CurrentGrid(
        "tide", lon, lat, u, 0 * u, "", Credit("c", "current", "c", ""), times_s=times
    )
    departure = datetime(2026, 11, 22, tzinfo=UTC)
    (note,) = note_texts(overpowering_notes(known, REGION, 1.0, departure))
    half = math.acos(2 / 3) / (2 * math.pi) * 12 * 60  # min
    assert "up to 1.5 m/s at 135.0000 E 33.0000 N" in note
    spells = re.findall(
        r"from 2026-11-22 (\d\d):(\d\d) UTC until 2026-11-22 (\d\d):(\d\d) UTC", note
    )
    # Eastward around 03:00 and 15:00, westward six hours later; three are named.
    assert len(spells) == 3
    for (hour, minute, to_hour, to_minute), middle in zip(spells, (180, 540, 900), strict=True):
        assert 60 * int(hour) + int(minute) == pytest.approx(middle - half, abs=6)
        assert 60 * int(to_hour) + int(to_minute) == pytest.approx(middle + half, abs=6)
    assert "and 1 more times: routes are the best without waiting" in note
    assert note_texts(overpowering_notes(known, REGION, 2.0, departure)) == []


@pytest.mark.parametrize(
    ("leaves", "begins"),
    [
        pytest.param(
            75.0,
            "tide: the current shuts water for a while on the way of route 1 at (",
            marks=pytest.mark.slow,
        ),
        (105.0, "tide: no route was found where the current shuts"),
    ],
)
def test_the_hours_when_a_class_is_shut_are_reported_as_dates(leaves: float, begins: str) -> None:
    """The tide of a strait, read at the place and at the two times that the note names."""
    chart = renew.Chart(shapely.box(0, -60, 200, 100), [*STRAIT.no_go])

    def with_a_way_round(points: np.ndarray, times: np.ndarray) -> np.ndarray:
        return tide_of_the_strait(points, times) * (points[..., 1:] > 10)

    current = renew.VaryingCurrent(np.arange(0.0, 1201.0, 4.0), with_a_way_round)
    departure = datetime(2026, 11, 22, 6, tzinfo=UTC)
    plain = small_run.parts(planar=True).planned["gyre"]
    case = replace(plain, name="tide", current=current, departure=departure)
    plan = renew.plan(
        chart, current, PAPER_VESSEL, (10, 50), (190, 50), departure=leaves, lateness=0.25,
        padding="none",
    )  # fmt: skip
    text, *_ = note_texts(waiting_notes([(case, CaseResult("tide", plan, "", 0.0))]))
    assert text.startswith(begins)
    assert ("The routes are the best without waiting" in text) == (leaves < 100)
    place = re.search(r"at \((\d[\d.]*), (\d[\d.]*)\) m from", text)
    assert place is not None
    x, y = map(float, place.groups())
    times = re.findall(r"2026-11-22 06:(\d\d):(\d\d) UTC", text)[:2]
    strength = [
        float(
            np.linalg.norm(
                tide_of_the_strait(np.array([x, y]), np.array(60.0 * int(m) + int(s) + later))
            )
        )
        for (m, s), later in zip((*times, *times), (-2, 2, 2, -2), strict=True)
    ]
    assert max(strength[:2]) < 0.97 < min(strength[2:])
    assert note_texts(waiting_notes([(case, CaseResult("tide", None, "no water", 0.0))])) == []
