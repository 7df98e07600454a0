"""The side on which a route passes the largest island."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st

import renew
from pipeline.geo.projection import Projection
from pipeline.model import Scene
from pipeline.stages.passing_side import PassingSide

if TYPE_CHECKING:
    import numpy.typing as npt

VESSEL = renew.Vessel(speed=1.0, turn_rate=math.radians(35))


def plane_scene(islands: list[shapely.Polygon], start: npt.ArrayLike, goal: npt.ArrayLike) -> Scene:
    """Return a scene in metres at 0 N 0 E: north is up."""
    return Scene(
        chart=renew.Chart(shapely.box(-500, -500, 500, 500), islands),
        land=tuple(islands),
        currents={},
        start=np.asarray(start, dtype=float),
        goal=np.asarray(goal, dtype=float),
        projection=Projection.at(0.0, 0.0),
        vessel=VESSEL,
    )


@given(
    st.floats(0, 2 * math.pi),
    st.integers(0, 2**32 - 1),
    st.booleans(),
)
def test_the_side_is_where_the_way_round_lies(angle: float, seed: int, is_left: bool) -> None:
    """Pass a random island on a known side, on an irregular path."""
    rng = np.random.default_rng(seed)
    spokes = np.sort(rng.uniform(0, 2 * math.pi, 9))
    radii = rng.uniform(20, 90, 9)
    island = shapely.Polygon(np.stack([radii * np.cos(spokes), radii * np.sin(spokes)], -1))
    if not island.is_valid or not island.contains(shapely.Point(0, 0)):
        return
    ahead = np.array([math.cos(angle), math.sin(angle)])
    left = np.array([-ahead[1], ahead[0]])
    # A half turn round the island with a random, even zigzagging, radius beyond it.
    turn = np.linspace(0, math.pi, 40)[1:-1]
    reach = rng.uniform(100, 400, turn.size)
    sign = 1 if is_left else -1
    around = reach[:, None] * (-np.cos(turn)[:, None] * ahead + sign * np.sin(turn)[:, None] * left)
    path = np.concatenate([[-300 * ahead], around, [300 * ahead]])
    rock = shapely.box(430, 430, 440, 440)
    mainland = shapely.box(-500, -500, -400, 500)
    scene = plane_scene([rock, island, mainland], path[0], path[-1])
    side = PassingSide(scene).name(path)
    bearing = math.degrees(math.atan2((sign * left)[0], (sign * left)[1])) % 360
    names = {"north": 0, "east": 90, "south": 180, "west": 270}
    off = abs((names[side] - bearing + 180) % 360 - 180)
    assert off <= 45 + 1e-6


def test_no_island_between_means_no_side() -> None:
    behind = shapely.box(-300, -10, -250, 10)
    mainland = shapely.box(-500, 300, 500, 500)
    scene = plane_scene([behind, mainland], (-200, 0), (200, 0))
    assert PassingSide(scene).name(np.array([(-200.0, 0.0), (200.0, 0.0)])) == ""
