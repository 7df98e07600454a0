"""The h-signature: words name classes, and moving a path within its class doesn't change them."""

from __future__ import annotations

import numpy as np
import shapely
from hypothesis import given, settings
from shapely import box

import renew
from renew.classes.h_signature import Rays, name, shortened
from tests.strategies import SIZE, random_islands, seeds


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
