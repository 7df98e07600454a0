"""What is not known is listed: for each route, each season, and the chart."""

import dataclasses
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

import renew
from pipeline.cli.answer import answer
from pipeline.findings.note_words import note_texts
from pipeline.findings.result import RunResult, continued, crossing_notes, route_unknowns
from pipeline.geo.projection import DepthCover, Projection
from pipeline.model import Passage, RouteMetrics, ShoreCrossing, ShutStrait, Water
from pipeline.model.inputs import Note
from pipeline.run import Outcome
from pipeline.scenario.region import ChartSpec
from pipeline.stages.measure import shore_crossings
from tests.pipeline.formats import small_run
from tests.pipeline.results import with_measures, with_rows
from tests.true_scale import GEOD

NO_DEPTHS = "no depths in this chart: the draught was not used, and shoals are not avoided"


def with_shares(
    result: RunResult, filled: dict[int, float], uncharted: float | None = None
) -> RunResult:
    """The same run with shares of the summer's routes by rank, and of depths for all of them."""

    def with_share(season: str, row: RouteMetrics) -> RouteMetrics:
        return replace(
            row,
            filled_share=filled.get(row.rank, 0.0) if season == "summer" else 0.0,
            uncharted_share=float("nan") if uncharted is None else uncharted,
        )

    land = replace(result.fetched.land, depths=None if uncharted is None else DepthCover(areas=()))
    return replace(with_rows(result, with_share), fetched=replace(result.fetched, land=land))


def test_a_chart_without_depths_says_so_and_nothing_else() -> None:
    assert note_texts(with_shares(small_run.parts(), {}).unknowns) == [NO_DEPTHS]


def test_shares_of_the_current_are_reported_for_the_best_and_the_worst() -> None:
    result = with_shares(small_run.parts(), {1: 0.123, 2: 0.2, 3: 0.95})
    _, text = note_texts(result.unknowns)
    assert text == (
        "summer: no current is given on 12.3 % of route 1 and 95.0 % of route 3, the largest share "
        "of the 2 other routes: it was filled from the water around"
    )
    best, second = result.case("summer").routes[:2]
    assert "12.3 % of route 1:" in note_texts(route_unknowns(best))[1]
    assert "20.0 % of route 2:" in note_texts(route_unknowns(second))[1]
    winter = result.case("winter").routes[0]
    assert note_texts(route_unknowns(winter)) == [NO_DEPTHS]


def without_current(result: RunResult, season: str) -> RunResult:
    """Plan a season without a current, as in still water."""
    grids = tuple(
        replace(grid, notes=(Note.of("still-water"),)) if grid.case == season else grid
        for grid in result.fetched.currents
    )
    return replace(result, fetched=replace(result.fetched, currents=grids))


def test_a_current_that_is_not_known_at_all_is_reported_first() -> None:
    result = with_shares(small_run.parts(), {1: 1.0, 2: 0.2})
    assert [result.case(season).lacks_current for season in ("summer", "winter")] == [True, False]
    first = note_texts(result.unknowns)[0]
    assert first.startswith("summer: no current is given on the best route: real fuel")
    still = without_current(with_shares(small_run.parts(), {}), "winter")
    assert [still.case(season).lacks_current for season in ("summer", "winter")] == [False, True]
    winter = still.case("winter").routes[0]
    assert note_texts(route_unknowns(winter))[0].startswith("no current was used")
    assert winter.case.gap_figure(winter.metrics) == "not proven"
    summer = still.case("summer")
    assert summer.gap_figure(summer.routes[0].metrics).endswith(" %")
    partly = with_shares(small_run.parts(), {1: 0.9, 2: 1.0})
    assert not partly.case("summer").lacks_current


def test_a_route_that_the_table_lacks_is_named_with_where_it_is(tmp_path: Path) -> None:
    """The table has the best route on each side, the doubts may be about others."""
    for rank, told in ((2, "50.0 % of route 2: it"), (3, "60.0 % of route 3 (see report.html), ")):
        result = with_shares(small_run.parts(), {1: 0.1, 2: 0.3} | {rank: 0.3 + rank / 10})
        said = answer(Outcome(result, tmp_path, fresh=True, seconds=1.0))
        assert f"! Summer: no current is given on 10.0 % of route 1 and {told}" in said


def test_land_of_the_second_shoreline_is_not_known_to_be_water() -> None:
    result = with_shares(small_run.parts(), {})
    crossings = tuple(
        ShoreCrossing(rank, 119.0 + rank, 9.0, length_m)
        for rank, length_m in ((1, 2461.0), (2, 33_000.0))
    )
    result = with_measures(result, "summer", shore_crossings=crossings)
    first = note_texts(result.unknowns)[0]
    assert first.startswith("summer: a second, independent shoreline")
    assert "2,461 m at 120.0000 E 9.0000 N on route 1; 33,000 m" in first
    best, second = result.case("summer").routes[:2]
    assert "33,000 m" not in note_texts(route_unknowns(best))[0]
    assert "33,000 m" in note_texts(route_unknowns(second))[0]
    winter = result.case("winter").routes[0]
    assert note_texts(route_unknowns(winter)) == [NO_DEPTHS]


def test_missing_depths_are_reported_and_complete_ones_are_not() -> None:
    (text,) = note_texts(with_shares(small_run.parts(), {}, 0.04).unknowns)
    assert "no depth is charted for 4.0 % of route 1 and 4.0 % of route" in text
    complete = with_shares(small_run.parts(), {}, 0.0)
    assert note_texts(complete.unknowns) == []


