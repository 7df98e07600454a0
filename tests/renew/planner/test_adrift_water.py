"""Routes that keep off land adrift, beside closed forms, an own simulation and a lattice."""

import math

import numpy as np
import pytest
import shapely
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

import renew
from renew._types import BoolArray, FloatArray
from renew.inputs.current import FunctionCurrent
from renew.planner.plan import planner_of

SIDE = 20_000.0
EXTENT = shapely.box(0, 0, SIDE, SIDE)
VESSEL = renew.Vessel(speed=1.5, turn_rate=0.1)
LIMIT = 7_200.0
ENDS = (600.0, 10_000.0), (19_400.0, 10_000.0)


def test_off_a_wall_it_keeps_the_drift_away() -> None:
    """A current of 0.4 m/s onto a wall along the way: an hour is 1,440 m."""
    wall, current = shapely.box(3_000, 0, 17_000, 9_000), renew.UniformCurrent(0.0, -0.4)
    chart = renew.Chart(EXTENT, [wall])
    best = renew.plan(chart, current, VESSEL, *ENDS, adrift=3_600.0).best
    beside = best.path[(best.path[:, 0] > 3_000) & (best.path[:, 0] < 17_000)]
    assert 9_000 + 1_440 <= beside[:, 1].min() <= 9_000 + 1_440 + 0.02 * 1_440
    assert renew.adrift(best, chart, current).seconds.min() >= 3_600
    # Two hours need as much again, and where the current runs off the wall nothing is kept.
    wide = renew.plan(chart, current, VESSEL, *ENDS, adrift=7_200.0).best
    assert wide.path[:, 1].max() == pytest.approx(9_000 + 2_880, abs=60)
    off = renew.UniformCurrent(0.0, 0.4)
    bare, kept = (
        renew.plan(chart, off, VESSEL, *ENDS, adrift=limit).best.fuel for limit in (None, 3_600.0)
    )
    assert kept == pytest.approx(bare, rel=1e-3)


def test_a_class_that_cannot_keep_it_is_rejected_with_place_and_time() -> None:
    """The short way leads through a gap of 600 m, across which the current runs onto land."""
    islands = [shapely.box(8_000, 10_300, 12_000, 16_000), shapely.box(8_000, 4_000, 12_000, 9_700)]
    chart, current = renew.Chart(EXTENT, islands), renew.UniformCurrent(0.0, 0.2)
    free = renew.plan(chart, current, VESSEL, *ENDS)
    plan = renew.plan(chart, current, VESSEL, *ENDS, adrift=3_600.0)
    lost = {one.homotopy for one in free.routes} - {one.homotopy for one in plan.routes}
    assert free.best.homotopy in lost
    assert lost <= {one.homotopy for one in plan.rejected}
    (rejected,) = (one for one in plan.rejected if one.homotopy == free.best.homotopy)
    assert "the vessel is on land in" in rejected.reason
    assert "adrift = 1 h" in rejected.reason
    assert rejected.cause is not None
    (place,) = rejected.cause.places
    assert 7_999 <= place[0] <= 12_001
    assert 9_700 <= place[1] <= 10_300
    assert rejected.unpadded_fuel == pytest.approx(free.best.fuel, rel=1e-3)


def quay(current: renew.CurrentField, **options: float) -> renew.Plan:
    """Plan from a quay at the end of a bay, 5 km deep and 3 km wide, towards open water."""
    bay = [shapely.box(0, 11_500, 6_000, 20_000), shapely.box(0, 0, 6_000, 8_500)]
    chart = renew.Chart(shapely.box(900, 0, SIDE, SIDE), bay)
    return renew.plan(chart, current, VESSEL, (1_000, 10_000), ENDS[1], **options)  # type: ignore[arg-type]


def test_near_an_end_it_counts_from_where_it_can_be_had() -> None:
    """In the bay the current runs onto its shore from everywhere within 2 h."""
    current = renew.UniformCurrent(0.0, 0.5)
    best = quay(current, adrift=LIMIT).best
    chart = renew.Chart(shapely.box(900, 0, SIDE, SIDE), [shapely.box(0, 11_500, 6_000, 20_000)])
    (begin, least), (end, _) = renew.adrift(best, chart, current).ends_below(LIMIT)
    # Nearest water out of it: beside the bay's mouth, 5 km off.
    assert 5_000 <= begin <= 1.3 * 5_000
    assert least < 3_100
    assert end == 0.0
    with pytest.raises(renew.UnreachableError, match=r"kept within 3000.00 m of \(1000"):
        quay(current, adrift=LIMIT, adrift_ends=3_000.0)


