"""What catalog/operation/ holds for whoever runs a night, each file by its own checker."""

import importlib.metadata
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.commands import ended, ran
from tests.conftest import ROOT

OPERATION = ROOT / "catalog" / "operation"
CONTAINERFILE = (OPERATION / "Containerfile").read_text("utf-8")
SCRIPTS = Path(sys.executable).parent
EXPOSED = 2.0
"""Largest exposure that `systemd-analyze security` may find; 10 is a service with all rights."""


def checked(*command: str | Path) -> str:
    """Run a checker that must find nothing; return what it printed."""
    done = ended(*list(map(str, command)))
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.fixture
def analyze() -> str:
    """Give systemd's checker."""
    program = shutil.which("systemd-analyze")
    if program is None:
        pytest.skip("needs systemd-analyze, of Debian's package systemd")
    return program


@pytest.fixture
def units(tmp_path: Path) -> tuple[Path, Path]:
    """Give the service and the timer, with a program that is there."""
    text = (OPERATION / "renew-nightly.service").read_text("utf-8")
    service = tmp_path / "renew-nightly.service"
    service.write_text(text.replace("/opt/renew/bin/renew", str(shutil.which("env"))))
    timer = tmp_path / "renew-nightly.timer"
    shutil.copy(OPERATION / timer.name, timer)
    return service, timer


def test_systemd_accepts_service_and_timer(analyze: str, units: tuple[Path, Path]) -> None:
    assert checked(analyze, "verify", *units) == ""


def test_systemd_finds_the_service_hardened(analyze: str, units: tuple[Path, Path]) -> None:
    command = (analyze, "security", "--offline=true", f"--threshold={EXPOSED * 10:g}", units[0])
    assert "Overall exposure level" in checked(*command)


def test_a_night_is_begun_once_in_24_hours(analyze: str, units: tuple[Path, Path]) -> None:
    timer = units[1].read_text("utf-8")
    (when,) = re.findall(r"^OnCalendar=(.+)$", timer, re.MULTILINE)
    elapses = re.findall(
        r"(?:Next elapse|Iter\. #2): (.+)", checked(analyze, "calendar", "--iterations=2", when)
    )
    assert [" 02:00:00 UTC" in one for one in elapses] == [True, True]
    assert {"Persistent=true", "RandomizedDelaySec=10min"} <= set(timer.splitlines())


def test_the_cluster_accepts_every_object() -> None:
    objects = list(yaml.safe_load_all((OPERATION / "kubernetes.yaml").read_text("utf-8")))
    for one in objects:
        kubernetes_validate.validate(one, kubernetes_validate.latest_version(), strict=True)
    (job,) = (one["spec"] for one in objects if one["kind"] == "CronJob")
    assert job["concurrencyPolicy"] == "Forbid"
    assert job["startingDeadlineSeconds"] > 0
    assert job["jobTemplate"]["spec"]["activeDeadlineSeconds"] > 0
    workers = {one["metadata"]["name"] for one in objects if one["kind"] == "Deployment"}
    assert workers == {"renew-scheduler", "renew-worker"}


def test_a_misspelt_key_would_be_found() -> None:
    """The schemas are strict: what the cluster would drop in silence is a fault."""
    objects = yaml.safe_load_all((OPERATION / "kubernetes.yaml").read_text("utf-8"))
    (job,) = (one for one in objects if one["kind"] == "CronJob")
    job["spec"]["concurencyPolicy"] = job["spec"].pop("concurrencyPolicy")
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(job, kubernetes_validate.latest_version(), strict=True)


def test_job_and_workers_see_the_same_folder_at_the_same_path() -> None:
    objects = yaml.safe_load_all((OPERATION / "kubernetes.yaml").read_text("utf-8"))
    pods = [
        pod for one in objects for pod in _pods(one) if "scheduler" not in one["metadata"]["name"]
    ]
    data = [
        (mount["mountPath"], volume["persistentVolumeClaim"]["claimName"])
        for pod in pods
        for mount in pod["containers"][0]["volumeMounts"]
        for volume in pod["volumes"]
        if mount["name"] == volume["name"] == "data"
    ]
    assert data == [("/data", "renew-data")] * 2


def _pods(found: Any) -> list[dict[str, Any]]:  # noqa: ANN401 - YAML
    """Specifications of the pods that an object makes."""
    if not isinstance(found, dict):
        return []
    own = [found] if "containers" in found else []
    return own + [pod for one in found.values() for pod in _pods(one)]


def test_the_containers_recipe_has_no_fault() -> None:
    assert checked(SCRIPTS / "hadolint", OPERATION / "Containerfile") == ""


def test_the_containers_recipe_names_no_registry() -> None:
    images = re.findall(r"^FROM (\S+)", CONTAINERFILE, re.MULTILINE)
    assert images
    assert [name for name in images if not re.fullmatch(r"[a-z]+:[\w.-]+", name)] == []
    assert "://" not in CONTAINERFILE


