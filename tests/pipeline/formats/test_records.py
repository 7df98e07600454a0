"""What a run records for machines: the manifest."""

import hashlib
import json
import platform
from dataclasses import replace
from pathlib import Path

import pytest
import shapely

from pipeline.findings.result import RunResult
from pipeline.formats.records import manifest, write_manifest
from pipeline.model import ShutStrait
from tests.commands import ended
from tests.pipeline.formats import small_run


def test_the_manifest_accounts_for_inputs_and_outputs(result: RunResult, tmp_path: Path) -> None:
    output = tmp_path / "something.bin"
    output.write_bytes(b"abc" * 1000)
    write_manifest(result, tmp_path / "manifest.json", [output])
    text = (tmp_path / "manifest.json").read_text(encoding="utf-8")
    content = json.loads(text, parse_constant=lambda name: f"not JSON: {name}")
    assert "not JSON" not in text
    assert content["outputs"] == {
        "something.bin": {"bytes": 3000, "sha256": hashlib.sha256(b"abc" * 1000).hexdigest()}
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
