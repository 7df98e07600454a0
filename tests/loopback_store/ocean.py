"""The ocean that the loopback store serves: currents by a formula, gaps on its islands."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import Polygon

from pipeline._types import FloatArray

# Period of the tide M2, h; its strength, m/s.
_M2_HOURS = 12.4206
_TIDE_M_S = 0.35
# Stokes drift under a steady trade wind, m/s east and north.
_STOKES_M_S = (-0.06, -0.03)


@dataclass(frozen=True)
class Ocean:
    """Eddies of about 300 km that drift west, tide, Stokes drift; islands in lon/lat degrees."""

    islands: tuple[Polygon, ...] = ()

    def value(
        self, variable: str, moment: datetime, lon: FloatArray, lat: FloatArray
    ) -> FloatArray:
        """Return a component (ny, nx) in m/s at a moment, on axes in degrees; NaN on islands."""
        x, y = np.meshgrid(lon, lat)
        hours = moment.timestamp() / 3600
        parts = _PARTS[variable]
        value = np.zeros(x.shape)
        for part in parts:
            value += part(x, y, hours)
        value[self.is_land(lon, lat)] = np.nan
        return value

    def is_land(self, lon: FloatArray, lat: FloatArray) -> npt.NDArray[np.bool_]:
        """Which cells have their centre on an island: (ny, nx)."""
        x, y = np.meshgrid((lon + 180) % 360 - 180, lat)
        is_land = np.zeros(x.shape, dtype=bool)
        for island in self.islands:
            west, south, east, north = island.bounds
            near = (x >= west) & (x <= east) & (y >= south) & (y <= north)
            is_land[near] |= shapely.contains_xy(island, x[near], y[near])
        return is_land


def _eddies_u(x: FloatArray, y: FloatArray, hours: float) -> FloatArray:
    """Eastward component of the eddies: of a stream function, so that it does not diverge."""
    phase = np.radians(x) * 60 + hours / 240
    return np.asarray(0.1 + 0.4 * np.sin(phase) * np.cos(np.radians(y) * 60))


def _eddies_v(x: FloatArray, y: FloatArray, hours: float) -> FloatArray:
    """Northward component of the eddies."""
    phase = np.radians(x) * 60 + hours / 240
    return np.asarray(-0.4 * np.cos(phase) * np.sin(np.radians(y) * 60))


def _tide_u(x: FloatArray, y: FloatArray, hours: float) -> FloatArray:
    """Eastward tide."""
    return _TIDE_M_S * np.cos(2 * np.pi * hours / _M2_HOURS + np.radians(x + y))


def _tide_v(x: FloatArray, y: FloatArray, hours: float) -> FloatArray:
    """Northward tide, a quarter of a period later: the current turns along an ellipse."""
    return 0.5 * _TIDE_M_S * np.sin(2 * np.pi * hours / _M2_HOURS + np.radians(x + y))


def _stokes_u(x: FloatArray, y: FloatArray, hours: float) -> FloatArray:
    """Eastward Stokes drift."""
    del y, hours
    return np.full(x.shape, _STOKES_M_S[0])


def _stokes_v(x: FloatArray, y: FloatArray, hours: float) -> FloatArray:
    """Northward Stokes drift."""
    del y, hours
    return np.full(x.shape, _STOKES_M_S[1])


_PARTS = {
    "uo": (_eddies_u,),
    "vo": (_eddies_v,),
    "utide": (_tide_u,),
    "vtide": (_tide_v,),
    "vsdx": (_stokes_u,),
    "vsdy": (_stokes_v,),
    "utotal": (_eddies_u, _tide_u, _stokes_u),
    "vtotal": (_eddies_v, _tide_v, _stokes_v),
}
