"""Hours adrift, beside closed forms and an own integration in tiny steps."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

import renew
from renew._types import FloatArray
from renew.inputs.current import FunctionCurrent

HOUR = 3600.0
EXTENT = shapely.box(0, 0, 100_000, 100_000)
VESSEL = renew.Vessel(speed=5.0, turn_rate=0.05)


def sailed(path: list[tuple[float, float]], current: renew.CurrentField) -> renew.Route:
    """A route along a line, as it is drawn, in open water."""
    open_water = renew.Chart(EXTENT)
    return renew.assess(
        np.array(path), open_water, current, VESSEL, padding="none", classes=1
    ).route


def followed(
    points: FloatArray, begun: FloatArray, current: renew.CurrentField, land: shapely.Geometry
) -> FloatArray:
    """Follow points (n, 2) by Runge and Kutta's rule in steps of 30 s; return the seconds (n,)."""
    step, found, places = 30.0, np.full(len(points), np.inf), points.copy()
    shapely.prepare(land)
    for since in np.arange(0.0, 36 * HOUR, step):
        going = np.isinf(found) & (places >= 0).all(axis=1) & (places <= 100_000).all(axis=1)
        ashore = going & shapely.intersects_xy(land, places)
        found[ashore] = since
        left = np.flatnonzero(going & ~ashore)
        place, now = places[left], begun[left] + since
        one = current.velocity(place, now)
        two = current.velocity(place + step / 2 * one, now + step / 2)
        three = current.velocity(place + step / 2 * two, now + step / 2)
        four = current.velocity(place + step * three, now + step)
        places[left] = place + step / 6 * (one + 2 * two + 2 * three + four)
    return found


def test_towards_a_wall_it_is_the_distance_by_the_speed() -> None:
    wall, current = shapely.box(90_000, 0, 100_000, 60_000), renew.UniformCurrent(0.7, 0.1)
    route = sailed([(10_000, 5_000), (60_000, 95_000)], current)
    found = renew.adrift(route, renew.Chart(EXTENT, [wall]), current)
    expected = (90_000 - found.points[:, 0]) / 0.7
    reaches = found.points[:, 1] + 0.1 * expected < 60_000
    assert found.seconds[reaches] == pytest.approx(expected[reaches], rel=1e-6)
    assert np.isinf(found.seconds[~reaches]).all()
    assert found.ends[reaches, 0] == pytest.approx(90_000)
    # Stations lie close together where the time jumps.
    jump = int(np.flatnonzero(reaches)[-1])
    assert found.along[jump + 1] - found.along[jump] < found.along[-1] / 400 / 10
    limit = 24 * HOUR
    length = 100_000 * math.hypot(0.5, 0.9)
    nearer = (90_000 - 0.7 * limit - 10_000) / 50_000  # share of the way from which it is below
    until = found.along[jump] / length
    assert found.share_below(limit) == pytest.approx(until - nearer, abs=2e-3)
    assert found.seconds[found.least] == found.seconds.min()


def test_round_a_centre_it_is_the_angle_by_the_rate() -> None:
    rate, centre = 2e-5, np.array([50_000.0, 50_000.0])

    def solid(points: FloatArray) -> FloatArray:
        x, y = points[..., 0] - centre[0], points[..., 1] - centre[1]
        return np.asarray(rate * np.stack([-y, x], axis=-1))

    wall = shapely.box(52_000, 49_500, 99_000, 50_000)
    current = FunctionCurrent(solid)
    route = sailed([(55_000, 52_000), (85_000, 75_000), (30_000, 85_000)], current)
    found = renew.adrift(route, renew.Chart(EXTENT, [wall]), current, horizon=100 * HOUR)
    x, y = (found.points - centre).T
    radius = np.hypot(x, y)
    # The wall's lower edge lies 500 m south of the centre.
    angle = (2 * np.pi - np.arcsin(500 / radius)) - np.arctan2(y, x)
    inside = radius < 47_000
    assert inside.sum() > 200
    # By the midpoint rule the radius grows by a hair.
    assert found.seconds[inside] == pytest.approx(angle[inside] / rate, rel=1e-3)


def eddies(points: FloatArray) -> FloatArray:
    """Return a steady current of up to 1 m/s."""
    x, y = points[..., 0] / 9_000, points[..., 1] / 11_000
    return np.asarray(0.7 * np.stack([np.sin(y) + 0.3 * np.cos(x), np.cos(x)], axis=-1))


def turning(points: FloatArray, time: FloatArray) -> FloatArray:
    """Return the eddies in a tide of twelve hours and a half."""
    swing = np.cos(2 * np.pi * np.asarray(time)[..., None] / 45_000)
    return np.asarray(eddies(points) * swing + np.array([0.15, -0.05]))


