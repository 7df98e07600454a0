"""The wheel in an environment of its own, as docs/how-to/install.md tells, and the container image.

The image is built and run where a builder of images is.
"""

import csv
import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from pathlib import Path

import pytest

from renew._compiled import cache_folder
from tests.bench.figure import recorded
from tests.commands import ended, ran
from tests.conftest import ROOT

FILES = "import pipeline, renew; print(renew.__file__, pipeline.__file__, sep='\\n')"
SITE = "import sysconfig; print(sysconfig.get_path('purelib'))"


def _ran(folder: Path, *command: str | Path) -> str:
    """Run a command in a folder, with nothing of this process' way to find modules."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    # Machine code is named by the sources: what this checkout has compiled is not compiled again.
    environment["NUMBA_CACHE_DIR"] = str(cache_folder().parent)
    return ran(*command, cwd=folder, env=environment)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    _ran(ROOT, sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder)
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory, wheel: Path) -> Path:
    """An environment that holds the wheel, and of this one the dependencies alone."""
    folder = tmp_path_factory.mktemp("installed")
    environment = folder / "environment"
    _ran(folder, sys.executable, "-m", "venv", environment)
    python = environment / "bin" / "python"
    offline = ("--quiet", "--no-deps", "--no-index", "--disable-pip-version-check")
    _ran(folder, python, "-m", "pip", "install", *offline, wheel)
    # A folder that a .pth file names is searched last, and its own .pth files are not read: the
    # editable install of this checkout is one of them.
    site = Path(_ran(folder, python, "-c", SITE).strip())
    (site / "dependencies.pth").write_text(f"{sysconfig.get_path('purelib')}\n", encoding="utf-8")
    return environment


@pytest.mark.slow
def test_a_wheel_plans_from_a_folder_outside_the_clone(installed: Path, tmp_path: Path) -> None:
    """Packages and catalogue are the wheel's, and the fuel is what this checkout gives."""
    programs = installed / "bin"
    files = _ran(tmp_path, programs / "python", "-c", FILES).splitlines()
    assert len(files) == 2
    assert all(Path(file).is_relative_to(installed) for file in files)
    _ran(tmp_path, programs / "renew", "run", "single-gyre", "--offline", "--output", "results")
    with (tmp_path / "results" / "single-gyre" / "metrics.csv").open(encoding="utf-8") as file:
        best = next(csv.DictReader(file))
    assert float(best["fuel"]) == pytest.approx(recorded("gyre")["fuel"], rel=1e-4)


@pytest.mark.slow
def test_uv_installs_the_wheel_as_a_tool_that_plans_in_an_empty_folder(
    wheel: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the dependencies that uv finds; an extra is named behind the wheel."""
    monkeypatch.setenv("UV_TOOL_DIR", str(tmp_path / "tools"))
    monkeypatch.setenv("UV_TOOL_BIN_DIR", str(tmp_path / "programs"))
    uv = Path(sys.executable).with_name("uv")
    asked = (f"{wheel}[grib]", "--python", sys.executable, "--quiet", "--no-config")
    done = ended(uv, "tool", "install", *asked)
    if "error sending request" in done.stderr:
        pytest.skip("the package index can't be reached")
    assert done.returncode == 0, done.stderr
    empty, renew = tmp_path / "empty", tmp_path / "programs" / "renew"
    empty.mkdir()
    assert _ran(empty, renew, "--version").startswith("renew 0.")
    voyage = ("119.90,10.00", "120.24,9.96", "--vessel", "usv-7m", "--month", "2024-01")
    water = ("--currents", "embedded-palawan", "--output", "results", "--name", "crossing")
    _ran(empty, renew, "go", *voyage, *water)
    assert [path.name for path in empty.iterdir()] == ["results"]
    results = empty / "results" / "crossing"
    with (results / "metrics.csv").open(encoding="utf-8") as file:
        best = next(csv.DictReader(file))
    assert 35_000 < float(best["length_m"]) < 45_000
    assert (results / "report.html").stat().st_size > 100_000


TAG = "localhost/renew-test"
CONTAINER = "renew-test"
# What builders say where the registry of the base image can't be reached.
UNREACHABLE = ("pinging container registry", "no such host", "failed to resolve source metadata")


def _done(*command: str) -> subprocess.CompletedProcess[str]:
    return ended(*command, cwd=ROOT)


def _built(*command: str) -> None:
    """Build the image, or skip the test where its base can't be fetched."""
    done = _done(*command, "--file", "catalog/operation/Containerfile", "--tag", TAG, ".")
    if done.returncode and any(words in done.stderr for words in UNREACHABLE):
        pytest.skip("the registry of the base image can't be reached")
    assert done.returncode == 0, done.stderr[-4000:]


@pytest.fixture(scope="module")
def inside() -> Iterator[tuple[str, ...]]:
    """Build the image; give the beginning of a command that runs `renew` in it."""
    if shutil.which("buildah"):
        # Without namespaces and control groups of its own, which a machine may not allow.
        alone = ("--isolation", "chroot", "--network", "host")
        _built("buildah", "build", *alone, "--layers", "--pull=false")
        assert _done("buildah", "from", "--name", CONTAINER, TAG).returncode == 0
        yield ("buildah", "run", *alone, CONTAINER, "--", "renew")
        _done("buildah", "rm", CONTAINER)
        return
    for program in ("docker", "podman"):
        if shutil.which(program) and _done(program, "info").returncode == 0:
            _built(program, "build")
            yield (program, "run", "--rm", "--read-only", "--tmpfs", "/tmp", TAG)  # noqa: S108 - inside
            return
    pytest.skip("needs buildah, docker or podman")


@pytest.mark.slow
def test_the_image_plans_with_its_own_machine_code(inside: tuple[str, ...]) -> None:
    """As the user of the image, who may write into /data alone."""
    assert _done(*inside, "--version").stdout.startswith("renew 0.")
    done = _done(*inside, "run", "single-gyre", "--offline", "--output", "/data/outputs")
    assert done.returncode == 0, done.stderr[-4000:]
    assert "Written to" in done.stdout
    assert "machine code is cached in a temporary folder" not in done.stderr
