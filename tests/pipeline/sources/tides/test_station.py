"""Files of stations: each form gives the same tide; all faults are named at once."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.errors import RequestError
from pipeline.scenario import catalogue
from pipeline.sources.tides.station import Station, find_station, read_station

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
    assert len(place.zone) == 3


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
