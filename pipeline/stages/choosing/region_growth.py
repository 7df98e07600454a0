"""Where a route comes near the edge of its region, there may be a better one beyond.

Where there is no route at all, there may be one far beyond.
"""

from collections.abc import Sequence

import numpy as np

from pipeline._types import FloatArray
from pipeline.geo.earth import METRES_PER_DEGREE
from pipeline.sources.quality.coverage import Bounds, common_bounds

SIDES = ("west", "south", "east", "north")
"""The sides of bounds, in their order."""

# Distance from the edge at which a route counts as near, and by which the region grows, as shares
# of the margin that was left around start, goal and the ways between.
_NEAR, _GROWTH = 0.3, 2.0
# Growth where no way joins start and goal, as a share of their distance.
_OPENING = 0.5
# Least growth that is worth another plan, as a share of the growth wanted.
_LEAST_GAIN = 0.1


def sides_near(bounds: Bounds, paths: Sequence[FloatArray], margin_m: float) -> list[int]:
    """Return the sides of bounds that paths (n, 2), degrees, come near: 0 to 3, as in SIDES."""
    if not paths:
        return []
    lon, lat = np.concatenate(paths).T
    per_lon = METRES_PER_DEGREE * np.cos(np.radians(lat))
    west, south, east, north = bounds
    distances = (
        (lon - west) * per_lon,
        (lat - south) * METRES_PER_DEGREE,
        (east - lon) * per_lon,
        (north - lat) * METRES_PER_DEGREE,
    )
    return [side for side, metres in enumerate(distances) if metres.min() < _NEAR * margin_m]


def grown(bounds: Bounds, sides: Sequence[int], margin_m: float, limits: Bounds) -> Bounds:
    """Move some sides of bounds outward by a multiple of the margin, as far as limits allow.

    Bounds that would gain hardly anything stay as they are.
    """
    return _moved(bounds, sides, _GROWTH * margin_m, limits)


def opened(bounds: Bounds, distance_m: float, limits: Bounds) -> Bounds:
    """Move all sides of bounds outward by a share of a voyage's distance, as far as limits allow.

    Bounds that would gain hardly anything stay as they are.
    """
    return _moved(bounds, range(len(SIDES)), _OPENING * distance_m, limits)


def _moved(bounds: Bounds, sides: Sequence[int], metres: float, limits: Bounds) -> Bounds:
    """Move some sides of bounds outward, as far as limits allow and unless they gain too little."""
    up = metres / METRES_PER_DEGREE
    widest = max(abs(bounds[1]), abs(bounds[3]))
    aside = up / float(np.cos(np.radians(min(widest, 89.0))))
    moves = (-aside, -up, aside, up)
    west, south, east, north = (
        round(bound + move, 3) if side in sides else bound
        for side, (bound, move) in enumerate(zip(bounds, moves, strict=True))
    )
    wider = common_bounds((west, south, east, north), limits) or bounds
    gained = max(abs(new - old) for new, old in zip(wider, bounds, strict=True))
    return wider if gained > _LEAST_GAIN * up else bounds