def test_straits_are_one_sentence_and_a_plane_has_nothing_unknown() -> None:
    first = ShutStrait(119.871, 11.5244, 1579.4, 1714.0, 900.0, "padding", saves=0.214, way=1)
    narrow = replace(first, lat=11.6, width_m=300.0, beside=("Isla Wellington",))
    straits = (first, narrow, replace(first, way=2, saves=0.1), replace(first, way=0, saves=0.0))
    result = replace(with_shares(small_run.parts(), {}), straits=straits)
    assert note_texts(result.unknowns)[1] == (
        "4 straits are shut by margin or padding; a way would be 21% shorter in time than the best "
        "way round, both without padding, through the one at 119.8710 E 11.5244 N, which is "
        "1.58 km wide where 1.71 km are needed and through the one at 119.8710 E 11.6000 N, beside "
        "Isla Wellington, which is 300.0 m wide where 1.71 km are needed"
    )
    (one,) = note_texts(replace(result, straits=(first,)).unknowns)[1:]
    assert one.startswith("1 strait is shut by margin or padding; a way would be 21% shorter")
    # Straits that save nothing are no part of the answer.
    assert len(note_texts(replace(result, straits=straits[-1:]).unknowns)) == 1
    planar = small_run.parts(planar=True)
    assert note_texts(planar.unknowns) == []
    assert note_texts(route_unknowns(planar.routes[0])) == []


def test_land_and_what_continues_it_become_one() -> None:
    land = np.array([shapely.box(0, 0, 1, 1), shapely.box(5, 5, 6, 6)], dtype=object)
    around = np.array([shapely.box(0.9, 0.2, 3, 0.8), shapely.box(8, 8, 9, 9)], dtype=object)
    found = continued(land, around)
    assert len(found) == 3
    expected = shapely.union_all([*land, *around])
    assert shapely.union_all(found).symmetric_difference(expected).area < 1e-12


def test_without_surroundings_nothing_changes(result: RunResult) -> None:
    assert list(result.drawn_land) == list(result.water.land)


def test_land_that_the_plane_cannot_hold_is_left_out(result: RunResult) -> None:
    near, far = shapely.box(121.0, 9.0, 121.2, 9.3), shapely.box(-61.5, -11.0, -60.0, -9.0)
    fetched = replace(result.fetched, surroundings=(near, far))
    drawn = replace(result, fetched=fetched).drawn_land
    assert len(drawn) in {len(result.water.land) + 1, len(result.water.land) + 2}
    assert np.isfinite(shapely.bounds(drawn)).all()


# --- Crossings of the second shoreline's land are found, measured and reported ---


REGION = shapely.box(23.0, 36.0, 25.0, 38.0)
# Two islands of the second shoreline; the northern one is in two overlapping pieces.
ISLANDS = [
    shapely.box(24.0, 36.5, 24.1, 36.6),
    shapely.box(24.0, 37.5, 24.1, 37.6),
    shapely.box(24.08, 37.5, 24.2, 37.6),
]


@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_each_crossing_is_where_and_as_long_as_on_earth(scale: float) -> None:
    projection = Projection.for_region(REGION, scale)
    plain = Water(renew.Chart(projection.geometry_to_plane(REGION)), (), projection)
    shore = tuple(projection.geometry_to_plane(np.array(ISLANDS, dtype=object)))
    water = dataclasses.replace(plain, second_shore=shore)
    clear = projection.to_plane([(23.5, 36.2), (24.5, 36.2)])
    path = projection.to_plane([(23.5, 36.55), (24.5, 36.55), (24.5, 37.55), (23.5, 37.55)])
    south, north = shore_crossings(water, [clear, path])
    for found, lat, east in ((south, 36.55, 24.1), (north, 37.55, 24.2)):
        assert found.rank == 2
        assert (found.lon, found.lat) == pytest.approx(((24.0 + east) / 2, lat), abs=2e-3)
        length_m = GEOD.inv(24.0, lat, east, lat)[2]
        assert found.length_m == pytest.approx(length_m, rel=2e-3)
    assert shore_crossings(plain, [path]) == ()


def test_notes_list_the_places_of_the_best_route_and_the_longest_others() -> None:
    best = ShoreCrossing(1, 24.0, 37.1, 100.0)
    same = ShoreCrossing(4, 24.0001, 37.1001, 105.0)
    others = [ShoreCrossing(i, 24.0, 37.0 + i / 10, 100.0 * i) for i in range(2, 11)]
    winter = ShoreCrossing(1, -5.25, -36.5, 60.4)
    (one,) = note_texts(crossing_notes([*others, same, best], ChartSpec()))
    (other,) = note_texts(crossing_notes([winter], ChartSpec()))
    places = one.split("; check these places on an official chart: ")[1].split("; ")
    assert places[0] == "105 m at 24.0001 E 37.1001 N on routes 1, 4"
    assert places[1] == "1,000 m at 24.0000 E 38.0000 N on route 10"
    assert places[7] == "400 m at 24.0000 E 37.4000 N on route 4"
    assert places[8] == "and 2 shorter"
    assert other.endswith(": 60 m at 5.2500 W 36.5000 S on route 1")
    assert crossing_notes([], ChartSpec()) == ()


def test_the_first_of_each_side_and_what_is_not_dear_is_followed() -> None:
    case = replace(small_run.parts().cases[0])  # others read the run, too
    planned = case.routes[0]
    east, west = Passage("east", ("Cebu",)), Passage("west", ("Cebu",))
    given = [(east, 100.0), (east, 124.0), (east, 126.0), (west, 190.0), (west, 195.0)]
    rows = [
        replace(planned.metrics, rank=rank, fuel=fuel, passages=(side,))
        for rank, (side, fuel) in enumerate(given, start=1)
    ]
    vars(case)["routes"] = tuple(replace(planned, rank=row.rank, metrics=row) for row in rows)
    assert [one.rank for one in case.followed] == [1, 2, 4]