def suggested(error: renew.UnreachableError) -> float:
    """The limit that an error suggests, s."""
    words = str(error).partition("ower adrift to ")[2].partition(",")[0].split()
    return sum(
        float(number) * {"h": 3_600, "min": 60, "s": 1}[unit]
        for number, unit in zip(words[::2], words[1::2], strict=True)
    )


def test_what_is_suggested_leaves_a_route() -> None:
    current = renew.UniformCurrent(0.0, 0.5)
    with pytest.raises(renew.UnreachableError, match="adrift = 2 h can't be kept") as refused:
        quay(current, adrift=LIMIT, adrift_ends=3_000.0)
    lower = suggested(refused.value)
    assert 5_000 <= lower < 6_000
    assert quay(current, adrift=lower, adrift_ends=3_000.0).routes
    # A strait between two shores, which the current runs across.
    shores = [shapely.box(8_000, 12_000, 12_000, 20_000), shapely.box(8_000, 0, 12_000, 9_000)]
    chart = renew.Chart(EXTENT, shores)
    with pytest.raises(renew.UnreachableError, match="kept on any way from") as shut:
        renew.plan(chart, current, VESSEL, *ENDS, adrift=LIMIT)
    lower = suggested(shut.value)
    assert 4_000 <= lower <= 6_000
    assert renew.plan(chart, current, VESSEL, *ENDS, adrift=lower).routes


def test_it_needs_a_steady_current_and_figures_in_range() -> None:
    chart = renew.Chart(EXTENT)
    swinging = renew.SwingingGyre(0.2, SIDE, SIDE, 0.25, 1e-5)
    with pytest.raises(renew.ParameterError, match=r"adrift = 60 s needs a current that does not"):
        renew.plan(chart, swinging, VESSEL, *ENDS, adrift=60.0)
    with pytest.raises(renew.ParameterError, match=r"adrift = -1 s .*adrift_ends = nan m"):
        renew.PlanOptions(adrift=-1, adrift_ends=math.nan)


def drawn(seed: int) -> tuple[renew.Chart, renew.CurrentField, tuple[FloatArray, FloatArray]]:
    """Fourteen islands in a current of up to 0.6 m/s, and two ends between them."""
    draw = np.random.default_rng(seed)
    phase, strength = draw.uniform(0, 2 * np.pi, 4), draw.uniform(0.1, 0.22)
    wave, mean = 2 * np.pi / draw.uniform(9_000, 16_000, 4), draw.uniform(-0.1, 0.1, 2)

    def current(points: FloatArray) -> FloatArray:
        along = [points[..., at] for at in (1, 0, 0, 1)]
        a, b, c, d = (wave[k] * along[k] + phase[k] for k in range(4))
        moves = np.stack([np.sin(a) + 0.5 * np.cos(b), np.cos(c) + 0.5 * np.sin(d)], axis=-1)
        return np.asarray(mean + strength * moves)

    islands = [
        shapely.Point(*draw.uniform(3_000, SIDE - 3_000, 2)).buffer(
            draw.uniform(400, 1_800), quad_segs=3
        )
        for _ in range(14)
    ]
    shores, ends = shapely.union_all(islands), list[FloatArray]()
    for west in (600, 15_000):
        while True:
            place = np.array([draw.uniform(west, west + 4_400), draw.uniform(1_500, SIDE - 1_500)])
            if shores.distance(shapely.Point(place)) > 60:
                break
        ends.append(place)
    return renew.Chart(EXTENT, islands), FunctionCurrent(current), (ends[0], ends[1])


