"""Two tide predictors that the program does not use, pyTMD and UTide, and the stations' data.

Both have conventions of their own for a few constituents. `others` of each predictor names them:
they are judged by the other library, and by the highest and lowest tides that NOAA publishes.

- pyTMD and UTide count SA from the perihelion, Schureman from the equinox: 77°. S1 is a quarter of
  a turn off in pyTMD's OTIS; in UTide 154°, and less by a third.
- UTide has other satellites of MF and M1 (there NO1): their nodal factors are off by a quarter and
  by 40 %.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

import renew
from pipeline.sources.tide_stations import Station, read_station
from renew._types import FloatArray
from renew.inputs.tide import Instants, arguments
from tests.conftest import ROOT

STATIONS = ROOT.parent / "shared" / "data" / "tides"
DAY = np.timedelta64(1, "D")
MJD = np.datetime64("1858-11-17")


class Predictor(NamedTuple):
    """Sum (m) of constituents at instants and a latitude; `others` it defines differently."""

    heights: Callable[[dict[str, renew.Constant], Instants, float], FloatArray]
    others: tuple[str, ...]


def stations() -> dict[str, Station]:
    """Return the stations of `../shared/data/tides`, none where that is absent."""
    return {path.stem: read_station(path) for path in sorted(STATIONS.glob("*.json"))}


def by_pytmd(constants: dict[str, renew.Constant], at: Instants, _: float) -> FloatArray:
    """Return the sum (m) by pyTMD, with the nodal corrections of OTIS and Doodson's M1."""
    from pyTMD.constituents import arguments

    spelled = {"LAM2": "lambda2", "RHO": "rho1"}
    names = [spelled.get(name, name.lower()) for name in constants]
    turned, factors, angles = arguments((at - MJD) / DAY, names, corrections="OTIS", M1="Doodson")
    return _sum(constants, factors, np.radians(angles) + turned)


def by_utide(constants: dict[str, renew.Constant], at: Instants, latitude: float) -> FloatArray:
    """Return the sum (m) by UTide, with exact times and satellites for the latitude."""
    from utide._ut_constants import ut_constants
    from utide.harmonics import FUV

    spelled = {"LAM2": "LDA2", "RHO": "RHO1", "2MK3": "MO3", "M1": "NO1"}
    known = [str(name).strip() for name in ut_constants.const.name]
    index = np.array([known.index(spelled.get(name, name)) for name in constants])
    days = (at - MJD) / DAY + 678576.0
    factors, turns, angles = FUV(days, days.mean(), index, latitude, [False] * 4)
    return _sum(constants, factors, 2 * np.pi * (turns + angles))


def _sum(constants: dict[str, renew.Constant], factors: Any, angles: Any) -> FloatArray:  # noqa: ANN401
    amplitude, phase = np.array([*constants.values()]).T
    return np.asarray((factors * np.cos(angles - np.radians(phase))) @ amplitude)


PREDICTORS = {
    "pyTMD": Predictor(by_pytmd, ("SA", "S1")),
    "UTide": Predictor(by_utide, ("SA", "S1", "MF", "M1")),
}


def apart(station: Station, predictor: Predictor, begin: np.datetime64) -> tuple[float, float]:
    """Return the largest and the rms difference over 30 days, shares of the amplitudes' sum."""
    constants = {
        name: one
        for name, one in station.constants.items()
        if one.amplitude > 0 and name not in predictor.others
    }
    seconds = np.arange(0, 30 * 86400.0, 600)
    at = begin + (1e6 * seconds).astype("timedelta64[us]")
    ours = renew.Tide(constants, 0.0, begin).heights(seconds)
    latitude = station.position[1] if station.position else 0.0
    off = ours - predictor.heights(constants, at, latitude)
    whole = sum(one.amplitude for one in station.constants.values())
    return float(abs(off).max()) / whole, float(np.sqrt((off**2).mean())) / whole


