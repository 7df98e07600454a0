"""Contingency manoeuvres as the paper flies them: one hard-over turn a station, to a drawn side.

`renew.contingency` flies ten: to both sides, in the field and in four draws of its spread.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely

from renew.turns.contingency import fly_turns, stations

if TYPE_CHECKING:
    import renew
    from renew._types import FloatArray


def one_turn_a_station(
    path: FloatArray,
    chart: renew.Chart,
    current: renew.CurrentField,
    vessel: renew.Vessel,
    *,
    spacing: float,
    seed: int = 0,
) -> tuple[int, int]:
    """Collisions and trials: a full turn from every `spacing` metres of a path (n, 2)."""
    points, course = stations(np.asarray(path, dtype=float), spacing)
    rng = np.random.default_rng(seed)
    side = rng.integers(0, 2, len(points))
    tracks = fly_turns(points, course, current, vessel, np.zeros((1, 1, 2)), np.zeros(len(points)))
    flown = shapely.linestrings(tracks[np.arange(len(points)), side])
    if not chart.no_go:
        return 0, len(points)
    touched = shapely.STRtree(chart.no_go).query(flown, predicate="intersects")[0]
    return len(np.unique(touched)), len(points)
