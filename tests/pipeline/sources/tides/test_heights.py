"""Heights at real stations, beside pyTMD and UTide, and beside the extremes that NOAA publishes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from pipeline.sources.tides.station import Station, find_station
from tests.tide_oracles import PREDICTORS, apart, highest_and_lowest, stations

MONTHS = [np.datetime64(day) for day in ("1990-02-01", "2026-11-22")]
# HAT and LAT of this station both lie 0.11 m above what its own mean sea level and constants give.
OTHER_LEVEL = "noaa-9415193"


@pytest.fixture(scope="module")
def all_stations(shared: Path) -> Mapping[str, Station]:
    assert (shared / "data" / "tides").is_dir()
    found = stations()
    assert len(found) == 21
    return found


@pytest.mark.parametrize("begin", MONTHS)
@pytest.mark.parametrize("name", [pytest.param("pyTMD", marks=pytest.mark.slow), "UTide"])
def test_boston_is_what_the_other_libraries_predict(name: str, begin: np.datetime64) -> None:
    most, rms = apart(find_station("boston"), PREDICTORS[name], begin)
    assert most < 0.01
    assert rms < 0.004


def test_boston_s_highest_and_lowest_tide_are_those_that_noaa_publishes() -> None:
    station = find_station("boston")
    highest, lowest = highest_and_lowest(station)
    assert highest == pytest.approx(station.datums["HAT"], abs=0.012)
    assert lowest == pytest.approx(station.datums["LAT"], abs=0.012)
    tide = station.tide(MONTHS[0])
    assert tide.lowest < lowest
    assert highest < tide.highest


@pytest.mark.slow
@pytest.mark.parametrize("begin", MONTHS)
@pytest.mark.parametrize("name", PREDICTORS)
def test_all_stations_are_what_the_other_libraries_predict(
    name: str, begin: np.datetime64, all_stations: Mapping[str, Station]
) -> None:
    for station in all_stations.values():
        most, rms = apart(station, PREDICTORS[name], begin)
        assert most <= 0.02
        assert rms <= 0.008


@pytest.mark.slow
def test_the_extremes_of_all_stations_are_those_that_noaa_publishes(
    all_stations: Mapping[str, Station],
) -> None:
    # A phase error of 180 degrees in M1, S1 or MF moves some of them by 33 to 90 mm, in M3 by 10
    # mm.
    for key, station in all_stations.items():
        found = np.array(highest_and_lowest(station))
        off = found - (station.datums["HAT"], station.datums["LAT"])
        assert abs(off - (off.mean() if key == OTHER_LEVEL else 0.0)).max() < 0.025