def test_what_the_container_copies_is_all_that_its_wheel_and_its_pins_need(tmp_path: Path) -> None:
    """Tried in a folder with nothing else; downloads from a registry are not tried."""
    for line in re.findall(r"^COPY (?!--from)(.+) \S+$", CONTAINERFILE, re.MULTILINE):
        for name in line.split():
            if (ROOT / name).is_dir():
                left_out = shutil.ignore_patterns("__pycache__")
                shutil.copytree(ROOT / name, tmp_path / name, ignore=left_out)
            else:
                shutil.copy(ROOT / name, tmp_path)
    (pins,) = re.findall(r"^RUN (sed .+?)\s*\\\n", CONTAINERFILE, re.MULTILINE)
    subprocess.run(["/bin/sh", "-e", "-c", pins], cwd=tmp_path, check=True)
    lines = (tmp_path / "constraints.txt").read_text("utf-8").splitlines()
    pinned = [Requirement(line) for line in lines if line.strip() and line.lstrip()[0] != "#"]
    assert all(str(one.specifier).startswith("==") for one in pinned)

    build = [sys.executable, "-P", "-m", "hatchling", "build", "-t", "wheel"]
    ran(*build, cwd=tmp_path)
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    (made,) = importlib.metadata.Distribution.discover(path=[str(wheel)])
    assert {script.name for script in made.entry_points} == {"renew"}
    wanted = {
        canonicalize_name(Requirement(one).name)
        for one in made.requires or ()
        if "extra ==" not in one
    }
    assert wanted <= {canonicalize_name(one.name) for one in pinned}


@pytest.mark.parametrize("script", ["nightly.slurm"])
def test_shell_scripts_have_no_fault(script: str) -> None:
    assert checked(SCRIPTS / "shellcheck", OPERATION / script) == ""


def test_the_crontabs_line_has_no_fault(tmp_path: Path) -> None:
    lines = (OPERATION / "crontab").read_text("utf-8").splitlines()
    (line,) = (line for line in lines if not re.match(r"#|\w+=", line))
    found = re.fullmatch(r"(\d+) (\d+) \* \* \* (\w+) (.+)", line)
    assert found is not None
    minute, hour, user, command = found.groups()
    assert (int(minute) < 60, int(hour) < 24, user) == (True, True, "renew")
    # cron ends the command at a percent sign, and takes a line of 998 characters.
    assert "%" not in command
    assert len(line) < 998
    script = tmp_path / "night.sh"
    script.write_text(f"#!/bin/sh\n# shellcheck source=/dev/null\n{command}\n")
    checked(SCRIPTS / "shellcheck", "--exclude=SC1091", script)


@pytest.fixture
def programs(tmp_path: Path) -> dict[str, str]:
    """Give an environment in which `renew` prints its arguments and ends with the code of a file.

    `dask` says its address as a scheduler, and `srun` does nothing: Slurm itself can't be had here.
    """
    folder = tmp_path / "programs"
    folder.mkdir()
    for name, body in (
        ("renew", f'echo "$@"; exit "$(cat {tmp_path}/code)"'),
        ("srun", "exec sleep 60"),
        ("dask", 'echo \'{"address": "tcp://10.0.0.1:8786"}\' > "$6"; exec sleep 60'),
    ):
        (folder / name).write_text(f"#!/bin/sh\n{body}\n")
        (folder / name).chmod(0o755)
    return {"PATH": f"{folder}:/usr/bin:/bin"}


CODES = [(0, 0), (10, 0), (1, 1), (2, 2), (5, 5)]


@pytest.mark.parametrize(("code", "ends_with"), CODES)
def test_the_job_hands_a_night_to_its_scheduler_and_exit_code_10_is_no_failure(
    tmp_path: Path, programs: dict[str, str], code: int, ends_with: int
) -> None:
    (tmp_path / "code").write_text(str(code))
    output = tmp_path / "out"
    done = ended(
        "/bin/bash",
        OPERATION / "nightly.slurm",
        "my night.toml",
        output,
        "--only",
        "a",
        env=programs | {"SLURM_JOB_ID": "7"},
    )
    assert (done.returncode, done.stderr) == (ends_with, "")
    assert done.stdout == (
        f"nightly run --config my night.toml --output {output} "
        "--scheduler tcp://10.0.0.1:8786 --only a\n"
    )
    assert list(output.iterdir()) == []


@pytest.mark.parametrize(("code", "ends_with"), CODES)
def test_the_job_of_the_cluster_ends_well_with_exit_code_10(
    tmp_path: Path, programs: dict[str, str], code: int, ends_with: int
) -> None:
    objects = yaml.safe_load_all((OPERATION / "kubernetes.yaml").read_text("utf-8"))
    (job,) = (one for one in objects if one["kind"] == "CronJob")
    (container,) = _pods(job)[0]["containers"]
    (tmp_path / "code").write_text(str(code))
    done = ended(*(container["command"] + container["args"]), env=programs)
    assert (done.returncode, done.stderr) == (ends_with, "")
    assert done.stdout.startswith("nightly run --config /etc/renew/nightly.toml --output /data/")


@pytest.mark.parametrize(
    "name", ["renew-nightly.service", "crontab", "Containerfile", "nightly.slurm"]
)
def test_nothing_that_is_started_looks_into_the_working_directory(name: str) -> None:
    """Kubernetes starts the image, which sets the option for all programs."""
    assert "PYTHONSAFEPATH=1" in (OPERATION / name).read_text("utf-8")
