"""`renew doctor`: what is broken is named with its remedy, and nothing secret is shown."""

from __future__ import annotations

import dataclasses
import gc
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from pipeline.cli import check_machine, doctor
from pipeline.cli.check_machine import Finding
from pipeline.cli.main import app
from pipeline.sources.copernicus.client import login_fault
from pipeline.sources.land.osm import cache_file
from tests.loopback_store import world
from tests.loopback_store.server import PASSWORD, USERNAME, Fault

DATASET = "copernicus-glorys-monthly"
# The path at which the loopback store takes user name and password.
TOKEN = "*/token"  # noqa: S105 - an address
CHECKED = [
    "Python", "clock", "memory", "home", "output folder", "compiler's cache", "land's cache",
    "libraries", "projections", "triangulator", "tides", "account", "land data", "login",
    "scheduler",
]  # fmt: skip


@pytest.fixture
def no_account(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide this machine's own account and scheduler."""
    for name in list(os.environ):
        if name.startswith(("COPERNICUS", "DASK_")):
            monkeypatch.delenv(name)
    monkeypatch.setenv("COPERNICUSMARINE_CREDENTIALS_DIRECTORY", str(tmp_path))


@pytest.mark.usefixtures("no_account")
def test_a_machine_in_order_without_an_account_has_no_fault(tmp_path: Path) -> None:
    begun = time.monotonic()
    asked = CliRunner().invoke(app, ["doctor", "--json", "--output", str(tmp_path / "outputs")])
    assert time.monotonic() - begun < 20
    report = json.loads(asked.stdout)
    assert asked.exit_code == report["exit_code"] == 0, report
    found = {one["what"]: one for one in report["findings"]}
    assert list(found) == CHECKED
    assert found["account"]["state"] == found["login"]["state"] == "warning"
    assert "COPERNICUSMARINE_SERVICE_USERNAME" in found["account"]["remedy"]
    assert not (tmp_path / "outputs").exists()


def test_each_finding_is_a_line_with_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    findings = [Finding("ok", "one", "1.0"), Finding("fault", "two", "broken", "mend it")]
    monkeypatch.setattr(doctor, "examine", lambda *_, **__: iter(findings))
    asked = CliRunner().invoke(app, ["doctor"])
    assert asked.exit_code == 1
    assert asked.stdout == "ok       one: 1.0\nfault    two: broken; mend it\n"


def test_a_check_that_breaks_is_a_fault() -> None:
    def broken() -> Finding:
        raise ImportError("libproj.so.25: no such file")

    found = doctor.guarded("projections", broken)
    assert found.state == "fault"
    assert "libproj.so.25" in found.detail


def test_a_check_that_hangs_is_given_up() -> None:
    begun = time.monotonic()
    released = threading.Event()

    def hanging() -> Finding:
        released.wait(30)
        return Finding("ok", "login", "at last")

    waiting = doctor.Background("login", hanging, 0.2)
    assert waiting.finding().state == "fault"
    released.set()
    assert time.monotonic() - begun < 5


# --- the machine ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("moment", "words"),
    [(0.0, "before this program was installed"), (5e9, "which can't be right")],
)
def test_a_clock_that_cannot_be_right_is_a_fault(
    monkeypatch: pytest.MonkeyPatch, moment: float, words: str
) -> None:
    assert check_machine.clock().state == "ok"
    monkeypatch.setattr("time.time", lambda: moment)
    found = check_machine.clock()
    assert found.state == "fault"
    assert words in found.detail


def test_an_output_folder_must_be_a_folder_with_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "file"
    file.touch()
    assert check_machine.output(tmp_path / "to" / "be" / "made").state == "ok"
    for wrong in (file, file / "below", Path("~no-user-of-this-name/outputs"), Path("x" * 300)):
        found = doctor.guarded("output folder", partial(check_machine.output, wrong))
        assert found.state == "fault", found
        assert "install" not in str(found)
    for free, state in ((2e9, "ok"), (5e8, "warning"), (1e6, "fault")):
        usage = dataclasses.make_dataclass("Usage", ["free"])(free)
        monkeypatch.setattr("shutil.disk_usage", lambda _, usage=usage: usage)
        assert check_machine.output(tmp_path).state == state


def test_folders_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check_machine, "_can_write", lambda _: False)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert check_machine.output(tmp_path).state == "fault"
    assert check_machine.home().state == "warning"
    monkeypatch.setattr("pathlib.Path.home", _no_home)
    assert "none" in check_machine.home().detail


def test_the_land_s_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    found = check_machine.land_cache()
    assert (found.state, "made by the first run" in found.detail) == ("ok", True)
    path = cache_file("Osm")
    assert path is not None
    path.parent.mkdir(parents=True)
    path.write_bytes(bytes(3_000_000))
    assert "3 MB" in check_machine.land_cache().detail
    path.unlink()
    monkeypatch.setattr(check_machine, "_can_write", lambda _: False)
    found = check_machine.land_cache()
    assert found.state == "warning"
    assert "set XDG_CACHE_HOME" in found.remedy
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr("pathlib.Path.home", _no_home)
    assert "no home" in check_machine.land_cache().detail


def _no_home() -> Path:
    raise RuntimeError("Could not determine home directory.")


