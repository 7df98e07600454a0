"""Lines across 180 degrees of longitude, for formats that hold -180 to 180."""

import itertools

import numpy as np
import numpy.typing as npt

from pipeline._types import FloatArray


def split_at_antimeridian(points: FloatArray) -> list[FloatArray]:
    """Cut a line (n, 2) in degrees, continuous across 180, into parts within -180 to 180 degrees.

    Both parts end at the cut, at an interpolated latitude. A line that only touches 180 degrees
    stays whole; one that runs along it is at -180.
    """
    turn = _turns(points[:, 0])
    parts: list[list[FloatArray]] = [[points[0] - _shift(turn[0])]]
    for (one, other), (begin, end) in zip(
        itertools.pairwise(points), itertools.pairwise(turn), strict=True
    ):
        step = int(np.sign(end - begin))
        for band in range(begin, end, step or 1):
            edge = 360.0 * (band + (step > 0)) - 180.0
            share = (edge - one[0]) / (other[0] - one[0])
            crossing = np.array([edge, one[1] + share * (other[1] - one[1])])
            parts[-1].append(crossing - _shift(band))
            parts.append([crossing - _shift(band + step)])
        parts[-1].append(other - _shift(end))
    whole = [part for part in map(np.array, parts) if len(np.unique(part, axis=0)) > 1]
    return whole or [np.array(parts[-1])]


def within_180(points: FloatArray) -> FloatArray:
    """Points (n, 2) with longitudes from -180 to below 180 degrees."""
    return points - np.stack([360.0 * _turns(points[:, 0]), np.zeros(len(points))], axis=-1)


def _turns(longitude: FloatArray) -> npt.NDArray[np.int64]:
    """Whole turns (n,) by which longitudes are beyond -180 to below 180 degrees."""
    return np.floor((longitude + 180) / 360).astype(np.int64)


def _shift(turns: int) -> FloatArray:
    """Shift (2,) in degrees for whole turns of longitude."""
    return np.array([360.0 * turns, 0.0])
