import hashlib
import json
import os
import resource
import shutil
import sqlite3
import subprocess
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from pipeline.errors import StageError
from pipeline.findings.names import output_directory, safe_name
from pipeline.findings.result import RunResult
from pipeline.scenario.model import Scenario
from pipeline.write import formats_of, write
from tests.commands import PYTHON, ran
from tests.pipeline.formats import small_run
from tests.strategies import examples

FILES = sorted(
    [
        "manifest.json",
        "metrics.csv",
        "report.html",
        "routes.gpkg",
        "scenario.toml",
        "small-run-summer-all.gpx",  # in winter a third route would be dear
    ]
    + [
        f"small-run-{season}{ending}"
        for season in ("summer", "winter")
        for ending in (
            "-currents.nc",
            ".geojson",
            ".gpx",
            ".plan",
            ".rtz",
            ".waypoints",
        )
    ]
)


@pytest.fixture(scope="module")
def result() -> RunResult:
    return small_run.parts()


@pytest.fixture(scope="module")
def written(result: RunResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("written") / "new" / "small-run"
    files = write(result, directory)
    assert sorted(path.name for path in files) == FILES
    assert files[-1].name == "manifest.json"
    return directory


@pytest.fixture
def small_files() -> Iterator[None]:
    """Let no file grow beyond 60 kB: the nearest thing to a full disk that needs no other disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def contents(directory: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in directory.iterdir()}


def put_earlier_files(directory: Path) -> dict[str, bytes]:
    directory.mkdir()
    for name in FILES:
        (directory / name).write_text(f"the earlier {name}")
    (directory / "notes.txt").write_text("the user's own")
    return contents(directory)


def test_all_files_appear_and_nothing_else(written: Path, tmp_path: Path) -> None:
    assert sorted(contents(written)) == FILES
    assert sorted(path.name for path in written.parent.iterdir()) == [".results", "small-run"]
    manifest = json.loads((written / "manifest.json").read_text())
    for name, entry in manifest["outputs"].items():
        assert hashlib.sha256((written / name).read_bytes()).hexdigest() == entry["sha256"]
    assert set(manifest["outputs"]) == set(FILES) - {"manifest.json"}
    # As readable as any file that the user makes.
    fresh = tmp_path / "fresh"
    fresh.touch()
    assert {path.stat().st_mode for path in written.iterdir()} == {fresh.stat().st_mode}


@pytest.mark.usefixtures("plain_report")
def test_a_second_run_replaces_the_first_and_spares_the_users_files(
    result: RunResult, tmp_path: Path
) -> None:
    earlier = put_earlier_files(tmp_path / "run")
    write(result, tmp_path / "run")
    now = contents(tmp_path / "run")
    assert set(now) == set(earlier)
    assert now["notes.txt"] == earlier["notes.txt"]
    assert all(now[name] != earlier[name] for name in FILES)


@pytest.mark.usefixtures("plain_report")
def test_the_scenario_says_when_to_leave_and_which_rtz_the_plotter_reads(
    result: RunResult, tmp_path: Path
) -> None:
    asked = result.scenario.model_dump(mode="json")
    asked["outputs"]["rtz_version"] = "1.0"
    asked["seasons"][0]["departure"] = "2026-07-01T08:00:00+02:00"
    write(replace(result, scenario=Scenario.model_validate_json(json.dumps(asked))), tmp_path)
    assert 'version="1.0"' in (tmp_path / "small-run-summer.rtz").read_text()
    assert 'etd="2026-07-01T06:00:00Z"' in (tmp_path / "small-run-summer.rtz").read_text()
    assert "<time>2026-07-01T06:00:00Z</time>" in (tmp_path / "small-run-summer.gpx").read_text()
    assert "etd=" not in (tmp_path / "small-run-winter.rtz").read_text()
    assert "2026-07-01" not in (tmp_path / "small-run-winter.gpx").read_text()


@pytest.mark.usefixtures("plain_report")
def test_files_of_a_season_that_is_no_longer_planned_go(result: RunResult, tmp_path: Path) -> None:
    write(result, tmp_path)
    (tmp_path / "spring.rtz").write_text("the user's own")
    written = write(small_run.with_a_failed_season(result), tmp_path)
    now = {path.name for path in tmp_path.iterdir()}
    assert now == {path.name for path in written} | {"spring.rtz"}
    winter = {name for name in now if "-winter" in name}
    assert winter == {"small-run-winter-currents.nc"}, "there was a current, but no route"


@pytest.mark.usefixtures("plain_report")
def test_a_season_without_a_current_has_no_files(result: RunResult, tmp_path: Path) -> None:
    written = write(small_run.without_a_current(result), tmp_path)
    names = {path.name for path in written}
    assert {"routes.gpkg", "report.html", "small-run-summer.gpx"} <= names
    assert not [name for name in names if "-winter" in name]


@pytest.mark.usefixtures("plain_report")
def test_a_manifest_that_names_files_elsewhere_takes_none_of_them_away(
    result: RunResult, tmp_path: Path
) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "manifest.json").write_text('{"outputs": {"../mine.txt": {}, "a": {}}}')
    (tmp_path / "mine.txt").write_text("the user's own")
    write(result, tmp_path / "run")
    assert (tmp_path / "mine.txt").read_text() == "the user's own"


@pytest.mark.gate_share(3)
@pytest.mark.parametrize("name", [n for n in FILES if "winter" not in n and "manifest" not in n])
def test_every_format_reports_a_full_disk(
    result: RunResult, written: Path, tmp_path: Path, name: str
) -> None:
    """The file may not grow to half the size that it has: SQLite writes some of its own twice."""
    writer = formats_of(result)[name]
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, ((written / name).stat().st_size // 2, hard))
    try:
        with pytest.raises(OSError, match=r"(?s).+"):
            writer(result, tmp_path / name)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.usefixtures("small_files")
def test_a_file_that_cannot_be_finished_leaves_the_earlier_ones(
    result: RunResult, tmp_path: Path
) -> None:
    earlier = put_earlier_files(tmp_path / "run")
    with pytest.raises(StageError, match=r"cannot write the results to .*run.*--output"):
        write(result, tmp_path / "run")
    assert contents(tmp_path / "run") == earlier
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


@pytest.mark.usefixtures("plain_report")
def test_a_folder_that_cannot_be_replaced_stays_as_it_is(result: RunResult, tmp_path: Path) -> None:
    """The folder around it is immutable, which only shows when all files are written."""
    earlier = put_earlier_files(tmp_path / "run")
    (tmp_path / ".results" / "run").mkdir(parents=True)
    chattr = shutil.which("chattr")
    if (
        not chattr
        or subprocess.run([chattr, "+i", tmp_path], capture_output=True, check=False).returncode
    ):
        pytest.skip("making a folder immutable needs root and a file system that knows how")
    try:
        with pytest.raises(StageError, match="no permission"):
            write(result, tmp_path / "run")
    finally:
        subprocess.run([chattr, "-i", tmp_path], check=True)
    assert contents(tmp_path / "run") == earlier


def test_a_folder_in_a_files_place_is_named(result: RunResult, tmp_path: Path) -> None:
    (tmp_path / "run" / "report.html").mkdir(parents=True)
    with pytest.raises(StageError, match="a folder is in the place of a file"):
        write(result, tmp_path / "run")
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["report.html"]


def test_a_file_in_the_folders_place_is_named(result: RunResult, tmp_path: Path) -> None:
    (tmp_path / "run").write_text("mine")
    with pytest.raises(StageError, match="a file is in the place of a folder"):
        write(result, tmp_path / "run")
    assert (tmp_path / "run").read_text() == "mine"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_no_permission_is_named(result: RunResult, tmp_path: Path) -> None:
    (tmp_path / "locked").mkdir(mode=0o500)
    with pytest.raises(StageError, match="no permission"):
        write(result, tmp_path / "locked" / "run")


@pytest.mark.usefixtures("plain_report")
def test_a_geopackage_open_elsewhere_is_left_alone(result: RunResult, tmp_path: Path) -> None:
    """QGIS opens a GeoPackage with a write-ahead log; its changes must not meet another file."""
    (tmp_path / "run").mkdir()
    with closing(sqlite3.connect(tmp_path / "run" / "routes.gpkg")) as database:
        database.execute("PRAGMA journal_mode = wal")
        database.execute("CREATE TABLE mine (x)")
        database.commit()
        with pytest.raises(StageError, match="open in another program"):
            write(result, tmp_path / "run")
        assert database.execute("SELECT count(*) FROM mine").fetchone() == (0,)
    write(result, tmp_path / "run")


NAMES = st.text(max_size=300)


@examples(30, 100)
@given(NAMES)
def test_any_name_becomes_one_harmless_folder(name: str) -> None:
    safe = safe_name(name)
    assert safe
    assert not safe.startswith((".", "-"))
    assert not set(safe) & set('/\\:*?"<>|\0\n\u202e ')
    assert len(safe.encode()) <= 240
    assert output_directory(Path("outputs"), name).parent == Path("outputs")


@given(NAMES, NAMES)
def test_different_names_get_different_folders(one: str, other: str) -> None:
    assert (safe_name(one) == safe_name(other)) == (one == other)


@pytest.mark.parametrize("name", ["palawan-season", "single_gyre", "a.b", "Île-de-Bréhat"])
def test_ordinary_names_stay(name: str) -> None:
    assert safe_name(name) == name


@pytest.mark.parametrize("name", ["con", "NUL", "aux.2", "com1"])
def test_devices_of_windows_are_no_file_names(name: str) -> None:
    safe = safe_name(name)
    assert safe.partition(".")[0].lower() not in {"con", "nul", "aux", "com1"}
    assert safe != safe_name(f"{name}-")


def test_nothing_is_imported_early() -> None:
    """A plan that fails must not have waited for what draws and writes it."""
    code = "import sys, pipeline.write; print(*sys.modules)"
    loaded = ran(*PYTHON, code, cwd=Path(__file__).parents[3]).split()
    assert not {"matplotlib", "pyogrio", "geopandas", "jinja2"} & set(loaded)
