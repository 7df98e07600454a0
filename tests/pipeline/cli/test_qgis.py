"""The plugin for QGIS is put into a profile, with the path of the program that it calls."""

import ast
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline.cli.main import app
from tests.conftest import ROOT

PLUGIN = ROOT / "qgis" / "renew_routes"
SOURCES = {path.name: path.read_bytes() for path in PLUGIN.iterdir() if path.is_file()}


def installed(*options: str) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["qgis", "install", *options], catch_exceptions=False)
    return done.exit_code, done.output


def test_the_plugin_is_copied_and_knows_its_program(tmp_path: Path) -> None:
    """Also in place of an earlier version, of which nothing is left."""
    target = tmp_path / "renew_routes"
    for _ in range(2):
        code, said = installed("--plugins", str(tmp_path))
        assert code == 0
        assert f"Written to {target}" in said
        found = {path.name: path.read_bytes() for path in target.iterdir()}
        program = found.pop("program.txt").decode().strip()
        assert found == SOURCES
        assert Path(program) == Path(sys.executable).with_name("renew")
        (target / "earlier.py").touch()


def test_the_profile_is_where_qgis_looks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    inside = Path("profiles") / "sea trials" / "python" / "plugins" / "renew_routes"
    monkeypatch.delenv("QGIS_CUSTOM_CONFIG_PATH", raising=False)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert installed("--profile", "sea trials")[0] == 0
    assert (tmp_path / "QGIS" / "QGIS3" / inside / "metadata.txt").is_file()
    monkeypatch.setenv("QGIS_CUSTOM_CONFIG_PATH", str(tmp_path / "own"))
    assert installed("--profile", "sea trials")[0] == 0
    assert (tmp_path / "own" / inside / "metadata.txt").is_file()


def test_something_else_in_its_place_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "renew_routes").mkdir()
    (tmp_path / "renew_routes" / "mine.txt").touch()
    code, said = installed("--plugins", str(tmp_path))
    assert code == 2
    assert "is something else; move it away" in said
    assert (tmp_path / "renew_routes" / "mine.txt").is_file()
    assert installed("--profile", "../elsewhere")[0] == installed("--profile", "..")[0] == 2


def test_the_plugin_needs_nothing_that_qgis_lacks() -> None:
    """It imports QGIS, itself and the standard library alone, and says so in its metadata."""
    for name, content in SOURCES.items():
        if not name.endswith(".py"):
            continue
        for node in ast.walk(ast.parse(content)):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and not node.level:
                names.append(str(node.module))
            known = sys.stdlib_module_names | {"qgis", "processing"}
            assert {one.partition(".")[0] for one in names} <= known, name
    lines = SOURCES["metadata.txt"].decode().splitlines()
    assert {"hasProcessingProvider=yes", "name=RENEW routes"} <= set(lines)


def test_the_zip_holds_the_plugin(tmp_path: Path) -> None:
    """As `make qgis-plugin` makes it."""
    command = [sys.executable, "-m", "zipfile"]
    subprocess.run(
        [*command, "-c", tmp_path / "p.zip", "renew_routes"], cwd=PLUGIN.parent, check=True
    )
    subprocess.run([*command, "-e", tmp_path / "p.zip", tmp_path / "out"], check=True)
    folder = tmp_path / "out" / "renew_routes"
    assert {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} == SOURCES


@pytest.mark.parametrize(
    ("figures", "vessel"),
    [
        ({}, ["--vessel", "usv-7m"]),
        ({"speed": "4kn..9kn"}, ["--vessel", "usv-7m"]),
        ({"draught": "4m"}, []),
        ({"speed": "12kn", "length": "90m", "turning_circle": "400m", "draught": "4m"}, []),
        ({"vessel": "./ship.toml", "draught": "4m"}, ["--vessel", "./ship.toml"]),
    ],
)
def test_the_default_vessel_is_sent_only_without_figures(
    figures: dict[str, str], vessel: list[str]
) -> None:
    """`renew go` refuses a vessel together with a figure; a vessel that the user named is sent."""
    voyage = runpy.run_path(str(PLUGIN / "voyage.py"))
    options = voyage["voyage_options"]()
    texts = dict.fromkeys((option["name"] for option in options), "")
    texts |= {"start": "120.3,12.8", "goal": "116.8,7.7", "vessel": voyage["DEFAULT_VESSEL"]}
    texts |= figures
    command = ["go", *voyage["typed"](options, texts)]
    assert command[:3] == ["go", "120.3,12.8", "116.8,7.7"]
    sent = dict(zip(command[3::2], command[4::2], strict=True))
    named = {name: text for name, text in figures.items() if name != "vessel"}
    typed = {f"--{name.replace('_', '-')}": text for name, text in named.items()}
    assert sent == typed | dict([vessel] if vessel else [])
