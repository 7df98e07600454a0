"""A downloaded folder, with data, a scenario and anything else in it, runs no code: SECURITY.md.

Each trick leaves a file of its name where it ran.
"""

import hashlib
import json
import os
import pickle
import shutil
import subprocess
import sys
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from pipeline.machine.store import load_artefact, save_artefact
from renew._compiled import cache_folder
from tests.commands import ended
from tests.pipeline.nightly.nights import REFERENCE, region_night, write_forecast
from tests.pipeline.small_plane import small_plane

# Modules that some process of ours imports: our own, libraries', the standard library's.
_MODULES = (
    *("pipeline", "renew", "catalog"),
    *("numpy", "scipy", "shapely", "pyproj", "pyogrio", "geopandas", "pandas", "xarray", "zarr"),
    *("netCDF4", "cftime", "numcodecs", "copernicusmarine", "roaring_landmask", "yaml", "numba"),
    *("dask", "distributed", "tblib", "typer", "click", "rich", "structlog", "matplotlib"),
    *("json", "encodings", "multiprocessing", "socket", "sitecustomize", "usercustomize"),
)
_OTHERS = (
    *("artefact", "compiler cache", "matplotlib backend", "entry point", "git monitor"),
    *("zarr filter", "zarr compressor", "zarr text filter", "path file", "dask preload"),
)
_MAGIC = b"RENEW artefact 1\n"


class _Touch:
    """Leaves a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, (f"touch '{self.path}'",)


def _hostile_folder(folder: Path, marks: Path) -> None:
    """Lay out all tricks around a scenario and a night that are valid."""
    for name in _MODULES:
        (folder / f"{name}.py").write_text(f"open({str(marks / name)!r}, 'w').close()\n")
    (folder / "plane.toml").write_text(small_plane("plane"))
    night = region_night(folder, departures=1, workers=1)
    night.write_text(night.read_text().replace("currents/*.nc", "currents/*"))
    write_forecast(folder / "currents" / "m.nc", REFERENCE + timedelta(days=1))
    _hostile_zarr(folder, marks)
    _hostile_configuration(folder, marks)


def _hostile_zarr(folder: Path, marks: Path) -> None:
    """Write currents whose latitudes are pickles, in three ways."""
    import xarray as xr

    pickled = {"id": "pickle", "protocol": 5}
    text: dict[str, Any] = {"dtype": "|O", "compressor": None, "filters": [{"id": "vlen-utf8"}]}
    ways: dict[str, dict[str, Any]] = {
        "zarr filter": {"compressor": None, "filters": [pickled]},
        "zarr compressor": {"compressor": pickled},
        "zarr text filter": {**text, "filters": [*text["filters"], pickled]},
    }
    with xr.open_dataset(folder / "currents" / "m.nc") as data:
        for name, changed in ways.items():
            store = folder / "currents" / f"{name.replace(' ', '-')}.zarr"
            data.drop_encoding().to_zarr(store, zarr_format=2, consolidated=False)
            about = store / "latitude" / ".zarray"
            about.write_text(json.dumps({**json.loads(about.read_text()), **changed}))
            (store / "latitude" / "0").write_bytes(pickle.dumps(_Touch(marks / name)))


def _hostile_configuration(folder: Path, marks: Path) -> None:
    """Write settings of libraries and of git that lead to code in the folder."""
    for module, name in (
        ("evil_backend", "matplotlib backend"),
        ("evil_entry", "entry point"),
        ("evil_preload", "dask preload"),
        ("evil_path", "path file"),
    ):
        (folder / f"{module}.py").write_text(f"open({str(marks / name)!r}, 'w').close()\n")
    (folder / "matplotlibrc").write_text("backend: module://evil_backend\n")
    (folder / "evil.pth").write_text("import evil_path\n")
    (folder / "dask.yaml").write_text("distributed: {worker: {preload: [evil_preload]}}\n")
    about = folder / "evil-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: evil\nVersion: 1\n")
    groups = ("xarray.backends", "numcodecs.codecs", "zarr.codecs", "dask.backends")
    entries = "".join(f"[{group}]\nevil = evil_entry:one\n" for group in groups)
    (about / "entry_points.txt").write_text(entries)
    kernels = shutil.copytree(cache_folder(), folder / "kernels" / cache_folder().name)
    for index in kernels.glob("*.nbi"):
        index.write_bytes(pickle.dumps(_Touch(marks / "compiler cache")))
    (folder / ".numba_config.yaml").write_text("cache_dir: ./kernels\n")
    (folder / ".git").mkdir()
    monitor = marks / "git monitor"
    (folder / ".git" / "config").write_text(f'[core]\nfsmonitor = touch "{monitor}"\n')
    (folder / ".git" / "HEAD").write_text("ref: refs/heads/main\n")


def _replace_artefacts(folder: Path, marks: Path) -> None:
    """Replace what a run has stored by pickles of the same names, with right hashes."""
    content = pickle.dumps(_Touch(marks / "artefact"))
    replaced = list(folder.glob("outputs/.artefacts/*/*.artefact"))
    assert len(replaced) > 2
    for path in replaced:
        path.write_bytes(_MAGIC + hashlib.sha256(content).digest() + content)


def _renew(folder: Path, *arguments: str) -> str:
    """Run the command as a user does, in a folder; return what it prints."""
    program = Path(sys.executable).with_name("renew")
    variables = {name: text for name, text in os.environ.items() if name != "PYTHONPATH"}
    done = ended(str(program), *arguments, cwd=folder, env=variables)
    assert done.returncode in {0, 1, 5, 10}, (arguments, done.stderr)
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def marks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Use the program in a hostile folder; give the folder where tricks leave their marks."""
    folder, marks = (tmp_path_factory.mktemp(name) for name in ("hostile", "marks"))
    _hostile_folder(folder, marks)
    assert "valid" in _renew(folder, "check", "plane.toml")
    assert "valid" in _renew(folder, "nightly", "check", "--config", "night.toml")
    _renew(folder, "doctor", "--offline")
    _renew(folder, "run", "plane.toml", "--limit", "300")
    _renew(folder, "run", "plane.toml", "--limit", "300")
    _renew(folder, "plot", "plane.toml")
    _replace_artefacts(folder, marks)
    (folder / "outputs" / "plane").unlink()
    assert "still" in _renew(folder, "run", "plane.toml")
    assert (folder / "outputs" / "plane" / "routes.gpkg").is_file()
    assert "1 same, 0 look, 3 act" in _renew(folder, "nightly", "run", "--config", "night.toml")
    return marks


