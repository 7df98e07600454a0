"""What a run records for machines: the manifest, and its currents as GRIB."""

from __future__ import annotations

import hashlib
import json
import platform
import struct
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import eccodes
import numpy as np
import pytest
import shapely

from pipeline.findings.result import RunResult
from pipeline.formats.records import (
    _ibm_below,
    _message,
    _product,
    has_grib,
    manifest,
    write_grib,
    write_manifest,
)
from pipeline.model import CurrentGrid, ShutStrait
from pipeline.write import formats_of
from tests.commands import ended
from tests.pipeline.formats import small_run
from tests.pipeline.formats.currents_files import planners, with_grids
from tests.pipeline.results import with_case


def test_the_manifest_accounts_for_inputs_and_outputs(result: RunResult, tmp_path: Path) -> None:
    output = tmp_path / "something.bin"
    output.write_bytes(b"abc" * 1000)
    write_manifest(result, tmp_path / "manifest.json", [output])
    text = (tmp_path / "manifest.json").read_text(encoding="utf-8")
    content = json.loads(text, parse_constant=lambda name: f"not JSON: {name}")
    assert "not JSON" not in text
    assert content["outputs"] == {
        "something.bin": {
            "bytes": 3000,
            "sha256": hashlib.sha256(b"abc" * 1000).hexdigest(),
        }
    }
    assert content["scenario_as_run"]["name"] == "small-run"
    assert content["created_utc"] == "2026-01-02T03:04:05+00:00"
    assert content["land_sources"][0]["text"] == small_run.LAND.text
    assert [(s["season"], s["valid"]) for s in content["current_sources"]] == [
        ("summer", "2020-06-17"),
        ("winter", "2024-01"),
    ]
    assert content["notes"] == list(small_run.NOTES)
    assert content["timings_s"] == {"fetch": 0.25, "plan": 1.0}
    assert {"python", "numpy", "shapely", "GEOS", "PROJ"} <= set(content["versions"])
    assert [s["status"] for s in content["seasons"]] == ["planned", "planned"]
    assert content["platform"]["machine"] == platform.machine()
    assert str(tmp_path) not in text
    assert "/home" not in text


