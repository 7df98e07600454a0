"""The two predictors of the tide that are not used, pyTMD and UTide; the stations' data.

Both have conventions of their own for a few constituents. `others` of each predictor names them:
they are judged by the other library, and by the highest and lowest tides that NOAA publishes.

- pyTMD and UTide count SA from the perihelion, Schureman from the equinox: 77°. S1 is a quarter of
  a turn off in pyTMD's OTIS; in UTide 154°, and less by a third.
- UTide has other satellites of MF and M1 (there NO1): their nodal factors are off by a quarter and
  by 40 %.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import renew
from pipeline.sources.tides.station import Station, read_station
from renew._types import FloatArray
from renew.inputs.tide import Instants
from tests.conftest import ROOT

STATIONS = ROOT.parent / "shared" / "data" / "tides"
DAY = np.timedelta64(1, "D")
MJD = np.datetime64("1858-11-17")


class Predictor(NamedTuple):
    """Sum of constituents (m) at instants and a latitude; those that it defines otherwise."""

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
