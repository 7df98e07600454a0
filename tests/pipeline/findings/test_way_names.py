"""Ways are named by the islands that tell them apart, as a navigator would."""

import math
import re
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pytest
import shapely
from hypothesis import given, strategies as st

import renew
from pipeline.findings.way_names import islands, way_names
from pipeline.geo.projection import Projection
from pipeline.model import Case, CaseResult, Measures, PlaceName, RouteMetrics, Water
from pipeline.model.result import NumberedIsland
from tests.strategies import examples
from tests.true_scale import GEOD

VESSEL = renew.Vessel(speed=1.0, turn_rate=math.radians(35))
EXTENT = shapely.box(-500, -500, 500, 500)
STILL = renew.UniformCurrent(0.0, 0.0)


def voyage(islands: list[shapely.Polygon], start: npt.ArrayLike, goal: npt.ArrayLike) -> Case:
    """Return a case in metres at 0 N 0 E: north is up."""
    water = Water(renew.Chart(EXTENT, islands), tuple(islands), Projection.at(0.0, 0.0))
    start, goal = np.asarray(start, dtype=float), np.asarray(goal, dtype=float)
    return Case("still", water, VESSEL, start, goal, STILL)


def planned(case: Case, **options: object) -> CaseResult:
    """Plan the case; its routes have no figures that matter."""
    plan = renew.plan(
        case.chart,
        STILL,
        VESSEL,
        case.start,
        case.goal,
        **options,  # type: ignore[arg-type]
    )
    figures = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0, 0, 0.0)
    rows = tuple(
        RouteMetrics(rank, route.homotopy, route.fuel, *figures)
        for rank, route in enumerate(plan.routes, start=1)
    )
    return CaseResult("still", plan, "", 0.0, measures=Measures(rows))


class Named(NamedTuple):
    """Metrics with the names of their ways, and the islands in these names."""

    routes: tuple[RouteMetrics, ...]
    islands: tuple[NumberedIsland, ...]
    class_islands: tuple[NumberedIsland, ...]


def named(case: Case, *results: CaseResult, places: tuple[PlaceName, ...] = ()) -> Named:
    """Name the ways of some results."""
    named, islands, class_islands = way_names(case.water, results, places)
    rows = tuple(row for one in named for row in one.measures.routes)
    return Named(rows, islands, class_islands)


def _north_of(row: RouteMetrics) -> set[int]:
    """Numbers of the islands that a route passes in the north."""
    return {int(name) for one in row.passages if one.side == "north" for name in one.islands}


@examples(20, 100)
@given(st.floats(0, 2 * math.pi))
def test_the_side_is_where_the_way_round_lies(angle: float) -> None:
    """Two ways round one island: each lies on the named side of it."""
    ahead = np.array([math.cos(angle), math.sin(angle)])
    island = shapely.Point(0, 0).buffer(100, quad_segs=3)
    scene = voyage([island, shapely.box(-500, -500, -450, -450)], -300 * ahead, 300 * ahead)
    plan = planned(scene, classes=2)
    ways = {}
    for row, route in zip(named(scene, plan).routes, plan.routes, strict=True):
        side, _, island_name = row.way.partition(" of ")
        assert island_name == "island 1"
        x, y = route.path[np.abs(route.path @ ahead).argmin()]
        bearing = {"north": 0, "east": 90, "south": 180, "west": 270}[side]
        off = abs((math.degrees(math.atan2(x, y)) - bearing + 180) % 360 - 180)
        assert off <= 45 + 15  # the corners of the island lie 30 degrees apart
        ways[side] = row
    assert set(ways) in ({"north", "south"}, {"east", "west"})


