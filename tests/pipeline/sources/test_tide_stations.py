"""Stations of the tide: their files, heights beside other libraries, and where each counts."""

import itertools
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.geo.projection import Projection
from pipeline.scenario import catalogue
from pipeline.sources.tide_stations import (
    Station,
    distances_by_water,
    find_station,
    read_station,
    tide_zones,
)
from tests.tide_oracles import PREDICTORS, apart, highest_and_lowest, stations

EPOCH = np.datetime64("2026-11-22")
TIMES = np.linspace(0, 30 * 86400, 999)
Change = Callable[[dict[str, Any]], object]


def boston() -> dict[str, Any]:
    data: dict[str, Any] = json.loads(catalogue.stations()["boston"].read_text("utf-8"))
    return data


def harcon() -> dict[str, Any]:
    """Return Boston's constants as NOAA's service answers."""
    rows = [
        {"number": i + 1, "name": one["name"], "description": "", "amplitude": one["amplitude"],
         "phase_GMT": one["phase"], "phase_local": one["phase"] - 71.0, "speed": 1.0}
        for i, one in enumerate(boston()["harmonic_constituents"])
    ]  # fmt: skip
    return {"units": "meters", "HarmonicConstituents": rows, "self": "https://x"}


def written(folder: Path, data: dict[str, Any], name: str = "station.json") -> Path:
    path = folder / name
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


def toml(folder: Path, text: str) -> Path:
    path = folder / "own.toml"
    path.write_text(text, encoding="utf-8")
    return path


def faults_of(path: Path) -> list[str]:
    with pytest.raises(RequestError) as caught:
        read_station(path)
    return list(caught.value.faults)


def heights(station: Station) -> np.ndarray[Any, Any]:
    return station.tide(EPOCH).heights(TIMES)


def test_the_catalogue_has_boston() -> None:
    station = find_station("boston")
    assert (station.name, station.datum) == ("BOSTON", "MLLW")
    assert station.mean_level_m == pytest.approx(2.66 - 1.074)
    assert station.datums["LAT"] == pytest.approx(-0.646, abs=1e-3)
    assert station.datums["MLLW"] == 0
    assert "GT" not in station.datums
    assert station.position == pytest.approx((-71.0503, 42.3539), abs=1e-4)
    assert "Oceanic and Atmospheric Administration, 8443970" in station.credit


def test_all_forms_give_the_same_tide(tmp_path: Path) -> None:
    wanted = heights(find_station("boston"))
    written(tmp_path, harcon(), "noaa.json")
    named = toml(tmp_path, 'constants = "noaa.json"\ndatum = "MLLW"\nmean_level_m = 1.586\n')
    np.testing.assert_allclose(heights(read_station(named)), wanted, atol=1e-9)
    rows = "\n".join(
        f"{one['name']} = {{ amplitude_m = {one['amplitude']:f}, phase_deg = {one['phase']:f} }}"
        for one in boston()["harmonic_constituents"]
    )
    head = "datum = 'MLLW'\nmean_level_m = 1.586\nphases = 'UTC'\nname = 'Pier'\n[constants]\n"
    own = read_station(toml(tmp_path, head + rows))
    np.testing.assert_allclose(heights(own), wanted, atol=1e-9)
    assert own.name == "Pier"


def test_a_place_follows_a_station_by_ratio_and_offset(tmp_path: Path) -> None:
    written(tmp_path, boston(), "boston.json")
    zone = "zone = [[-71.1, 42.2], [-70.9, 42.2], [-70.9, 42.4]]\n"
    text = 'constants = "boston.json"\nratio = 0.9\noffset_min = 12.0\n' + zone
    place = read_station(toml(tmp_path, text))
    reference = find_station("boston").tide(EPOCH)
    np.testing.assert_allclose(heights(place), 0.9 * reference.heights(TIMES - 720), atol=1e-4)
    assert len(place.zone.exterior.coords) == 4


def test_another_datum_of_the_station_s_moves_the_zero(tmp_path: Path) -> None:
    written(tmp_path, boston(), "boston.json")
    station = read_station(toml(tmp_path, 'constants = "boston.json"\ndatum = "LAT"\n'))
    reference = find_station("boston")
    shift = -reference.datums["LAT"]
    np.testing.assert_allclose(heights(station), heights(reference) + shift, atol=1e-9)
    assert station.datums["MLLW"] == pytest.approx(shift)
    unknown = toml(tmp_path, 'constants = "boston.json"\ndatum = "CD"\n')
    (line,) = faults_of(unknown)
    assert line.startswith("own.toml: the chart datum, or mean sea level over it, is missing; give")


