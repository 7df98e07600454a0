"""Legs as they are drawn, their cross-track limits, and the fewest waypoints in safe water."""

import numpy as np
import numpy.typing as npt
import pytest
import shapely
from hypothesis import given, strategies as st

import renew
from pipeline._types import FloatArray
from pipeline.findings.route_profile import metres_along
from pipeline.formats.passage import thinning as module
from pipeline.formats.passage.safe_corridor import (
    Drawing,
    Obstacles,
    SafeCorridor,
    Tracks,
    cross_track_limits,
    curve_for,
    initial_course_deg,
    safe_corridor,
    tracks,
    turning_radii,
)
from pipeline.formats.passage.thinning import Candidates, cheapest_chain, thin, with_candidates
from pipeline.geo.projection import Projection
from pipeline.model import Case, Water
from tests.pipeline.formats import oracles, runs
from tests.strategies import PAPER_VESSEL
from tests.true_scale import GEOD

latitudes = st.floats(-70, 70)
offsets = st.floats(-6, 6)


@given(latitudes, offsets, offsets, st.sampled_from(["Loxodrome", "Orthodrome"]))
def test_legs_are_drawn_within_their_error(
    latitude: float, east: float, north: float, curve: str
) -> None:
    begin, end = np.array([179.0, latitude]), np.array([179.0 + east, latitude + north])
    if np.abs(end - begin).max() < 1e-3:
        return
    projection = Projection.at(179.0 + east / 2, latitude + north / 2)
    drawn = tracks(begin[None], end[None], curve, projection, 2.0)  # type: ignore[arg-type]
    assert drawn.lonlat[0].tolist() == begin.tolist()
    assert drawn.lonlat[-1].tolist() == end.tolist()
    draw = oracles.loxodrome if curve == "Loxodrome" else oracles.geodesic
    points = shapely.points(projection.to_plane(draw(begin, end, 400)))
    # This close to its centre the plane is true to a thousandth; the oracle's table, to 0.1 m.
    assert shapely.distance(points, drawn.lines[0]).max() < 2.2
    length = GEOD.line_length(*draw(begin, end, 400).T)
    assert drawn.length_m[0] == pytest.approx(length, rel=1e-5)


@given(latitudes, offsets, offsets)
def test_a_loxodrome_keeps_its_course(latitude: float, east: float, north: float) -> None:
    begin, end = np.array([[10.0, latitude]]), np.array([[10.0 + east, latitude + north]])
    if np.abs(end - begin).max() < 1e-2:
        return
    course = initial_course_deg(begin, end, "Loxodrome")[0]
    line = oracles.loxodrome(begin[0], end[0], 2000)
    for at in (0, 1000, 1998):
        there = GEOD.inv(*line[at], *line[at + 1])[0]
        assert abs((course - there + 180) % 360 - 180) < 0.02


def test_a_known_loxodrome() -> None:
    # Along a parallel: due east, R cos(latitude) of the ellipsoid.
    begin, end = np.array([[0.0, 60.0]]), np.array([[10.0, 60.0]])
    assert initial_course_deg(begin, end, "Loxodrome")[0] == pytest.approx(90.0)
    drawn = tracks(begin, end, "Loxodrome", Projection.at(5.0, 60.0), 0.1)
    sine = np.sin(np.radians(60))
    parallel = GEOD.a * np.cos(np.radians(60)) / np.sqrt(1 - GEOD.es * sine**2)
    assert drawn.length_m[0] == pytest.approx(parallel * np.radians(10), rel=1e-6)
    assert np.abs(drawn.lonlat[:, 1] - 60).max() < 1e-9


def test_several_legs_at_once_equal_each_by_itself() -> None:
    begin = np.array([[0.0, 40.0], [1.0, 41.0], [5.0, -3.0]])
    end = np.array([[1.0, 41.0], [1.0, 44.0], [4.0, -3.5]])
    projection = Projection.at(2.0, 20.0)
    together = tracks(begin, end, "Loxodrome", projection, 1.0)
    for leg in range(3):
        alone = tracks(begin[leg : leg + 1], end[leg : leg + 1], "Loxodrome", projection, 1.0)
        assert np.array_equal(together.lonlat[together.leg == leg], alone.lonlat)
        assert together.length_m[leg] == pytest.approx(alone.length_m[0])
    assert len(together.lines) == 3