def test_a_strait_is_named_by_the_islands_on_either_side() -> None:
    """Going north past three islands in a row there are four ways; each has a name of its own."""
    row = [shapely.box(x, -w, x + 2 * w, w) for x, w in ((-250, 60), (-90, 70), (90, 50))]
    scene = voyage(row, (0, -300), (0, 300))
    found = named(scene, planned(scene, classes=4))
    # The largest is 1: the one in the middle; the western is 2, the eastern 3.
    ways = {route.way for route in found.routes}
    assert ways == {
        "between islands 1 and 2",
        "between islands 1 and 3",
        "west of islands 1 and 2",
        "east of islands 1 and 3",
    }
    places = {island.label: island.x for island in found.islands}
    assert set(places) == {"1", "2", "3"}
    assert places["2"] < places["1"] < places["3"]
    for island in found.islands:
        assert island.place == scene.water.place_text(np.array([island.x, island.y]))


def test_numbers_are_those_of_the_homotopy_classes() -> None:
    """A class that passes north of one island alone has that island's number in its name."""
    scene = voyage([shapely.box(-60, -60, 60, 40), shapely.box(100, 90, 130, 120)],
                        (-300, 0), (300, 0))  # fmt: skip
    found = named(scene, planned(scene, classes=4))
    for route in found.routes:
        north = {f"s{number}" for number in (1, 2) if number in _north_of(route)}
        assert north <= set(route.homotopy.split("."))
    assert len({route.way for route in found.routes}) == len(found.routes)


def test_the_charts_own_names_take_the_place_of_numbers() -> None:
    island = shapely.box(-60, -50, 60, 50)
    scene = voyage([island], (-300, 0), (300, 0))
    lon, lat = scene.projection.to_lonlat(np.array([10.0, 10.0]))
    rock, elsewhere = PlaceName("A rock", lon, lat, 1e-9), PlaceName("Far", lon + 1, lat, 1.0)
    isle = PlaceName("Isle, of Dogs", lon, lat, 1e-6)
    found = named(scene, planned(scene), places=(rock, isle, elsewhere))
    assert {row.way for row in found.routes} == {
        "north of Isle, of Dogs", "south of Isle, of Dogs",
    }  # fmt: skip
    assert {row.main_passage for row in found.routes} == {row.way for row in found.routes}
    assert [(island.number, island.label) for island in found.islands] == [(1, "Isle, of Dogs")]
    found = named(scene, planned(scene), places=(elsewhere,))
    # It may be far away: so much lies between a degree of longitude.
    named_place = found.islands[0]
    far = re.fullmatch(r".* N, ([\d,.]+) km from Far", named_place.place)
    assert far, named_place.place
    lon, lat = scene.projection.to_lonlat(np.array([named_place.x, named_place.y])).tolist()
    away_m = GEOD.inv(lon, lat, elsewhere.lon, elsewhere.lat)[2]
    assert float(far[1].replace(",", "")) == pytest.approx(away_m / 1000, rel=0.01)


def test_no_two_islands_have_one_name() -> None:
    """A chart may have one name twice: the largest island keeps it, the other has its number."""
    row = [shapely.box(-250, -60, -130, 60), shapely.box(-90, -70, 50, 70)]
    scene = voyage(row, (0, -300), (0, 300))
    (west, _), (east, lat) = scene.projection.to_lonlat([(-190.0, 0.0), (-20.0, 0.0)]).tolist()
    places = PlaceName("Sheep", west, lat, 1e-6), PlaceName("Sheep", east, lat, 1e-8)
    found = named(scene, planned(scene, classes=3), places=places)
    assert {island.label for island in found.islands} == {"Sheep", "2"}
    assert len({row.way for row in found.routes}) == 3


def bali_scene(*others: shapely.Polygon) -> Case:
    """Return a case with a diamond in Bali's bounds, and other land (lon/lat degrees)."""
    bali = next(island for island in islands() if island.name == "Bali")
    west, south, east, north = bali.bounds
    x, y = (west + east) / 2, (south + north) / 2
    diamond = shapely.Polygon([(west, y), (x, north), (east, y), (x, south)])
    region = shapely.box(west - 0.5, south - 0.5, east + 0.5, north + 0.5)
    projection = Projection.for_region(region, 1000.0)
    land = projection.geometry_to_plane(np.array([diamond, *others], dtype=object))
    chart = renew.Chart(projection.geometry_to_plane(region), [shapely.union_all(land)])
    ends = projection.to_plane([[x, south - 0.3], [x, north + 0.3]])
    return Case("still", Water(chart, tuple(land), projection), VESSEL, ends[0], ends[1], STILL)


