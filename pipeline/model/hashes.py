"""Hashes of land and currents, by which a later run knows that they are the same."""

import hashlib

import numpy as np
import shapely

from pipeline.model import CurrentGrid, Land


def land_hash(land: Land) -> str:
    """Return the SHA-256 of a land's polygons."""
    digest = hashlib.sha256()
    for polygon in land.polygons:
        digest.update(shapely.to_wkb(polygon, byte_order=1))
    return digest.hexdigest()


def current_hash(grid: CurrentGrid) -> str:
    """Return the SHA-256 of a current's nodes, times and velocities, equal on every machine."""
    digest = hashlib.sha256()
    for array in (grid.lon, grid.lat, grid.times_s, grid.u, grid.v):
        digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
    return digest.hexdigest()
