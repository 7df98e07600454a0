"""A current between the nodes of its source's grid, and in the gaps of it."""

import numpy as np
from scipy import ndimage

import renew
from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.model import CurrentGrid


def bilinear(grid: CurrentGrid, lonlat: FloatArray, step: int = 0) -> FloatArray:
    """Interpolate east and north velocity (..., 2), m/s, bilinearly at lon/lat (..., 2).

    `step` is the index of one of the grid's times. Gaps are filled first. Points beyond the grid
    get the value at its nearest edge.
    """
    east, north = np.moveaxis(fill_gaps(np.stack([grid.u[step], grid.v[step]], axis=-1)), -1, 0)
    return renew.GriddedCurrent(grid.lon, grid.lat, east, north)(lonlat)


def fill_gaps(field: FloatArray) -> FloatArray:
    """Fill the NaN of a field (ny, nx, 2) outward from its values, ring by ring.

    A filled cell is the mean of those of its eight neighbours that are known. Known values stay
    unchanged.
    """
    field = np.array(field, dtype=float)
    known = np.isfinite(field).all(axis=-1)
    if not known.any():
        raise RequestError("the current has no values at all; name another source in 'currents'")
    field[~known] = 0.0
    ring_and_middle = np.ones((3, 3))
    while not known.all():
        count = ndimage.convolve(known.astype(float), ring_and_middle, mode="constant")
        total = ndimage.convolve(field, ring_and_middle[..., None], mode="constant")
        ring = ~known & (count > 0)
        field[ring] = total[ring] / count[ring][:, None]
        known |= ring
    return field
