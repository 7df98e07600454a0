"""What breaks at night, with the process really killed or the thing really missing."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from pipeline.errors import MachineError, StageError
from pipeline.machine.cluster import Fleet
from pipeline.nightly.config import load_config
from pipeline.nightly.cycles import BusyError
from pipeline.nightly.night import run_night
from pipeline.nightly.planning import Preparation
from pipeline.nightly.worker import CurrentTask
from tests.commands import ended
from tests.pipeline.nightly.killed_nights import cases_done, night, run_to_the_end, workers_of
from tests.pipeline.nightly.nights import (
    contents,
    plane_night,
    region_night,
    rows,
    set_clock,
    write_forecast,
)
from tests.pipeline.processes import started, wait_until

_DEADLY = Path(__file__).parent / "deadly"


@pytest.fixture
def deadly(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Let the workers of this test's nights die of chosen cases; see `deadly/sitecustomize.py`."""
    path = os.pathsep.join([str(_DEADLY), str(Path(__file__).resolve().parents[3])])
    monkeypatch.setenv("PYTHONPATH", path)
    return monkeypatch


@pytest.mark.slow
@pytest.mark.parametrize("how", ["crash", "memory"])
def test_the_one_case_that_kills_is_named_and_the_night_goes_on(
    tmp_path: Path, deadly: pytest.MonkeyPatch, how: str
) -> None:
    deadly.setenv("RENEW_TEST_DEADLY", f"quick/still/p0007 {how}")
    file = plane_night(tmp_path, pairs=12, workers=1, memory_gb=1.0)
    outcome = run_night(load_config(file, tmp_path / "out"))
    assert outcome.exit_code == 10
    table = rows(tmp_path / "out")
    broken = [row for row in table if row["status"] == "broken"]
    assert [row["case"] for row in broken] == ["quick/still/p0007"]
    assert broken[0]["outcome"] == "act"
    assert [row["status"] for row in table].count("planned") == 11


@pytest.mark.slow
def test_a_disk_that_is_full(tmp_path: Path, cluster: str) -> None:
    disk = tmp_path / "disk"
    config = load_config(plane_night(tmp_path, pairs=16), disk / "out")
    with mounted(disk, "size=100k"):
        with pytest.raises(StageError, match=r"No space left on device|free some space"):
            run_night(config, scheduler=cluster)
        assert not (disk / "out" / "latest").is_symlink()
        assert list((disk / "out").glob("*.partial"))
        subprocess.run(["mount", "-o", "remount,size=20m", str(disk)], check=True)  # noqa: S607 - of util-linux
        assert run_night(config, scheduler=cluster).fresh
        assert len(rows(disk / "out")) == 16


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("size_kb", [32, 64, 128])
def test_a_full_disk_is_no_lack_of_currents(tmp_path: Path, cluster: str, size_kb: int) -> None:
    """Where land and currents are stored, a full disk fails the night: code 1, which is told."""
    write_forecast(tmp_path / "currents" / "a.nc")
    config = load_config(region_night(tmp_path, departures=1), tmp_path / "disk" / "out")
    with mounted(tmp_path / "disk", f"size={size_kb}k"), pytest.raises(MachineError) as caught:
        run_night(config, scheduler=cluster)
    assert caught.value.exit_code == 1
    assert "No space left on device; free some space" in str(caught.value)


@contextlib.contextmanager
def mounted(folder: Path, options: str) -> Iterator[None]:
    """Mount a disk in memory with some options."""
    folder.mkdir()
    mount = shutil.which("mount")
    if mount is None or os.geteuid() != 0:
        pytest.skip("needs to be root, to mount a small tmpfs")
    command = [mount, "-t", "tmpfs", "-o", options, "tmpfs", str(folder)]
    if subprocess.run(command, check=False).returncode:
        pytest.skip("may not mount a tmpfs here")
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)  # noqa: S607 - of util-linux


def test_an_output_that_is_read_only(tmp_path: Path, cluster: str) -> None:
    config = load_config(plane_night(tmp_path), tmp_path / "disk" / "out")
    refused = pytest.raises(StageError, match=r"can't write in .*: Read-only file system; allow it")
    with mounted(tmp_path / "disk", "ro"), refused:
        run_night(config, scheduler=cluster)


def test_a_limit_that_is_reached_keeps_what_is_done(tmp_path: Path, cluster: str) -> None:
    file = plane_night(tmp_path, pairs=30, limit_hours=1e-9)
    with pytest.raises(StageError, match="the limit of 1e-09 h is reached"):
        run_night(load_config(file, tmp_path / "out"), scheduler=cluster)
    assert not (tmp_path / "out" / "latest").exists()
    (partial,) = (tmp_path / "out").glob("*.partial")
    assert (partial / "request.json").is_file()