def test_a_temporary_cache_of_the_compiler_is_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("renew._compiled.cache_is_temporary", lambda: False)
    assert check_machine.compiler_cache().state == "ok"
    monkeypatch.setattr("renew._compiled.cache_is_temporary", lambda: True)
    found = check_machine.compiler_cache()
    assert found.state == "warning"
    assert "NUMBA_CACHE_DIR" in found.remedy


def test_little_memory_is_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check_machine, "_group_memory", lambda: 5e8)
    found = check_machine.memory()
    assert found.state == "warning"
    assert "0.5 GB (limit of the control group)" in found.detail


def test_missing_and_old_libraries_are_faults(monkeypatch: pytest.MonkeyPatch) -> None:
    assert check_machine.libraries().state == "ok"

    def changed(name: str) -> str:
        if name == "numba":
            raise PackageNotFoundError(name)
        return "1.9.3" if name == "numpy" else version(name)

    monkeypatch.setattr("pipeline.cli.check_machine.version", changed)
    found = check_machine.libraries()
    assert found.state == "fault"
    assert "numba is missing" in found.detail
    assert "numpy 1.9.3 is not >=2.1" in found.detail
    assert found.detail.count(";") == 1


def test_land_that_cannot_be_read_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    for script in ("raise SystemExit('no library')", "print(3, 'aabb')", "import os; os.abort()"):
        monkeypatch.setattr(check_machine, "_READ_LAND", script)
        assert check_machine.land().state == "fault", script


# --- the network ------------------------------------------------------------------------------


def test_a_login_that_the_service_accepts(tmp_path: Path) -> None:
    with world.connected(world.store(DATASET), tmp_path):
        assert login_fault(60) == ("", "")
        found = doctor.check_login(offline=False)
    assert found.state in {"ok", "warning"}  # in its 8 s, which a busy machine may exceed


def test_a_service_out_of_order_is_no_wrong_password(tmp_path: Path) -> None:
    store = world.store(DATASET)
    store.faults.append(Fault(TOKEN, 401))
    with world.connected(store, tmp_path):
        why, remedy = login_fault(60)
    assert "can't be reached" in why
    assert "auth.marine.copernicus.eu" in remedy


def test_a_wrong_password_is_named_and_not_shown(tmp_path: Path) -> None:
    wrong = {"COPERNICUSMARINE_SERVICE_PASSWORD": "not-the-pass-phrase"}
    with world.connected(world.store(DATASET), tmp_path, wrong):
        why, remedy = login_fault(60)
    assert "refuses" in why
    assert "COPERNICUSMARINE_SERVICE_PASSWORD" in remedy
    assert "not-the-pass-phrase" not in why + remedy


def test_a_login_that_hangs_ends_at_its_deadline(tmp_path: Path) -> None:
    store = world.store(DATASET)
    store.faults.append(Fault(TOKEN, "stall"))
    begun = time.monotonic()
    with world.connected(store, tmp_path):
        why, _ = login_fault(2)
    assert "no answer within 2 s" in why
    assert time.monotonic() - begun < 8


def test_an_account_is_found_and_never_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(check_machine, "_READ_LAND", "print(1, '0106000000')")
    with world.connected(world.store(DATASET), tmp_path):
        asked = CliRunner().invoke(app, ["doctor", "--offline", "--output", str(tmp_path)])
    assert "not checked (--offline)" in asked.stdout
    assert "ok       account" in asked.stdout
    assert USERNAME not in asked.output
    assert PASSWORD not in asked.output


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Run a scheduler with one worker in this process; give its address."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0", protocol="tcp"
    ) as cluster:
        yield str(cluster.scheduler_address)


def test_workers_of_this_version_are_in_order(scheduler: str, tmp_path: Path) -> None:
    found = doctor.check_scheduler(scheduler, tmp_path)
    assert found.state == "ok", found
    assert "1 worker of this version" in found.detail


def test_workers_of_another_version_are_a_fault(
    scheduler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = doctor.worker_state(str(tmp_path))
    other = {**here, "numba": "0.1"}
    answers: dict[str, Any] = {"tcp://a": here, "tcp://b": other, "tcp://c": ImportError("renew")}
    wrong = doctor.differences(here, answers)
    assert len(wrong) == 2
    assert "tcp://b has numba 0.1, here it is" in wrong[0]
    assert "tcp://c can't run this program (renew)" in wrong[1]
    monkeypatch.setattr(doctor, "differences", lambda *_: wrong)
    assert doctor.check_scheduler(scheduler, tmp_path).state == "fault"


def test_a_scheduler_that_does_not_answer_is_a_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "NETWORK_S", 2.5)
    odd = ("no address", "ftp://127.0.0.1:1", "tls://127.0.0.1:1", "tcp://:", "-1")
    for address in ("tcp://127.0.0.1:1", *odd):
        found = doctor.check_scheduler(address, tmp_path)
        assert found.state == "fault", address
        assert found.remedy
    gc.collect()  # an error in what is thrown away is a warning, and so fails this test


def test_the_program_runs_as_a_command(tmp_path: Path) -> None:
    """Without a home, as a service has it; in a process of its own."""
    environment = {name: value for name, value in os.environ.items() if name != "HOME"}
    ended = subprocess.run(
        [sys.executable, "-m", "pipeline.cli.main", "doctor", "--offline", "--output", "outputs"],
        cwd=tmp_path, env={**environment, "HOME": "/nonexistent"},
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stdout
    assert "warning  home" in ended.stdout
    assert "Traceback" not in ended.stderr