@pytest.mark.parametrize(
    ("latitude", "curve"),
    [(0, "Loxodrome"), (69, "Loxodrome"), (71, "Orthodrome"), (-85, "Orthodrome")],
)
def test_high_latitudes_have_orthodromes(latitude: float, curve: str) -> None:
    assert curve_for(np.array([[0.0, 0.0], [10.0, latitude]])) == curve


CAP = 50.0
NOTHING = shapely.MultiPolygon()


def obstacles(*no_go: shapely.Polygon) -> Obstacles:
    """A chart from -200 to 300 m both ways."""
    chart = renew.Chart(shapely.box(-200, -200, 300, 300), no_go)
    water = Water(chart, no_go, Projection.at(0.0, 0.0))
    still = renew.UniformCurrent(0.0, 0.0)
    return Obstacles(Case("still", water, PAPER_VESSEL, np.zeros(2), np.ones(2), still))


def legs(*points: tuple[float, float]) -> Tracks:
    """Straight legs from point to point."""
    xy = np.repeat(np.array(points), 2, axis=0)[1:-1]
    return Tracks(xy, xy, np.repeat(np.arange(len(points) - 1), 2))


EAST = legs((0.0, 0.0), (100.0, 0.0))
WEST = legs((100.0, 0.0), (0.0, 0.0))
NORTH_BANK = shapely.box(-150, 30, 250, 40)


@pytest.mark.parametrize(
    ("track", "soft", "port", "starboard"),
    [
        (EAST, NOTHING, CAP, CAP),
        (EAST, NORTH_BANK, 30, CAP),
        (WEST, NORTH_BANK, CAP, 30),
        (EAST, shapely.box(-150, -20, 250, -10), CAP, 10),
        # Ahead of the leg, to port: 30 on and 40 aside.
        (EAST, shapely.box(130, 40, 200, 200), CAP, CAP),
        (EAST, shapely.box(120, 15, 200, 200), 25, CAP),
        # Behind it.
        (EAST, shapely.box(-100, 0.5, -12, 100), 12, CAP),
        # A pond around the leg, and a leg all in V: nothing is promised.
        (EAST, shapely.box(-50, -50, 150, 50).difference(shapely.box(-9, -8, 150, 7)), 7, 8),
        (EAST, shapely.box(-90, -90, 190, 90), 0, 0),
        (EAST, shapely.box(50, -5, 60, 5), 0, 0),
    ],
)
def test_limits_are_the_distances_to_either_side(
    track: Tracks, soft: shapely.Polygon, port: float, starboard: float
) -> None:
    found = cross_track_limits(track, soft, obstacles(), CAP)
    assert [*found[0], *found[1]] == pytest.approx([port, starboard], abs=0.02)


def test_land_and_the_edge_of_the_chart_are_limits() -> None:
    island = obstacles(shapely.box(40, 20, 60, 25))
    assert cross_track_limits(EAST, NOTHING, island, CAP)[0] == pytest.approx(20)
    at_the_edge = legs((0.0, -190.0), (100.0, -190.0))
    assert cross_track_limits(at_the_edge, NOTHING, island, CAP)[1] == pytest.approx(10)


def test_legs_may_not_be_drawn_beyond_the_edge_of_the_chart() -> None:
    on_chart = obstacles().clipped_to_chart(shapely.LineString([(0, 295), (100, 295)]).buffer(20))
    assert on_chart.bounds[3] == 300
    inside = shapely.LineString([(0, 0), (100, 0)]).buffer(20)
    assert obstacles().clipped_to_chart(inside) is inside


def test_every_leg_has_its_own_limits() -> None:
    track = legs((0.0, 0.0), (100.0, 0.0), (100.0, 100.0))
    port, starboard = cross_track_limits(track, shapely.box(120, -100, 130, 200), obstacles(), CAP)
    assert port == pytest.approx([20, CAP])
    assert starboard == pytest.approx([20, 20])


def turned(free: shapely.Polygon, radius: float, corner: float = 100.0) -> float:
    """Radius of the turn by 90 degrees to port at (corner, 0), the legs 100 m and 80 m long."""
    shapely.prepare(free)
    corridor = SafeCorridor(np.zeros((2, 2)), free, shapely.Polygon(), 1.0, free, 0, 1, 0.01)
    track = legs((corner - 100, 0.0), (corner, 0.0), (corner, 80.0))
    (found,) = turning_radii(track, corridor, radius)
    return float(found)