def highest_and_lowest(station: Station) -> tuple[float, float]:
    """Return the extremes (m over datum) of 1983 to 2001, the epoch of NOAA's HAT and LAT."""
    epoch = np.datetime64("1983-01-01")
    hours = np.arange(0, float((np.datetime64("2002-01-01") - epoch) / np.timedelta64(1, "h")))
    tide = station.tide(epoch)
    hourly = tide._predicted(3600 * hours)
    found = []
    for sign in (1, -1):
        best = 3600 * hours[np.argsort(-sign * hourly)[:40]]
        around = best[:, None] + np.arange(-3600.0, 3601, 120)
        found.append(sign * float((sign * tide.heights(around.ravel())).max()))
    return found[0], found[1]


# Amplitude (m/s) and phase lag (degrees) of u; v has 0.7 of it, 90° later.
STREAM = {"M2": (1.0, 40.0), "S2": (0.4, 80.0), "N2": (0.25, 20.0), "K1": (0.35, 200.0),
          "O1": (0.25, 170.0), "M4": (0.2, 310.0)}  # fmt: skip
NOISE = 0.1


def utide_sum(hours: np.ndarray[Any, Any], turned: float = 0.0) -> np.ndarray[Any, Any]:
    """Sum the constituents from 2025 on by UTide, whose arguments are not those of the fit."""
    from utide._ut_constants import ut_constants
    from utide.harmonics import ut_E

    names = [str(name).strip() for name in ut_constants.const.name]
    index = [names.index(name) for name in STREAM]
    days = np.datetime64("2025-01-01").astype(int) + 719163 + hours / 24
    basis = ut_E(days, days.mean(), ut_constants.const.freq[index], index, 50.0, [False] * 4, None)
    figures = np.array([*STREAM.values()])
    phasors = figures[:, 0] * np.exp(-1j * np.radians(figures[:, 1] + turned))
    return np.asarray((basis * phasors).real.sum(axis=1))


def series(days: float, noise: float = NOISE, seed: int = 1) -> xr.Dataset:
    """Hourly currents on 2 x 3 nodes, the last of which is land."""
    hours = np.arange(24 * days)
    rng = np.random.default_rng(seed)
    scale = np.array([[1.0, 0.8, 0.6], [1.2, 1.4, 0.0]])
    u = utide_sum(hours)[:, None, None] * scale + 0.3
    v = 0.7 * utide_sum(hours, 90.0)[:, None, None] * scale - 0.1
    data = {
        name: (("time", "lat", "lon"), one + rng.normal(0, noise, one.shape), {"units": "m s-1"})
        for name, one in (("u", u), ("v", v))
    }
    for _, values, _ in data.values():
        values[:, 1, 2] = np.nan
    axes = {"time": ("time", hours, {"units": "hours since 2025-01-01"}),
            "lat": ("lat", [50.0, 50.1]), "lon": ("lon", [-2.0, -1.9, -1.8])}  # fmt: skip
    return xr.Dataset(data, axes)


def fit_errors(found: xr.Dataset) -> tuple[float, float, float]:
    """Return the errors of a fit to a year of `series`.

    Of amplitudes, as a share; of phases, degrees; and the rms of the month after, m/s.
    """
    shares, turns = [], []
    for part, ratio, turn in (("u", 1.0, 0.0), ("v", 0.7, 90.0)):
        fitted = found[f"{part}_re"] + 1j * found[f"{part}_im"]
        for name, (amplitude, phase) in STREAM.items():
            one = fitted.sel(constituent=name).values[1, 1] / (1.4 * ratio * amplitude)
            shares.append(abs(abs(one) - 1))
            turns.append(abs(np.degrees(np.angle(one * np.exp(1j * np.radians(phase + turn))))))
    hours = np.arange(365 * 24.0, 395 * 24.0)
    at = np.datetime64("2025-01-01") + (3600 * hours).astype("m8[s]")
    factors, angles = arguments(found["constituent"].values.tolist(), at)
    constants = (found["u_re"] + 1j * found["u_im"]).values[:, 0, 0]
    predicted = (factors.T * np.exp(1j * angles.T) @ constants).real
    off = predicted - utide_sum(hours)
    return max(shares), max(turns), float(np.sqrt((off**2).mean()))