@pytest.mark.slow
def test_a_worker_that_dies_as_it_starts(tmp_path: Path) -> None:
    file, output = plane_night(tmp_path, pairs=2, workers=1), tmp_path / "out"
    with started(*night(file, output)) as process:
        wait_until(lambda: workers_of(process.pid))
        (worker,) = workers_of(process.pid)
        os.kill(worker, signal.SIGKILL)
        _, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors
    assert [row["status"] for row in rows(output)] == ["planned"] * 2


@pytest.mark.slow
def test_two_jobs_at_once(tmp_path: Path) -> None:
    file, output = plane_night(tmp_path, pairs=40, workers=1), tmp_path / "out"
    with started(*night(file, output)) as first:
        wait_until(lambda: list(output.glob("*.partial/request.json")))
        with pytest.raises(BusyError, match=f"process {first.pid} on "):
            run_night(load_config(file, output))
        first.communicate(timeout=300)
        assert first.returncode == 0


@pytest.mark.slow
def test_a_worker_of_another_version_is_refused(tmp_path: Path, cluster: str) -> None:
    # The same code, but for a comment, in another place.
    root = Path(__file__).resolve().parents[3]
    other = tmp_path / "other"
    for name in ("renew", "pipeline", "catalog"):
        shutil.copytree(root / name, other / name, ignore=shutil.ignore_patterns("__pycache__"))
    with (other / "pipeline" / "stages" / "plan.py").open("a") as module:
        module.write("# another version\n")
    command = (sys.executable, "-P", "-m", "pipeline.cli.main", "nightly", "run", "--config")
    file = plane_night(tmp_path)
    done = ended(
        *command,
        str(file),
        "--output",
        str(tmp_path / "out"),
        "--scheduler",
        cluster,
        cwd=other,
        env=os.environ | {"PYTHONPATH": str(other)},
    )
    assert done.returncode == 1
    assert "runs another version of RENEW" in done.stderr
    assert not (tmp_path / "out" / "latest").exists()


@pytest.mark.slow
@pytest.mark.parametrize("date", ["2028-02-29 23:59:58", "2001-01-01 00:00:00"])
def test_a_clock_that_is_elsewhere_changes_no_result(
    tmp_path: Path, cluster: str, date: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = load_config(plane_night(tmp_path, pairs=2), tmp_path / "now")
    cycle = run_night(config, scheduler=cluster).cycle

    set_clock(monkeypatch, datetime.fromisoformat(date).replace(tzinfo=UTC))
    other = load_config(tmp_path / "night.toml", tmp_path / "then")
    assert run_night(other, scheduler=cluster).cycle == cycle
    assert contents(tmp_path / "now") == contents(tmp_path / "then")


@pytest.mark.slow
def test_a_night_killed_half_way_does_the_other_half_only(tmp_path: Path) -> None:
    file, output = plane_night(tmp_path, pairs=120, workers=1), tmp_path / "out"
    with started(*night(file, output)) as process:
        wait_until(lambda: cases_done(output) >= 60, 300)
        process.kill()
        process.wait()
    done = {path: path.stat().st_ino for path in output.glob("*.partial/parts/*.part")}
    count = cases_done(output)
    again = started(*night(file, output))
    with again as process:
        wait_until(lambda: cases_done(output) > count or process.poll() is not None, 300)
        kept = {path: path.stat().st_ino for path in done if path.exists()}
        assert kept in (done, {})  # none once they are merged
        process.communicate(timeout=300)
    assert process.returncode == 0
    assert len(rows(output)) == 120


@pytest.mark.slow
def test_a_rerun_with_fifty_files_touches_none(tmp_path: Path) -> None:
    for member in range(50):
        write_forecast(tmp_path / "currents" / f"m{member:02}.nc", seed=member)
    file, output = region_night(tmp_path, departures=1, workers=1), tmp_path / "out"
    run_to_the_end(file, output)
    assert len(rows(output)) == 50
    held = [*output.rglob("*"), *(tmp_path / "currents").iterdir()]
    before = {path: path.stat().st_mtime_ns for path in held}
    assert "nothing to do" in run_to_the_end(file, output)
    assert {path: path.stat().st_mtime_ns for path in output.rglob("*")}.items() <= before.items()
    assert {path: path.stat().st_mtime_ns for path in held} == before


def test_currents_whose_workers_die_are_no_lack_of_currents(
    tmp_path: Path, cluster: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where each needs more memory than a worker has: code 1, which is told."""
    write_forecast(tmp_path / "currents" / "a.nc")
    config = load_config(region_night(tmp_path, departures=1), tmp_path / "out")
    run = Fleet.run

    def deadly_for_currents(self: Fleet, work: Any, check: Any) -> None:  # noqa: ANN401 - as they are
        if isinstance(work, Preparation) and isinstance(next(iter(work.tasks)), CurrentTask):
            for task in [*work.tasks, *work.tasks]:
                work.died(task, "killed")
        else:
            run(self, work, check)

    monkeypatch.setattr(Fleet, "run", deadly_for_currents)
    with pytest.raises(StageError, match=r"no current could be.*out of memory") as caught:
        run_night(config, scheduler=cluster)
    assert caught.value.exit_code == 1