def test_the_catalogues_names_come_after_the_charts() -> None:
    scene = bali_scene()
    plan = planned(scene, classes=2)
    assert {row.way for row in named(scene, plan).routes} == {"west of Bali", "east of Bali"}
    lon, lat = scene.projection.to_lonlat(scene.chart.no_go[0].centroid.coords[0]).tolist()
    own = PlaceName("Pulau Bali", lon, lat, 1e-9)
    assert {row.way for row in named(scene, plan, places=(own,)).routes} == {
        "west of Pulau Bali", "east of Pulau Bali",
    }  # fmt: skip
    plane = replace(scene, water=replace(scene.water, is_planar=True))
    assert {row.way for row in named(plane, plan).routes} == {
        "west of island 1", "east of island 1",
    }  # fmt: skip


def test_a_number_has_a_named_island_in_names_of_classes() -> None:
    scene = bali_scene()
    found = named(scene, planned(scene, classes=2))
    assert [island.label for island in found.islands] == ["Bali"]
    spelled = set("".join(row.homotopy for row in found.routes)) & {"1"}
    assert {island.label for island in found.class_islands} == spelled


def test_larger_land_that_an_offing_joins_to_an_island_has_not_its_name() -> None:
    west, south, east, north = next(one for one in islands() if one.name == "Bali").bounds
    larger = shapely.box((west + east) / 2, south, east + 0.4, north)
    scene = bali_scene(larger)
    assert len(scene.chart.no_go) == 1
    ways = {row.way for row in named(scene, planned(scene, classes=2)).routes}
    assert ways == {"west of island 1", "east of island 1"}


def test_islands_that_tell_ways_apart_are_those_beside_the_way() -> None:
    """Three islands in a row, hardly apart: nobody passes the largest, which lies in the middle."""
    main = shapely.box(-120, -200, 0, 200)
    row = [shapely.box(60, -60, 75, 60), shapely.box(77, -30, 200, 30)]
    scene = voyage([main, *row, shapely.box(202, -60, 215, 60)], (-60, -300), (-60, 300))
    found = named(scene, planned(scene, classes=3))
    # By their areas the middle one is 2, that beside the main island 3, the outer one 4.
    ways = {row.way for row in found.routes}
    assert ways == {"west of island 1", "between islands 1 and 3", "east of islands 1 and 3"}


def test_seasons_share_the_main_island() -> None:
    """One season has routes on both sides, the other on one side only."""
    scene = voyage([shapely.box(-60, -60, 60, 40)], (-300, 0), (300, 0))
    both, one = planned(scene), planned(scene, classes=1)
    first, second, other = named(scene, both, replace(one, name="other")).routes
    assert {first.way, second.way} == {"north of island 1", "south of island 1"}
    assert other.way == first.way


def test_a_single_way_is_named_by_the_largest_island_beside_it() -> None:
    mainland = shapely.box(-500, 300, 500, 500)
    scene = voyage([shapely.box(-60, -60, 60, 40), mainland], (-300, 0), (300, 0))
    (row,) = named(scene, planned(scene, classes=1)).routes
    assert row.way == "north of island 1"


def test_without_an_island_beside_it_a_way_has_no_name() -> None:
    mainland = shapely.box(-500, 300, 500, 500)
    scene = voyage([shapely.box(-400, -10, -395, -5), mainland], (-200, 0), (200, 0))
    found = named(scene, planned(scene, classes=1))
    assert [row.way for row in found.routes] == [""]
    assert found.islands == ()


def test_an_island_behind_the_goal_or_the_start_is_not_passed() -> None:
    for x in (450.0, -450.0):
        behind = shapely.box(x - 40, -200, x + 40, 200)
        scene = voyage([behind], (-400, 0), (400, 0))
        found = named(scene, planned(scene, classes=1))
        assert [row.way for row in found.routes] == [""]
        assert found.islands == ()