def test_turns_are_halved_until_they_fit() -> None:
    wide = shapely.box(-500, -500, 500, 500)
    assert turned(wide, 30.0) == 30
    # The shorter leg's half is 40 m: the tangent of a turn by 90 degrees is its radius.
    assert turned(wide, 50.0) == 25
    # A shoal inside the bend, at 9 m from both legs.
    shoal = shapely.box(70, 9, 91, 30)
    assert turned(wide.difference(shoal), 30.0) == 15
    assert turned(shapely.Polygon(), 30.0) == 0


def test_limits_are_the_nearest_of_all_edges_to_each_side() -> None:
    # The oracle looks at the parts of all edges inside each side's area.
    random = np.random.default_rng(4)
    rocks = [shapely.Point(*random.uniform(-150, 250, 2)).buffer(3) for _ in range(120)]
    way = np.cumsum(random.uniform(-20, 40, (6, 2)), axis=0)
    track = legs(*map(tuple, way))
    rocks = [rock for rock in rocks if rock.distance(shapely.LineString(way)) > 1]
    soft, around = shapely.MultiPolygon(rocks), obstacles()
    found = np.array(cross_track_limits(track, soft, around, CAP))
    for side, sign in enumerate((1, -1)):
        for leg, line in enumerate(track.lines):
            begin, end = way[leg], way[leg + 1]
            ahead = (end - begin) / np.linalg.norm(end - begin) * CAP
            aside = sign * np.array([-ahead[1], ahead[0]])
            corners = [begin - ahead, end + ahead, end + ahead + aside, begin - ahead + aside]
            within = shapely.intersection(shapely.Polygon(corners), soft.boundary)
            expected = min(CAP, line.distance(within)) if not within.is_empty else CAP
            assert found[side, leg] == pytest.approx(expected)


# At 20 degrees east on the equator loxodromes are straight lines of the plane.
DRAWING = Drawing(Projection.at(20.0, 0.0), "Loxodrome", 0.01)


NO_AREA = shapely.Polygon()


def corridor_of(
    path: list[tuple[float, float]],
    free: shapely.Polygon,
    blocked: shapely.Polygon = NO_AREA,
    wanted_clearance: float = 1.0,
) -> SafeCorridor:
    shapely.prepare(free)
    last = len(path) - 1
    return SafeCorridor(np.array(path), free, blocked, wanted_clearance, free, 0, last, 0.01)


def thinned(path: list[tuple[float, float]], free: shapely.Polygon) -> list[list[float]]:
    chosen = thin(corridor_of(path, free), DRAWING)
    assert (np.diff(chosen.along) > 0).all()
    chain: list[list[float]] = np.round(chosen.xy, 3).tolist()
    return chain


def test_a_straight_path_is_one_leg() -> None:
    path = [(x, 0.0) for x in np.linspace(0, 1000, 30)]
    assert thinned(path, shapely.box(-10, -10, 1010, 10)) == [[0, 0], [1000, 0]]


def test_a_gentle_bend_is_one_leg_where_the_corridor_is_wide() -> None:
    path = [(x, 8 * np.sin(np.pi * x / 1000)) for x in np.linspace(0, 1000, 30)]
    line = shapely.LineString(path)
    assert len(thinned(path, line.buffer(10))) == 2
    assert 3 <= len(thinned(path, line.buffer(3))) <= 5


@pytest.mark.parametrize("side", [1, -1])
def test_an_islet_is_passed_on_the_paths_side(side: int) -> None:
    path = [
        (0.0, 0.0),
        (400.0, side * 40.0),
        (500.0, side * 45.0),
        (600.0, side * 40.0),
        (1000.0, 0.0),
    ]
    islet = shapely.Point(500, side * 20).buffer(5)
    free = shapely.LineString(path).buffer(60).difference(islet)
    chain = thinned(path, free)
    assert len(chain) > 2
    # Between chain and path there is no islet.
    both = shapely.union(shapely.LineString(chain), shapely.LineString(path))
    assert not shapely.intersects(shapely.polygonize([both]), islet)
    # Without the islet the straight way would do.
    assert len(thinned(path, shapely.LineString(path).buffer(60))) == 2


