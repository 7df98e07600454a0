"""Speeds through water at places beside a path whose legs are sailed at speeds of their own."""

from __future__ import annotations

import numpy as np
import shapely

from renew._types import FloatArray


def speeds_along(points: FloatArray, path: FloatArray, speeds: FloatArray) -> FloatArray:
    """Speeds (m,) at points (m, 2) on a path (n, 2), or close to it, by its legs' (n - 1,), m/s."""
    if np.ptp(speeds) == 0:
        return np.full(len(points), speeds[0])
    ends = np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))
    along = shapely.line_locate_point(shapely.LineString(path), shapely.points(points))
    return np.asarray(speeds[np.minimum(np.searchsorted(ends, along, "right"), len(speeds) - 1)])
