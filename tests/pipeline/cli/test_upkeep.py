"""`renew doctor`: what is broken is named with its remedy, and nothing secret is shown."""

import dataclasses
import json
import os
import shutil
import subprocess
import time
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline.cli import upkeep as doctor
from pipeline.cli.main import app
from pipeline.cli.upkeep import Finding
from pipeline.sources.copernicus.client import login_fault
from renew._compiled import cache_folder
from tests.commands import ended
from tests.loopback_store import world
from tests.loopback_store.server import PASSWORD, USERNAME, Fault
from tests.pipeline.processes import renew

DATASET = "copernicus-glorys-monthly"
# The path at which the loopback store takes user name and password.
TOKEN = "*/token"  # noqa: S105 - an address
CHECKED = ["libraries", "compiler's cache", "output folder", "login"]


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
    assert found["login"]["state"] == "warning"
    assert "COPERNICUSMARINE_SERVICE_USERNAME" in found["login"]["remedy"]
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


def test_a_negative_age_is_refused_as_it_was_typed() -> None:
    asked = CliRunner().invoke(app, ["clean", "--older", "-1d"])
    assert asked.exit_code == 2
    assert asked.stderr.startswith("error: --older = '-1d' is not an age")


# --- the machine ------------------------------------------------------------------------------


def test_an_output_folder_must_be_a_folder_with_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "file"
    file.touch()
    assert doctor.check_output(tmp_path / "to" / "be" / "made").state == "ok"
    for wrong in (file, file / "below", Path("~no-user-of-this-name/outputs"), Path("x" * 300)):
        found = doctor.guarded("output folder", partial(doctor.check_output, wrong))
        assert found.state == "fault", found
        assert "install" not in str(found)
    for free, state in ((2e9, "ok"), (5e8, "warning"), (1e6, "fault")):
        usage = dataclasses.make_dataclass("Usage", ["free"])(free)
        monkeypatch.setattr("shutil.disk_usage", lambda _, usage=usage: usage)
        assert doctor.check_output(tmp_path).state == state


def test_a_folder_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(**_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", refused)
    assert doctor.check_output(tmp_path).state == "fault"


def test_a_temporary_cache_of_the_compiler_is_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("renew._compiled.cache_is_temporary", lambda: False)
    assert doctor.check_compiler_cache().state == "ok"
    monkeypatch.setattr("renew._compiled.cache_is_temporary", lambda: True)
    found = doctor.check_compiler_cache()
    assert found.state == "warning"
    assert "NUMBA_CACHE_DIR" in found.remedy


def test_missing_and_old_libraries_are_faults(monkeypatch: pytest.MonkeyPatch) -> None:
    assert doctor.check_libraries().state == "ok"

    def changed(name: str) -> str:
        if name == "numba":
            raise PackageNotFoundError(name)
        return "1.9.3" if name == "numpy" else version(name)

    monkeypatch.setattr("pipeline.cli.upkeep.version", changed)
    found = doctor.check_libraries()
    assert found.state == "fault"
    assert "numba is missing" in found.detail
    assert "numpy 1.9.3 is not >=2.1" in found.detail
    assert found.detail.count(";") == 1


# --- the network ------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_login_that_the_service_accepts(tmp_path: Path) -> None:
    with world.connected(world.store(DATASET), tmp_path):
        assert login_fault(60) == ("", "")
        found = doctor.check_login(offline=False)
    assert found.state in {"ok", "warning"}  # in its 8 s, which a busy machine may exceed


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_login_that_hangs_ends_at_its_deadline(tmp_path: Path) -> None:
    store = world.store(DATASET)
    store.faults.append(Fault(TOKEN, "stall"))
    begun = time.monotonic()
    with world.connected(store, tmp_path):
        why, _ = login_fault(2)
    assert "no answer within 2 s" in why
    assert time.monotonic() - begun < 8


def test_an_account_is_found_and_never_shown(tmp_path: Path) -> None:
    with world.connected(world.store(DATASET), tmp_path):
        asked = CliRunner().invoke(app, ["doctor", "--offline", "--output", str(tmp_path)])
    assert "ok       login: an account is set up, and not tried (--offline)" in asked.stdout
    assert USERNAME not in asked.output
    assert PASSWORD not in asked.output


def test_the_program_runs_as_a_command(tmp_path: Path) -> None:
    """Without a home, as a service has it; in a process of its own."""
    environment = {name: value for name, value in os.environ.items() if name != "HOME"}
    command = renew("doctor", "--offline", "--output", "outputs")
    done = ended(*command, cwd=tmp_path, env={**environment, "HOME": "/nonexistent"}, timeout=60)
    assert done.returncode == 0, done.stdout
    assert "ok       libraries" in done.stdout
    assert "Traceback" not in done.stderr


# --- `renew warm`: what it says, where the machine code goes, and what it refuses ---


def warm(root: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own."""
    return ended(*renew("warm"), cwd=root, env=os.environ | variables)


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="the compiler is off")
@pytest.mark.usefixtures("rehearsed")
def test_it_says_where_all_is(root: Path) -> None:
    done = warm(root)
    assert done.returncode == 0, done.stderr
    folder = cache_folder()
    size = sum(file.stat().st_size for file in folder.iterdir()) / 1e6
    assert size > 1
    assert done.stdout.startswith("Nothing had to be compiled (")
    assert f" in {folder} ({size:.1f} MB)" in done.stdout


@pytest.mark.slow
@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="the compiler is off")
@pytest.mark.usefixtures("rehearsed")
def test_where_a_part_is_missing_that_alone_is_compiled(root: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(cache_folder(), tmp_path / cache_folder().name)
    (missing,) = folder.glob("viterbi.arrivals*.nbc")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    missing.unlink()
    done = warm(root, NUMBA_CACHE_DIR=str(tmp_path))
    assert done.stdout.startswith("Compiled "), done.stderr
    assert missing.is_file()
    after = {path.name: path.read_bytes() for path in folder.iterdir()}
    changed = {name for name in before | after if before.get(name) != after.get(name)}
    assert {name.split(".")[0] for name in changed - {missing.name}} <= {
        "complete-" + name[9:] for name in changed if name.startswith("complete-")
    }
    assert warm(root, NUMBA_CACHE_DIR=str(tmp_path)).stdout.startswith("Nothing")


def test_a_folder_that_cannot_be_written_is_refused(root: Path) -> None:
    done = warm(root, NUMBA_CACHE_DIR=f"{os.devnull}/kernels")
    assert done.returncode == 1
    assert done.stderr == (
        f"error: NUMBA_CACHE_DIR = '{os.devnull}/kernels' can't be written; choose another "
        "folder, or unset it\n"
    )


def test_without_the_compiler_it_is_refused(root: Path) -> None:
    done = warm(root, NUMBA_DISABLE_JIT="1")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: NUMBA_DISABLE_JIT is set")