def test_a_rounded_corner_is_one_waypoint() -> None:
    angle = np.radians(np.arange(-90, -9, 4))
    arc = np.column_stack([500 + 100 * np.cos(angle), 100 + 100 * np.sin(angle)])
    ahead = np.array([-np.sin(angle[-1]), np.cos(angle[-1])])
    leg = arc[-1] + 500 * np.array([-np.sin(angle[-1]), np.cos(angle[-1])])
    path = [(0.0, 0.0), *map(tuple, arc), tuple(leg)]
    # The inside of the bend is no-go.
    free = shapely.LineString(path).buffer(50).difference(shapely.Point(500, 100).buffer(97))
    chain = thinned(path, free)
    assert len(chain) == 3
    # Where the first leg, drawn out, meets the last one.
    share = -leg[1] / ahead[1]
    assert chain[1] == pytest.approx([leg[0] + share * ahead[0], 0.0], abs=0.5)


def test_legs_keep_clear_of_a_shore_that_the_path_touches() -> None:
    path = [(0.0, 0.0), (300.0, 0.0), (500.0, 0.0), (1000.0, 0.0)]
    shore = shapely.Polygon([(300, 0.1), (500, 0.1), (450, 40), (350, 40)])
    free = shapely.LineString(path).buffer(10).difference(shore)
    assert thinned(path, free) == [[0, 0], [1000, 0]]
    chain = thin(corridor_of(path, free, shore, 5.0), DRAWING).xy
    assert len(chain) <= 4
    assert shapely.distance(shapely.LineString(chain), shore) > 2.5


def test_legs_between_two_shores_have_the_greatest_clearance() -> None:
    path = [(0.0, 0.0), (500.0, 0.0), (1000.0, 0.0)]
    shores = shapely.union(shapely.box(499, 0.1, 501, 40), shapely.box(499, -40, 501, -3.9))
    free = shapely.LineString(path).buffer(10).difference(shores)
    chain = thin(corridor_of(path, free, shores, 5.0), DRAWING).xy
    assert shapely.distance(shapely.LineString(chain), shores) > 1.5


def test_legs_that_bend_out_of_the_corridor_are_split() -> None:
    drawing = Drawing(Projection.at(20.0, 60.0), "Loxodrome", 0.01)
    # A plane's straight line of 100 km at 60 degrees north; a loxodrome sags by 300 m.
    path = np.array([[-50_000.0, 0.0], [50_000.0, 0.0]])
    free = shapely.LineString(path).buffer(30)
    shapely.prepare(free)
    chosen = thin(SafeCorridor(path, free, NO_AREA, 1.0, free, 0, 1, 0.01), drawing)
    lonlat = drawing.lonlat(chosen.xy)
    assert 4 <= len(lonlat) <= 9
    assert shapely.covers(free, drawing.lines(lonlat[:-1], lonlat[1:])).all()


def test_a_path_that_touches_land_stays_as_planned() -> None:
    # The corridor is empty, so no other leg is known to be safe.
    path = [(0.0, 0.0), (50.0, 10.0), (100.0, 0.0)]
    assert thinned(path, shapely.Polygon()) == [list(p) for p in path]


def test_the_legs_in_v_stay_as_planned() -> None:
    path = np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0], [30.0, 0.0], [40.0, 0.0], [50.0, 0.0]])
    wide = shapely.box(-5, -5, 55, 5)
    chosen = thin(SafeCorridor(path, wide, NO_AREA, 1.0, wide, 2, 4, 0.01), DRAWING)
    assert chosen.xy[:, 0] == pytest.approx([0, 10, 20, 40, 50])
    everything = thin(SafeCorridor(path, wide, NO_AREA, 1.0, wide, 5, 5, 0.01), DRAWING)
    assert everything.xy == pytest.approx(path)


def corridors() -> list[tuple[SafeCorridor, Drawing]]:
    """Give corridors of planned routes, among islands and with holes, wide and narrow."""
    found = []
    for seed in range(3):
        result = runs.random_run(seed)
        scene = result.planned[runs.SEASON]
        obstacles = Obstacles(scene)
        for ranked in result.routes[:3]:
            curve = curve_for(scene.projection.to_lonlat(ranked.route.path))
            for share in (4e-2, 1e-2, 2e-3):
                corridor = safe_corridor(ranked.route, obstacles, share * ranked.route.length)
                error_m = corridor.max_error * scene.projection.scale
                found.append((corridor, Drawing(scene.projection, curve, error_m)))
    return found