@pytest.mark.gate_share(1)
@pytest.mark.parametrize(
    "current",
    [FunctionCurrent(eddies), renew.VaryingCurrent(np.arange(0.0, 300_000, 600), turning)],
    ids=["steady", "changing"],
)
def test_beside_an_own_integration(current: renew.CurrentField) -> None:
    """Among drawn islands; where a track grazes one, a neighbour's time may be taken."""
    draw = np.random.default_rng(3)
    islands = [
        shapely.Point(*draw.uniform(5_000, 95_000, 2)).buffer(
            draw.uniform(1_000, 5_000), quad_segs=8
        )
        for _ in range(14)
    ]
    land = shapely.union_all(islands)
    route = sailed([(5_000, 20_000), (50_000, 55_000), (95_000, 70_000)], current)
    found = renew.adrift(
        route, renew.Chart(EXTENT, islands), current, lateness=0.0, horizon=36 * HOUR
    )
    chosen = np.linspace(0, len(found.points) - 1, 200).astype(int)
    known = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(route.path, axis=0), axis=1))])
    times = np.interp(found.along[chosen], known, route.times)
    expected = followed(found.points[chosen], times, current, land)
    both = np.isfinite(expected) & np.isfinite(found.seconds[chosen])
    assert both.sum() > 60
    off = np.abs(found.seconds[chosen][both] - expected[both])
    grazes = off > np.maximum(0.01 * expected[both], 120.0)
    other = np.isfinite(expected) != np.isfinite(found.seconds[chosen])
    assert grazes.sum() + other.sum() <= 2


def test_early_and_late_passages_count_and_the_data_may_end() -> None:
    """A tide that turns: an hour later the vessel is carried ashore."""

    def tide(points: FloatArray, time: FloatArray) -> FloatArray:
        u = np.broadcast_to(np.where(np.asarray(time) < 20_000, -0.5, 0.5), points.shape[:-1])
        return np.stack([u, np.zeros_like(u)], axis=-1)

    wall = shapely.box(60_000, 0, 100_000, 100_000)
    current = renew.VaryingCurrent(np.array([0.0, 19_999.0, 20_001.0, 40_000.0]), tide)
    chart, still = renew.Chart(EXTENT, [wall]), renew.UniformCurrent(0.0, 0.0)
    route = sailed([(57_000, 1_000), (57_000, 90_000)], still)
    punctual = renew.adrift(route, chart, current, lateness=0.0)
    loose = renew.adrift(route, chart, current, lateness=0.0, min_lateness=3_600.0)
    assert punctual.known_until == 40_000.0
    assert (np.interp(loose.along, punctual.along, punctual.seconds) >= loose.seconds - 1).all()
    # Begun at 16,000 s it goes 2 km out until 20,000 s, then 5 km ashore.
    at = float(np.interp(16_000, route.times, [0, punctual.along[-1]]))
    on_time = float(np.interp(at, punctual.along, punctual.seconds))
    assert on_time == pytest.approx(4_000 + 10_000, rel=0.01)
    # Nobody is followed beyond the data.
    passed = np.interp(punctual.along, [0, punctual.along[-1]], route.times[[0, -1]])
    ashore = np.isfinite(punctual.seconds)
    assert (passed + punctual.seconds)[ashore].max() <= 40_000
    brief = renew.adrift(route, chart, current, horizon=600.0)
    assert np.isinf(brief.seconds).all()


def test_a_plane_that_doubles_metres_changes_no_time() -> None:
    wall, current = shapely.box(90_000, 0, 100_000, 100_000), renew.UniformCurrent(0.7, 0.1)
    route = sailed([(10_000, 5_000), (60_000, 95_000)], current)
    double = renew.Chart(
        shapely.box(0, 0, 200_000, 200_000),
        [shapely.box(180_000, 0, 200_000, 200_000)],
        point_scale=lambda points: np.full(points.shape[:-1], 2.0),
    )
    wide = replace(route, path=2 * route.path)
    one = renew.adrift(route, renew.Chart(EXTENT, [wall]), current)
    other = renew.adrift(wide, double, current)
    assert other.seconds == pytest.approx(one.seconds, rel=1e-6)
    assert other.along == pytest.approx(one.along, rel=1e-9)


def test_on_land_it_is_nothing_and_without_land_for_ever() -> None:
    current = renew.UniformCurrent(0.0, 0.0)
    route = sailed([(10_000, 10_000), (60_000, 10_000)], current)
    assert np.isinf(renew.adrift(route, renew.Chart(EXTENT), current).seconds).all()
    across = renew.adrift(
        route, renew.Chart(EXTENT), current, land=[shapely.box(20_000, 0, 30_000, 20_000)]
    )
    assert set(across.seconds) == {0.0, math.inf}
    assert across.share_below(HOUR) == pytest.approx(0.2, abs=0.01)


def test_figures_out_of_range_are_named_at_once() -> None:
    current = renew.UniformCurrent(0.0, 0.0)
    route = sailed([(10_000, 10_000), (60_000, 10_000)], current)
    with pytest.raises(renew.ParameterError, match=r"horizon = 0 .*lateness = 2 .*min_lateness"):
        renew.adrift(route, renew.Chart(EXTENT), current, horizon=0, lateness=2, min_lateness=-1)
