"""`renew check` opens what a scenario names; `renew clean --all` says what it takes, and asks."""

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from pipeline.cli.main import app
from renew._compiled import user_cache
from tests.pipeline.small_region import small_region

_SEASON = "[[seasons]]\nname = 'now'\nvalid = '2024-07'\ncurrents = ['still']\n"
_SQUARE = [[118.49, 10.24], [118.51, 10.24], [118.51, 10.26], [118.49, 10.26], [118.49, 10.24]]


def _geojson(kind: str, coordinates: Any) -> str:  # noqa: ANN401 - as JSON has them
    geometry = {"type": kind, "coordinates": coordinates}
    feature = {"type": "Feature", "properties": {"name": "one"}, "geometry": geometry}
    return json.dumps({"type": "FeatureCollection", "features": [feature]})


def _check(folder: Path, tables: str, region: bool = True) -> Result:  # noqa: FBT002 - a test's
    head = small_region("checked").replace("scale = 1000", "scale = 1")
    head = head if region else head.partition("[region]")[0]
    (folder / "scenario.toml").write_text(head + tables + _SEASON)
    return CliRunner().invoke(app, ["check", str(folder / "scenario.toml")])


@pytest.mark.gate_share(3)
@pytest.mark.parametrize("region", [True, False])
@pytest.mark.parametrize(
    ("tables", "file", "good", "bad"),
    [
        ("[[avoid]]\npath = './file.geojson'\n", "file.geojson", ("Polygon", [_SQUARE]), "{"),
        (
            "[havens]\npath = './file.geojson'\nwithin = '6h'\n",
            "file.geojson",
            ("Point", _SQUARE[0]),
            _geojson("Polygon", [_SQUARE]),
        ),
        (
            "[chart]\nsource = './file.geojson'\n",
            "file.geojson",
            ("Polygon", [_SQUARE]),
            '{"type": "FeatureCollection", "features": [',
        ),
    ],
    ids=["avoid", "havens", "chart"],
)
def test_a_file_that_cannot_be_used_is_a_fault(
    tmp_path: Path, tables: str, file: str, good: tuple[str, Any], bad: str, *, region: bool
) -> None:
    (tmp_path / file).write_text(_geojson(*good))
    found = _check(tmp_path, tables, region)
    assert found.exit_code == 0, found.stderr
    (tmp_path / file).write_text(bad)
    found = _check(tmp_path, tables, region)
    assert found.exit_code == 2
    assert file in found.stderr
    assert "valid" not in found.stdout


def test_depths_that_cannot_be_read_are_a_fault(tmp_path: Path) -> None:
    (tmp_path / "file.nc").write_bytes(b"CDF\x01" + b"\0" * 40)
    found = _check(tmp_path, "[chart]\ndepths = './file.nc'\n")
    assert found.exit_code == 2
    assert "file.nc" in found.stderr or "draught" in found.stderr


@pytest.fixture
def land_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of the user with one shoreline in it."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    folder = user_cache()
    assert folder is not None
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "gshhg-1-1.shoreline").write_bytes(b"x" * 100)
    (tmp_path / "out" / ".artefacts").mkdir(parents=True)
    return folder


def test_clean_all_says_what_it_takes_of_the_user_and_needs_a_yes(
    tmp_path: Path, land_cache: Path
) -> None:
    command = ["clean", "--output", str(tmp_path / "out"), "--all"]
    refused = CliRunner().invoke(app, command)
    assert refused.exit_code == 2
    assert str(land_cache) in refused.stderr
    assert "add --yes" in refused.stderr
    assert list(land_cache.iterdir())
    done = CliRunner().invoke(app, [*command, "--yes"])
    assert done.exit_code == 0, done.stderr
    assert not list(land_cache.iterdir())
    assert CliRunner().invoke(app, command).exit_code == 0  # there is nothing to ask for


@pytest.mark.parametrize(("answer", "is_kept"), [("n\n", True), ("y\n", False)])
def test_clean_all_asks_at_a_terminal(
    tmp_path: Path, land_cache: Path, monkeypatch: pytest.MonkeyPatch, answer: str, *, is_kept: bool
) -> None:
    monkeypatch.setattr("pipeline.cli.upkeep.sys", _Terminal)
    command = ["clean", "--output", str(tmp_path / "out"), "--all"]
    asked = CliRunner().invoke(app, command, input=answer)
    assert str(land_cache) in asked.output
    assert (asked.exit_code == 1) is is_kept
    assert bool(list(land_cache.iterdir())) is is_kept


class _Terminal:
    """Stands for `sys` with a terminal as its input."""

    class stdin:  # noqa: N801 - as in `sys`
        @staticmethod
        def isatty() -> bool:
            return True