def cost_of(
    begin: FloatArray, end: FloatArray, length: float, corridor: SafeCorridor, drawing: Drawing
) -> FloatArray:
    """Cost of each leg (n, 2), by distances to all that is blocked; inf outside the corridor.

    The corridor's holes are not looked at.
    """
    lines = drawing.lines(drawing.lonlat(begin), drawing.lonlat(end))
    clearance = shapely.distance(corridor.blocked, lines)
    share = np.clip(clearance / corridor.wanted_clearance, 0.05, 1.0)
    cost = 1 + 0.5 * np.linalg.norm(end - begin, axis=1) / length + 1 / share - 1
    return np.where(shapely.covers(corridor.free, lines), cost, np.inf)


def cheapest_of_all(
    candidates: Candidates, own: npt.NDArray[np.int64], corridor: SafeCorridor, drawing: Drawing
) -> float:
    """Cost of the cheapest chain, from the cost of every pair of candidates."""
    length = candidates.along[own[-1]] - candidates.along[own[0]]
    begin, end = np.triu_indices(len(candidates), 1)
    onwards = candidates.along[end] > candidates.along[begin]
    begin, end = begin[onwards], end[onwards]
    pairs = np.stack([candidates.xy[begin], candidates.xy[end]], axis=1)
    cost = np.full((len(candidates),) * 2, np.inf)
    likely = np.ones(len(begin), dtype=bool)
    for share in (0.25, 0.5, 0.75):
        likely &= shapely.contains_xy(
            corridor.free, (1 - share) * pairs[:, 0] + share * pairs[:, 1]
        )
    legs = pairs[likely, 0], pairs[likely, 1]
    cost[begin[likely], end[likely]] = cost_of(*legs, length, corridor, drawing)
    least = np.full(len(candidates), np.inf)
    least[own[0]] = 0.0
    for node in range(int(own[0]) + 1, len(candidates)):
        least[node] = (least[:node] + cost[:node, node]).min()
    return float(least[own[-1]])


def test_a_point_that_is_there_twice_makes_no_corner_and_no_warning() -> None:
    once = np.array([[0.0, 0.0], [50.0, 0.0], [100.0, 40.0]])
    free, none = shapely.box(-10, -10, 200, 200), shapely.Polygon()
    for path in (once, once[[0, 1, 1, 2]]):
        corridor = SafeCorridor(path, free, none, 5.0, free, 0, len(path) - 1, 0.1)
        candidates, _ = with_candidates(Candidates(path, metres_along(path)), corridor)
        assert np.array_equal(np.unique(candidates.xy, axis=0), once)


def test_no_chain_is_cheaper_and_few_legs_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    looked_at, pairs, compared = 0, 0, 0
    drawn = Drawing.lines

    def counted(self: Drawing, begin: FloatArray, end: FloatArray) -> npt.NDArray[np.object_]:
        nonlocal looked_at
        looked_at += len(begin)
        return drawn(self, begin, end)

    for corridor, drawing in corridors():
        path = Candidates(corridor.path, metres_along(corridor.path))
        candidates, own = with_candidates(path[corridor.first : corridor.last + 1], corridor)
        if len(own) < 3 or len(corridor.holes) or len(candidates) > 120:
            continue
        with monkeypatch.context() as patched:
            patched.setattr(Drawing, "lines", counted)
            chain = cheapest_chain(candidates, own, corridor, drawing).xy
        pairs += len(candidates) * (len(candidates) - 1) // 2
        length = candidates.along[own[-1]] - candidates.along[own[0]]
        cost = cost_of(chain[:-1], chain[1:], length, corridor, drawing).sum()
        if np.isfinite(cost):
            compared += 1
            expected = cheapest_of_all(candidates, own, corridor, drawing)
            assert cost == pytest.approx(expected, rel=1e-9)
    assert compared >= 5
    assert looked_at < 0.4 * pairs


def test_the_paths_through_an_edge_cost_what_the_cheapest_does() -> None:
    random = np.random.default_rng(1)
    cost = np.triu(random.uniform(1, 2, (9, 9)), 1)
    cost[cost == 0] = np.inf
    cost[0, 8] = np.inf
    path, through = module._shortest_path(cost, 0, 8)
    assert through[path[:-1], path[1:]] == pytest.approx(through.min())
    assert cost[path[:-1], path[1:]].sum() == pytest.approx(through.min())