@pytest.mark.parametrize(
    ("change", "beginning"),
    [
        (
            lambda data: data.update(harmonic_constituents=data["harmonic_constituents"][:3]),
            "it has 3 constants above 0 m, fewer than 4; give all",
        ),
        (lambda data: data["datums"].pop("MSL"), "the chart datum, or mean sea level over it, is"),
        (lambda data: data.pop("chart_datum"), "the chart datum, or mean sea level over it, is"),
        (
            lambda data: [one.update(amplitude=3.28 * one["amplitude"] * 1.4)
                          for one in data["harmonic_constituents"]],
            "its amplitudes sum to 12.4 m, above the 12 m of any place, as feet or",
        ),
        (
            lambda data: data.update(type="subordinate", harmonic_constituents=[],
                                     offsets={"reference": "noaa/8443970"}),
            ("is a subordinate station, without constants of its own; give a TOML file that names "
             'the file of "noaa/8443970" as `constants`, with `ratio`'),
        ),
        (
            lambda data: data["harmonic_constituents"].append(data["harmonic_constituents"][0]),
            "M2 is given 2 times; leave one",
        ),
        (
            lambda data: data["harmonic_constituents"][0].update(name="M2X"),
            "tide: 'M2X' is no constituent that pyfes knows; leave",
        ),
        (
            lambda data: data["harmonic_constituents"][0].update(amplitude=math.nan),
            "harmonic_constituents[0].amplitude = NaN is not finite",
        ),
    ],
)  # fmt: skip
def test_a_station_that_can_t_be_used_says_why(
    change: Change, beginning: str, tmp_path: Path
) -> None:
    data = boston()
    change(data)
    (line,) = faults_of(written(tmp_path, data))
    assert line.startswith(f"station.json: {beginning}")


def test_noaa_s_constants_in_feet_or_local_phases_are_refused(tmp_path: Path) -> None:
    data = harcon() | {"units": "feet"}
    lines = faults_of(written(tmp_path, data))
    assert lines[0].startswith('station.json: units = "feet": the amplitudes are not in metres; ')
    assert lines[1].startswith("station.json: the chart datum, or mean sea level over it, is miss")
    for row in data["HarmonicConstituents"]:
        del row["phase_GMT"]
    assert faults_of(written(tmp_path, data))[1].startswith(
        "station.json: phase_GMT is missing: phases of the local clock, or κ, differ from it; give"
    )


def test_all_faults_of_a_user_s_file_are_named_at_once(tmp_path: Path) -> None:
    text = (
        "datum = 'LAT'\n[constants]\nM2 = { amplitude_m = 12.0, phase_deg = 3 }\n"
        "XX = { amplitude_m = 1.0, phase_deg = 3 }\n"
    )
    lines = faults_of(toml(tmp_path, text))
    beginnings = ["phases is missing: ", "the chart datum, or mean", "it has 2 constants above",
                  "its amplitudes sum to 13.0 m", "tide: 'XX' is no constituent"]  # fmt: skip
    assert len(lines) == len(beginnings)
    for line, beginning in zip(lines, beginnings, strict=True):
        assert line.startswith(f"own.toml: {beginning}")


