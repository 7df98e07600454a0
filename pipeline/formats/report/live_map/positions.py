"""Where the map's places are: on earth for the pointer, in its own metres for buttons."""

import numpy as np

from pipeline._types import FloatArray
from pipeline.formats.report.live_map.encode import Lattice
from pipeline.formats.shared.result import RunResult

# Number of cells along each side of the chart, at whose corners positions are given: between them
# they are interpolated, on 30 degrees to within 0.01 minute.
_CELLS = 40
# Unit of the positions, degrees: a thousandth of a minute.
_UNIT_DEG = 1 / 60_000


def place_on_map(result: RunResult, place: FloatArray) -> str:
    """A place (2,) of the plane for a button: "x,y", in true metres from the lower left corner."""
    xmin, ymin, _, _ = result.scene.chart.bounds
    x, y = (np.asarray(place) - [xmin, ymin]) * result.scene.projection.scale
    return f"{x:.0f},{y:.0f}" if max(abs(x), abs(y)) >= 1e4 else f"{x:.6g},{y:.6g}"


def positions(result: RunResult, lattice: Lattice) -> dict[str, object] | None:
    """Longitudes and latitudes at the corners of a grid over the chart; None in a plane.

    Row by row from below, each in units of a thousandth of a minute as the difference to the value
    before. Longitudes run on beyond 180 degrees.
    """
    if result.scenario.is_planar:
        return None
    xmin, ymin, xmax, ymax = result.scene.chart.bounds
    x, y = np.linspace(xmin, xmax, _CELLS + 1), np.linspace(ymin, ymax, _CELLS + 1)
    corners = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    lon, lat = result.scene.projection.to_lonlat(corners).T
    lon = np.degrees(np.unwrap(np.radians(lon).reshape(len(y), len(x)), axis=1))
    lon = np.degrees(np.unwrap(np.radians(lon), axis=0)).ravel()
    return {
        "cells": _CELLS,
        "unit": _UNIT_DEG,
        "size": [(xmax - xmin) / lattice.step, (ymax - ymin) / lattice.step],
        "lon": _moves(lon),
        "lat": _moves(lat),
    }


def _moves(values: FloatArray) -> list[int]:
    """Values (n,) in whole units, each as the difference to the one before."""
    whole = np.rint(values / _UNIT_DEG).astype(np.int64)
    return [int(value) for value in np.diff(whole, prepend=0)]
