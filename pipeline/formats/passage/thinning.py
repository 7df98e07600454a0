"""Fewest waypoints: a shortest path through candidate waypoints that see each other."""

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from pipeline._types import FloatArray, IntArray
from pipeline.formats.passage.candidates import Candidates, concatenated, with_candidates
from pipeline.formats.passage.cheapest_chain import cheapest_chain
from pipeline.formats.passage.safe_corridor import SafeCorridor
from pipeline.formats.passage.tracks import Drawing
from pipeline.formats.shared.legs import metres_along

# Maximum number of parts into which a leg is split when its drawn curve leaves the corridor.
_MAX_PARTS = 64


def thin(corridor: SafeCorridor, drawing: Drawing) -> Candidates:
    """Choose the fewest waypoints, start and goal included, whose legs stay in the corridor.

    Legs on which the path leaves V at its start or enters it at its goal stay as planned.
    """
    first, last = corridor.first, corridor.last
    path = Candidates(corridor.path, metres_along(corridor.path))
    before = _split_legs(path[: first + 1], corridor.off_land, drawing)
    middle = _split_legs(path[first : last + 1], corridor.free, drawing)
    after = _split_legs(path[last:], corridor.off_land, drawing)
    if len(middle.xy) > 2:
        middle = cheapest_chain(*with_candidates(middle, corridor), corridor, drawing)
    # Each part ends where the next one begins.
    return concatenated(before[:-1], middle, after[1:])


def _split_legs(path: Candidates, region: BaseGeometry, drawing: Drawing) -> Candidates:
    """Add points to legs whose drawn curves leave the region, until they stay inside."""
    if len(path.xy) < 2:
        return path
    lonlat = drawing.lonlat(path.xy)
    fits = shapely.covers(region, drawing.lines(lonlat[:-1], lonlat[1:]))
    shares = [
        np.zeros(1) if fits[leg] else _split_shares(path.xy[leg : leg + 2], region, drawing)
        for leg in range(len(fits))
    ]
    leg = np.repeat(np.arange(len(fits)), [len(share) for share in shares])
    share = np.concatenate([*shares, np.empty(0)])
    return Candidates(
        np.vstack([_interpolated(path.xy, leg, share[:, None]), path.xy[-1:]]),
        np.append(_interpolated(path.along, leg, share), path.along[-1]),
    )


def _interpolated(values: FloatArray, leg: IntArray, share: FloatArray) -> FloatArray:
    """Values (n, ...) at shares of legs."""
    value: FloatArray = values[leg] + share * (values[leg + 1] - values[leg])
    return value


def _split_shares(leg: FloatArray, region: BaseGeometry, drawing: Drawing) -> FloatArray:
    """Shares at which the parts of a leg (2, 2) begin; only 0 if the leg itself leaves the region.

    The parts are equal, and as few as stay inside the region.
    """
    parts = 2
    while parts <= _MAX_PARTS:
        points = drawing.lonlat(leg[0] + np.linspace(0, 1, parts + 1)[:, None] * (leg[1] - leg[0]))
        if shapely.covers(region, drawing.lines(points[:-1], points[1:])).all():
            return np.arange(parts) / parts
        parts *= 2
    return np.zeros(1)