def test_files_are_named_without_their_folders(
    result: RunResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    argv = ["/opt/bin/renew", "run", "/home/me/my scenario.toml", "--charts=/data/enc", "--offline"]
    monkeypatch.setattr("sys.argv", argv)
    seasons = tuple(
        season.model_copy(update={"currents": (("/data/my currents.nc",), "table")})
        for season in result.scenario.seasons
    )
    asked = result.scenario.model_copy(update={"seasons": seasons})
    words = "see https://example.org/a/b and /data/enc/US1.000; 0.5 m/s, /srv/x.nc: 1/2 read"
    changed = replace(
        result, scenario=asked, fetched=replace(result.fetched, notes=(small_run.note(words),))
    )
    content = manifest(changed, [])
    assert content["command"] == "renew run 'my scenario.toml' --charts=enc --offline"
    words = "see https://example.org/a/b and US1.000; 0.5 m/s, x.nc: 1/2 read"
    assert content["notes"] == [words]
    assert content["note_values"] == [
        {
            "text": words,
            "kind": "source-passed-over",
            "seasons": [],
            "values": {"source": "a source", "reason": words},
        }
    ]
    text = json.dumps(content)
    assert "my currents.nc" in text
    assert "https://example.org/land" in text
    for folder in ("/data", "/home", "/srv", "/opt"):
        assert folder not in text


def test_the_code_is_named_by_its_commit(result: RunResult) -> None:
    code = manifest(result, [])["code"]
    assert isinstance(code, dict)
    root = Path(__file__).resolve().parents[3]
    asked = ["git", "-C", str(root), "rev-parse", "HEAD"]
    found = ended(*asked)
    if found.returncode:
        pytest.skip("not a checkout")
    assert code["commit"].removesuffix("-dirty") == found.stdout.strip()
    assert len(code["plan_sha256"]) == 64


def test_different_inputs_have_different_hashes(result: RunResult) -> None:
    before = manifest(result, [])["inputs"]
    moved = tuple(shapely.affinity.translate(p, 1e-7) for p in result.fetched.land.polygons)
    grid = result.fetched.currents[0]
    grids = (replace(grid, v=-grid.v), *result.fetched.currents[1:])
    land = replace(result.fetched.land, polygons=moved)
    changed = replace(
        result,
        fetched=replace(result.fetched, land=land, currents=grids),
        scenario=result.scenario.model_copy(update={"scale": 999.0}),
    )
    after = manifest(changed, [])["inputs"]
    assert isinstance(before, dict)
    assert isinstance(after, dict)
    assert manifest(result, [])["inputs"] == before
    for name in ("land", "scenario"):
        assert before[name]["sha256"] != after[name]["sha256"]
    assert before["currents"]["summer"]["sha256"] != after["currents"]["summer"]["sha256"]
    assert before["currents"]["winter"] == after["currents"]["winter"]


def test_the_manifest_names_a_failed_season(result: RunResult) -> None:
    seasons = manifest(small_run.with_a_failed_season(result), [])["seasons"]
    assert isinstance(seasons, list)
    assert seasons[1]["status"] == "failed"
    assert seasons[1]["failure"].startswith("no water joins")


def test_what_is_not_known_and_straits_are_in_the_manifest(result: RunResult) -> None:
    straits = tuple(
        ShutStrait(119.5, 9.5, 900.0 - i, 1000.0, 760.0, "padding", saves=0.3 * (i < 2), way=i < 2)
        for i in range(12)
    )
    content = manifest(replace(result, straits=straits), [])
    unknown = content["unknown"]
    assert isinstance(unknown, list)
    assert unknown[0].startswith("no depths in this chart")
    assert unknown[1].startswith("12 straits are shut by margin or padding; a way would be 30%")
    assert content["shut_straits_in_all"] == 12
    listed = content["shut_straits"]
    assert isinstance(listed, list)
    assert [one["width_m"] for one in listed] == [900.0 - i for i in range(12)]
    assert json.loads(json.dumps(listed[0])) == {
        "lon": 119.5,
        "lat": 9.5,
        "width_m": 900.0,
        "needed_m": 1000.0,
        "padding_m": 760.0,
        "by": "padding",
        "seasons": [],
        "saves": 0.3,
        "way": 1,
        "beside": [],
    }


TIME = datetime(2024, 7, 31, 23, 45, tzinfo=UTC)


def fields(path: Path) -> list[dict[str, object]]:
    """All fields of a file by ecCodes: their parameter, time, level, and (n, 3) lat, lon, value."""
    found = []
    with path.open("rb") as file:
        while (handle := eccodes.codes_grib_new_from_file(file)) is not None:
            points = eccodes.codes_grib_get_data(handle)
            keys = ["indicatorOfParameter", "dataDate", "dataTime", "step", "missingValue"]
            keys += ["validityDate", "validityTime"]
            found.append(
                {key: eccodes.codes_get(handle, key) for key in keys}
                | {"level": eccodes.codes_get(handle, "typeOfLevel")}
                | {"points": np.array([[one["lat"], one["lon"], one["value"]] for one in points])}
            )
            eccodes.codes_release(handle)
    return found


def values_of(message: bytes) -> list[float | None]:
    """Decode a message as a plotter does: 32-bit IBM reference, bitmap, whole bytes of values."""
    assert message[:4] == b"GRIB"
    assert message[-4:] == b"7777"
    assert int.from_bytes(message[4:7], "big") == len(message)
    at, sections = 8, []
    for _ in range(4):
        size = int.from_bytes(message[at : at + 3], "big")
        sections.append(message[at : at + size])
        at += size
    assert at == len(message) - 4
    product, grid, bitmap, data = sections
    assert (len(product), len(grid), data[10], product[26:28]) == (28, 32, 16, b"\0\0")
    count = int.from_bytes(grid[6:8], "big") * int.from_bytes(grid[8:10], "big")
    bits = "".join(f"{byte:08b}" for byte in bitmap[6:])
    assert len(bits) - bitmap[3] == count
    power = (data[4] & 0x7F) * 256 + data[5]
    power = -power if data[4] & 0x80 else power
    sign, exponent = -1 if data[6] & 0x80 else 1, (data[6] & 0x7F) - 64
    reference = sign * int.from_bytes(data[7:10], "big") / 2**24 * 16.0**exponent
    packed = iter(struct.unpack(f">{bits[:count].count('1')}H", data[11:-1]))
    return [reference + next(packed) * 2.0**power if bit == "1" else None for bit in bits[:count]]


@pytest.mark.parametrize("season", ["summer", "winter"])
def test_eccodes_finds_the_planners_current(result: RunResult, tmp_path: Path, season: str) -> None:
    """Within 5e-5 m/s: of 16 bits; and only where the source has a figure, and in the chart."""
    write_grib(result.case(season), tmp_path / "c.grb")
    found = fields(tmp_path / "c.grb")
    assert [one["indicatorOfParameter"] for one in found] == [49, 50]
    assert {(one["level"], one["step"]) for one in found} == {("surface", 0)}
    grid = result.case(season).grid
    assert grid is not None
    points = np.asarray(found[0]["points"])
    # Some nodes lie on the edge of a cell, or of the chart.
    nodes = points[:, 1::-1].round(3)
    xy = result.water.projection.to_plane(nodes)
    expected = planners(result, season, xy)
    known = points[:, 2] != found[0]["missingValue"]
    assert 0 < known.sum() < known.size, "there is land"
    for component, one in enumerate(found):
        values = np.asarray(one["points"])[:, 2]
        np.testing.assert_array_equal(values != one["missingValue"], known)
        np.testing.assert_allclose(values[known], expected[known, component], rtol=0, atol=5e-5)
    xmin, ymin, xmax, ymax = result.water.chart.bounds
    inside = (xy[:, 0] >= xmin) & (xy[:, 0] <= xmax) & (xy[:, 1] >= ymin) & (xy[:, 1] <= ymax)
    np.testing.assert_array_equal(known, inside & grid.cells.at(nodes))


def test_a_current_that_changes_has_a_field_at_each_of_its_times(
    result: RunResult, tmp_path: Path
) -> None:
    lon, lat = np.arange(118.0, 121.6, 0.25), np.arange(8.0, 11.1, 0.25)
    shape = (3, lat.size, lon.size)
    u, v = np.random.default_rng(1).uniform(-0.5, 0.5, (2, *shape))
    times = np.array([-3600.0, 0.0, 5400.0])
    grid = CurrentGrid("summer", lon, lat, u, v, "x", small_run.STAND_IN, times_s=times)
    run = with_grids(result, grid)
    run = with_case(run, "summer", departure=TIME)
    write_grib(run.case("summer"), tmp_path / "c.grb")
    found = fields(tmp_path / "c.grb")
    # A plotter takes the fields of one reference time for one forecast; steps are whole hours.
    references = [(one["dataTime"], one["step"]) for one in found[::2]]
    assert references == [(2245, 0), (2245, 1), (2315, 2)]
    valid = [(one["validityDate"], one["validityTime"]) for one in found]
    said = [(*one, field["indicatorOfParameter"]) for one, field in zip(valid, found, strict=True)]
    days = [(20240731, 2245), (20240731, 2345), (20240801, 115)]
    assert said == [(*day, number) for day in days for number in (49, 50)]
    for one, seconds in zip(found[::2], times, strict=True):
        points = np.asarray(one["points"])
        known = points[:, 2] != one["missingValue"]
        xy = run.water.projection.to_plane(points[:, 1::-1])
        expected = planners(run, "summer", xy, float(seconds))[:, 0]
        np.testing.assert_allclose(points[known, 2], expected[known], rtol=0, atol=5e-5)


def test_a_current_without_a_time_has_no_file(result: RunResult) -> None:
    grid = result.case("summer").grid
    assert grid is not None
    undated = with_grids(result, replace(grid, valid="some time or other"))
    assert not has_grib(undated.case("summer"))
    names = {name for name in formats_of(undated) if "currents" in name}
    assert names == {"small-run-summer-currents.nc"}


def test_a_current_without_a_value_in_the_chart_has_no_file(result: RunResult) -> None:
    """Its nodes may be further apart than the chart is wide."""
    grid = result.case("summer").grid
    assert grid is not None
    grids = (replace(grid, u=np.full_like(grid.u, np.nan)),)
    empty = replace(result, fetched=replace(result.fetched, currents=grids))
    assert not has_grib(empty.case("summer"))
    assert not [name for name in formats_of(empty) if "summer" in name and name.endswith(".grb")]


@pytest.mark.parametrize(
    "values",
    [
        [0.0] * 6,
        [0.05] * 6,
        [-1.5, 0.0, 2.5, 1e-7, -1e-7, 3.0],
        [-0.0625, -0.0625, 0.0, 0.0, 0.0, 0.1],
        [1e-12, 2e-12, 0.0, 0.0, 0.0, 0.0],
        [-9.99, 9.99, 5.0, 0.1, -0.1, 1 / 3],
    ],
)
def test_values_are_packed_to_half_a_step(values: list[float]) -> None:
    """Also those of one value, which have their 16 bits each: OpenCPN takes none for noise."""
    array = np.array(values).reshape(2, 3)
    known = np.array([[True, True, False], [True, True, True]])
    lon, lat = np.array([-1000, 0, 1000]), np.array([-500, 500])
    found = values_of(_message(_product(49, TIME, 0), lon, lat, array, known))
    step = max(float(np.ptp(array[known])), 1e-6) / 65535 * 2
    for one, expected, is_known in zip(found, values, known.reshape(-1), strict=True):
        assert (one is not None) == is_known
        assert one is None or one == pytest.approx(expected, abs=step / 2 + 1e-9)


def test_an_ibm_number_is_the_largest_up_to_a_value() -> None:
    rng = np.random.default_rng(2)
    some = [0.0, 1.0, -1.0, 0.0625, -0.0625, -15.9999999999, 1e-300, -1e-300]
    for value in [*some, *(rng.normal(size=200) * 10.0 ** rng.integers(-9, 3, 200))]:
        found, code = _ibm_below(float(value))
        sign, power = -1 if code[0] & 0x80 else 1, (code[0] & 0x7F) - 64
        read = sign * int.from_bytes(code[1:], "big") / 2**24 * 16.0**power
        assert read == found <= value
        assert value - found <= max(abs(value) * 2.0**-20, 16.0**-64)