def hours(points: FloatArray, chart: renew.Chart, current: renew.CurrentField) -> FloatArray:
    """Follow points (n, 2) for the limit by Runge and Kutta's rule; return the seconds (n,)."""
    step, found, places = 60.0, np.full(len(points), np.inf), points.astype(float)
    shapely.prepare(chart.hard_no_go)
    going = np.arange(len(points))
    for since in np.arange(0.0, LIMIT + step / 2, step):
        ashore = shapely.intersects_xy(chart.hard_no_go, places[going])
        found[going[ashore]] = since
        outside = ((places[going] < 0) | (places[going] > SIDE)).any(axis=1)
        going = going[~ashore & ~outside]
        place = places[going]
        one = current.velocity(place, 0.0)
        two = current.velocity(place + step / 2 * one, 0.0)
        three = current.velocity(place + step / 2 * two, 0.0)
        four = current.velocity(place + step * three, 0.0)
        places[going] = place + step / 6 * (one + 2 * two + 2 * three + four)
    return found


def over_lattice(
    is_open: BoolArray, current: renew.CurrentField, ends: tuple[FloatArray, FloatArray]
) -> float:
    """Return the least fuel over legs between open nodes (n, n), whose cells are open, too."""
    count, tails, heads, times = len(is_open), [], [], []
    size = SIDE / (count - 1)
    row, column = np.divmod(np.flatnonzero(is_open), count)
    for dy, dx in ((i, j) for i in range(-4, 5) for j in range(-4, 5) if math.gcd(i, j) == 1):
        to = np.stack([row + dy, column + dx])
        inside = ((to >= 0) & (to < count)).all(axis=0)
        at, step = np.stack([row, column])[:, inside], np.array([[dy], [dx]])
        free = is_open[tuple(to[:, inside])].copy()
        for share in np.linspace(0, 1, 2 * max(abs(dy), abs(dx)) + 1)[1:-1]:
            place = at + share * step
            for up in (np.floor, np.ceil):
                for along in (np.floor, np.ceil):
                    free &= is_open[up(place[0]).astype(int), along(place[1]).astype(int)]
        begin, way = at[:, free], np.array([dx, dy]) / math.hypot(dx, dy)
        middles = [(size * (begin + share * step))[::-1].T for share in (0.1, 0.3, 0.5, 0.7, 0.9)]
        ground = [VESSEL.speed + current.velocity(middle, 0.0) @ way for middle in middles]
        tails.append(begin[0] * count + begin[1])
        heads.append(tails[-1] + dy * count + dx)
        times.append(size * math.hypot(dx, dy) * np.mean([1 / one for one in ground], axis=0))
    legs = (np.concatenate(tails), np.concatenate(heads))
    graph = coo_matrix((np.concatenate(times), legs), shape=(count**2, count**2))
    nodes = size * np.stack([column, row], axis=1)
    first, last = (
        int((row * count + column)[np.linalg.norm(nodes - end, axis=1).argmin()]) for end in ends
    )
    return float(dijkstra(graph.tocsr(), indices=first)[last]) * VESSEL.fuel_rate


@pytest.mark.gate_share(1)
# In water 11 a tongue thinner than the lattice's cells bars the way: the lattice does not see it.
@pytest.mark.parametrize("seed", [*range(11), *range(12, 21)])
def test_in_drawn_waters_it_is_kept_and_no_better_way_is_missed(seed: int) -> None:
    chart, current, ends = drawn(seed)
    plan = renew.plan(chart, current, VESSEL, *ends, classes=6, adrift=LIMIT)
    count = 134
    axis = np.linspace(0, SIDE, count)
    nodes = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    is_open = hours(nodes, chart, current) >= LIMIT
    water = planner_of(plan.voyage).problem.adrift_water if plan.voyage else None
    assert water is not None
    # Around an end that lies in the water it is open as far as the plan says.
    for end in ends:
        around = shapely.get_parts(water.opened)
        around = around[shapely.dwithin(around, shapely.Point(end), 100.0)]
        corners = shapely.get_coordinates(around)
        far = np.linalg.norm(corners - end, axis=1).max(initial=0.0)
        wet = ~shapely.intersects_xy(chart.hard_no_go, nodes)
        is_open |= (np.linalg.norm(nodes - end, axis=1) < far) & wet
    for route in plan.routes:
        line = shapely.LineString(route.path)
        along = np.append(np.arange(0, line.length, 50.0), line.length)
        places = shapely.get_coordinates(shapely.line_interpolate_point(line, along))
        low = hours(places, chart, current) < LIMIT
        assert shapely.dwithin(water.opened, shapely.points(places[low]), 1.0).all()
    free = over_lattice(is_open.reshape(count, count), current, ends)
    assert plan.best.fuel <= 1.005 * free
