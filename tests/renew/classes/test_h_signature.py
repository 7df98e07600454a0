"""The h-signature: words name classes, and moving a path within its class doesn't change them."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st
from shapely import Polygon, box

import renew
from renew.classes.h_signature import Rays, name, rays_that_matter, shortened
from renew.inputs.options import DistinctBy
from tests.strategies import PAPER_VESSEL, SIZE, StreamFunctionCurrent, random_islands, seeds


def test_words_depend_on_the_class_of_a_path_alone() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(40, 40, 60, 60), box(20, 70, 30, 80)])
    rays = Rays.of(chart)
    above = np.array([[5.0, 50.0], [50.0, 90.0], [95.0, 50.0]])
    below = np.array([[5.0, 50.0], [50.0, 10.0], [95.0, 50.0]])
    assert rays.word(below) == ()
    assert rays.word(above) == (2, 1) or rays.word(above) == (1,)
    # A detour that goes out and back the same way gives no other class.
    there_and_back = np.array([[5, 50], [50, 90], [25, 50], [50, 90], [95, 50]], dtype=float)
    assert rays.word(there_and_back) == rays.word(above)
    # A full circle around the first island does.
    around = np.vstack([above, [[50.0, 10.0], [5.0, 50.0]]])
    assert rays.word(around)


def test_names_spell_words() -> None:
    assert name(()) == "e"
    assert name((2, -1)) == "s2.p1"
    long = name(tuple(range(1, 100)))
    assert shortened("s2.p1") == "s2.p1"
    assert len(shortened(long)) < 70
    assert shortened(long).startswith("s1.s2.")
    assert shortened(long).endswith(".s98.s99")


@settings(max_examples=25)
@given(seed=seeds)
def test_words_do_not_change_when_a_path_is_moved_over_water(seed: int) -> None:
    chart = renew.Chart(box(0, 0, SIZE, SIZE), random_islands(seed))
    rays = Rays.of(chart)
    rng = np.random.default_rng(seed)
    path = np.vstack([[5.0, 5.0], rng.uniform(0, SIZE, (4, 2)), [195.0, 195.0]])
    line = shapely.LineString(path)
    for _ in range(10):
        i = rng.integers(1, 5)
        moved = path.copy()
        moved[i] += rng.normal(0, 5, 2)
        swept = shapely.union_all(
            [
                shapely.convex_hull(shapely.MultiPoint([path[i], moved[i], path[j]]))
                for j in (i - 1, i + 1)
            ]
        )
        if not swept.intersects(chart.hard_no_go) and not line.intersects(chart.hard_no_go):
            assert rays.word(moved) == rays.word(path)


WAY = np.array([[20.0, 100.0], [180.0, 100.0]])


def among_islets(seed: int, side: float = SIZE) -> renew.Chart:
    """Two large islands one behind the other among many islets."""
    rng = np.random.default_rng(seed)
    large = [box(60, 85, 85, 120), box(115, 75, 140, 110)]
    islets: list[Polygon] = []
    while len(islets) < 40:
        x, y = rng.uniform(10, side - 12, 2)
        islet = box(x, y, x + rng.uniform(0.4, 1.6), y + rng.uniform(0.4, 1.6))
        near = [*large, *islets, *shapely.points(WAY)]
        if shapely.distance(islet, near).min() > 5:
            islets.append(islet)
    return renew.Chart(box(0, 0, side, side), [*large, *islets])


def test_the_largest_islands_on_the_way_matter() -> None:
    islands = [box(60, 85, 85, 120), box(115, 75, 140, 110), box(95, 100, 98, 102)]
    behind = box(2, 160, 8, 190)
    rays = Rays.of(renew.Chart(box(0, 0, SIZE, SIZE), [*islands, behind]))
    chosen = rays_that_matter(rays, WAY, 16)
    middles = shapely.points(np.column_stack([chosen.x, chosen.y]))
    assert [sum(island.covers(middles)) for island in (*islands, behind)] == [1, 1, 0, 0]
    assert chosen.omits_islands
    assert len(rays_that_matter(rays, WAY, 2).x) == 1
    assert len(rays_that_matter(rays, WAY, 1).x) == 0


def test_where_all_are_islets_the_largest_on_the_way_matters() -> None:
    islets = [box(60, 99, 61, 100), box(95, 100, 96.5, 101.5), box(120, 98, 121, 99)]
    beside = box(2, 160, 8, 190)
    rays = Rays.of(renew.Chart(box(0, 0, SIZE, SIZE), [*islets, beside]))
    chosen = rays_that_matter(rays, WAY, 16)
    assert len(chosen.x) == 1
    assert islets[1].covers(shapely.Point(chosen.x[0], chosen.y[0]))


@given(seed=seeds, share=st.floats(0, 1))
def test_a_word_by_some_rays_follows_from_the_word_by_all(seed: int, share: float) -> None:
    rays = Rays.of(renew.Chart(box(0, 0, SIZE, SIZE), random_islands(seed)))
    rng = np.random.default_rng(seed)
    path = rng.uniform(0, SIZE, (12, 2))
    some = rays.only(rng.random(len(rays.x)) < share)
    assert some.of_word(rays.word(path)) == some.word(path)


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("seed", [1, 2])
def test_the_least_fuel_route_is_the_same_whichever_islands_count(seed: int) -> None:
    chart, current = among_islets(seed), StreamFunctionCurrent(seed, 0.6)

    def plan(distinct_by: DistinctBy) -> renew.Plan:
        return renew.plan(chart, current, PAPER_VESSEL, *WAY, classes=6, distinct_by=distinct_by)

    least = plan(0.0).best.fuel
    for distinct_by in ("auto", 5.0, 1000.0):
        assert plan(distinct_by).best.fuel == pytest.approx(least, rel=2e-4)


def test_choices_pass_the_largest_island_on_either_side() -> None:
    chart, current = among_islets(0), StreamFunctionCurrent(0, 0.3)
    largest = max(chart.no_go, key=lambda island: island.area).centroid
    over = shapely.LineString([largest, (largest.x, SIZE)])
    sides = {
        bool(over.crosses(shapely.LineString(route.path)))
        for route in renew.plan(
            chart, current, PAPER_VESSEL, *WAY, classes=4, distinct_by="auto"
        ).routes
    }
    assert sides == {True, False}