@pytest.mark.slow
@pytest.mark.parametrize("trick", [*_MODULES, *_OTHERS])
def test_a_downloaded_folder_runs_no_code(marks: Path, trick: str) -> None:
    assert not (marks / trick).exists()


def test_check_runs_no_module_of_the_working_directory(tmp_path: Path) -> None:
    """`renew check` looks into NetCDF files in an interpreter of its own."""
    (tmp_path / "folder").mkdir()
    region_night(tmp_path / "folder", departures=1)
    write_forecast(tmp_path / "folder" / "currents" / "m.nc")
    for name in ("pipeline", "netCDF4", "multiprocessing"):
        mark = tmp_path / name
        (tmp_path / "folder" / f"{name}.py").write_text(f"open({str(mark)!r}, 'w').close()\n")
    text = (tmp_path / "folder" / "region.toml").read_text()
    text = text.replace('"still"', '["currents/m.nc"]').replace("2024-07", "2026-11-21T06:00Z")
    (tmp_path / "folder" / "region.toml").write_text(text)
    assert "valid" in _renew(tmp_path / "folder", "check", "region.toml")
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]


def test_a_stored_pickle_that_calls_anything_counts_as_damaged(tmp_path: Path) -> None:
    stored = tmp_path / "one.artefact"
    save_artefact(stored, {"a": [1.5, REFERENCE]})
    assert load_artefact(stored, dict) == {"a": [1.5, REFERENCE]}
    for value in (_Touch(tmp_path / "ran"), [os.getcwd], subprocess.Popen, eval):
        content = pickle.dumps(value)
        stored.write_bytes(_MAGIC + hashlib.sha256(content).digest() + content)
        with pytest.warns(UserWarning, match="was not written by this program"):
            assert load_artefact(stored, object) is None
    assert not (tmp_path / "ran").exists()