@pytest.mark.parametrize(
    ("name", "content", "beginning"),
    [
        ("a.json", "{", "can't be read as JSON: "),
        ("a.json", "[1]", "is JSON without constants: it has neither"),
        ("a.toml", "a = [", "can't be read as TOML: "),
        ("a.toml", "phases = 'EST'\n", 'phases = "EST" is not one of the possible values; give'),
        ("a.toml", "constants = 'x.json'", "constants = '"),
        ("a.toml", "constants = 'a.toml'", "constants = '"),
        ("a.json", "\udcff", "can't be read as JSON: "),
    ],
)
def test_other_files_are_refused(name: str, content: str, beginning: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(content.encode("utf-8", "surrogateescape"))
    assert any(line.startswith(f"{name}: {beginning}") for line in faults_of(path))


def test_a_station_that_is_not_there_is_named_with_the_nearest_name() -> None:
    with pytest.raises(RequestError, match="did you mean 'boston'"):
        find_station("bosto")


# --- Heights at real stations, beside pyTMD and UTide, and beside the extremes that NOAA publishes.


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


# --- Which station counts on which side of a spit, beside the exact way round its tip ---


PLANE = Projection.at(42.3, -71.0, 1.0)
EXTENT = shapely.box(-4000, -3000, 4000, 3000)
# From the northern edge to 1 km from the southern one.
SPIT = shapely.box(-100, -2000, 100, 3000)
WEST, EAST = (-3000.0, 1500.0), (500.0, 1500.0)
CELL = 8000 / 120


def station(name: str, place: tuple[float, float]) -> Station:
    lon, lat = PLANE.to_lonlat(np.array(place)).tolist()
    return Station(name=name, position=(lon, lat), datum="MLLW", mean_level_m=1.0, constants={})


def way(begin: FloatArray, end: FloatArray, spit: shapely.Polygon) -> float:
    """Shortest way outside a box that touches the northern edge: round none, one or two corners."""
    xmin, ymin, xmax, _ = spit.bounds
    inside = shapely.buffer(spit, -1e-6)
    corners = [(xmin, ymin), (xmax, ymin)]
    rounds = [(), *((one,) for one in corners), tuple(corners), tuple(corners[::-1])]
    found = []
    for between in rounds:
        line = [tuple(begin), *between, tuple(end)]
        if not shapely.LineString(line).intersects(inside):
            found.append(sum(itertools.starmap(math.dist, itertools.pairwise(line))))
    return min(found)


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("spit", [SPIT, shapely.box(-1530, -2410, -1410, 3000)])
def test_distances_are_those_of_the_shortest_way_round_a_spit(spit: shapely.Polygon) -> None:
    stations = np.array([WEST, EAST])
    boxes, places, apart = distances_by_water(stations, EXTENT, np.array([spit]))
    water = shapely.difference(EXTENT, spit)
    assert shapely.difference(water, shapely.union_all(boxes)).area < 1e-3
    places, apart = places[::3], apart[:, ::3]
    exact = np.array([[way(one, place, spit) for place in places] for one in stations])
    assert (apart >= exact - 1e-6).all()
    assert (apart <= 1.03 * exact + 3 * CELL).all()
    # Nothing lies between: the straight line.
    straight = np.linalg.norm(stations[:, None] - places[None], axis=2)
    is_open = exact < straight + 1e-9
    assert is_open.mean() > 0.3
    np.testing.assert_allclose(apart[is_open], straight[is_open], atol=1e-6)


def test_a_spit_parts_the_waters_of_two_stations() -> None:
    given = [station("West", WEST), station("East", EAST)]
    zones, far = tide_zones(given, EXTENT, PLANE, np.array([SPIT]))
    rng = np.random.default_rng(3)
    places = rng.uniform((-4000, -3000), (4000, 3000), (800, 2))
    places = places[~shapely.contains_xy(shapely.buffer(SPIT, CELL), places)]
    exact = np.array([[way(np.array(one), at, SPIT) for at in places] for one in (WEST, EAST)])
    is_sure = np.abs(exact[0] - exact[1]) > 0.03 * exact.max(axis=0) + 4 * CELL
    nearest = exact.argmin(axis=0)
    for at, zone in enumerate(zones):
        holds = shapely.contains_xy(zone, places)
        assert (holds == (nearest == at))[is_sure].all()
    # By the straight line the water beside the spit would be the other side's.
    beside = np.array([-300.0, 1500.0])
    assert math.dist(beside, EAST) < math.dist(beside, WEST)
    assert shapely.contains_xy(zones[0], *beside)
    assert far.is_empty
    assert shapely.intersection(*zones).area == pytest.approx(0.0, abs=1e-3)


def test_without_land_between_the_zones_are_those_of_the_straight_line() -> None:
    given = [station("West", WEST), station("East", EAST)]
    islet = np.array([shapely.box(-3990, -2990, -3950, -2950)])
    free, beside = (tide_zones(given, EXTENT, PLANE, land)[0] for land in (islet[:0], islet))
    for one, other in zip(free, beside, strict=True):
        assert shapely.symmetric_difference(one, other).area < 4 * CELL**2


def test_water_beyond_ten_kilometres_by_water_has_no_station() -> None:
    """Three kilometres across a long spit, and fifteen round it."""
    extent, spit = shapely.box(-4000, -9000, 4000, 3000), shapely.box(-100, -8500, 100, 3000)
    given = [station("East", (1500.0, 2000.0))]
    (zone,), far = tide_zones(given, extent, PLANE, np.array([spit]))
    behind = shapely.Point(-1500.0, 2000.0)
    assert far.intersects(behind)
    assert not zone.intersects(behind)
    assert zone.intersects(shapely.Point(1500.0, -5000.0))


def test_a_station_on_a_pier_and_a_pond_keep_what_they_have() -> None:
    pier, dam = shapely.box(450, 1400, 550, 1600), shapely.box(2000, -3000, 4000, -1000)
    pond = shapely.box(2500, -2500, 3500, -1500)
    land = np.array([pier, shapely.difference(dam, pond)])
    _, places, apart = distances_by_water(np.array([EAST]), EXTENT, land)
    in_pond = shapely.contains_xy(shapely.buffer(pond, 1e-6), places)
    assert np.isinf(apart[0, in_pond]).all()
    assert np.isfinite(apart[0, ~in_pond]).all()
    (zone,), _ = tide_zones([station("East", EAST)], EXTENT, PLANE, land)
    assert zone.covers(shapely.box(2600, -2400, 3400, -1600))
