"""Where machine code is cached, and when it is compiled again; each run in its own process."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import pytest

import renew

PACKAGE = Path(renew.__file__).parent
# It prints the result of a kernel that inlines another one, how many kernels were compiled and not
# loaded, whether the cache is temporary, and the folder to which machine code is written.
SCRIPT = """
import sys
from renew import outer, _compiled
result = outer.doubled(3.0)
stats = outer.doubled.stats
print(result, sum(stats.cache_misses.values()), _compiled.cache_is_temporary())
print(_compiled.cache_folder())
print(_compiled.processor(), len(_compiled.save_failures()))
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Install a package with two kernels; one inlines the other."""
    package = tmp_path / "installed" / "renew"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    shutil.copy(PACKAGE / "_compiled.py", package)
    begin = "from renew._compiled import kernel\n"
    (package / "inner.py").write_text(begin + "@kernel\ndef factor():\n    return 2.0\n")
    (package / "outer.py").write_text(
        begin
        + "from renew.inner import factor\n@kernel\ndef doubled(x):\n    return factor() * x\n"
    )
    return package


class Ran(NamedTuple):
    """What the script printed."""

    result: float
    compiled: int
    temporary: bool
    folder: Path
    processor: str
    unsaved: int


def run(package: Path, *prefix: str, **variables: str) -> Ran:
    """Run the script in a new process, behind a prefix such as `setpriv`."""
    passed_on = {"PATH", "LD_LIBRARY_PATH"}
    done = subprocess.run(
        [*prefix, sys.executable, "-c", SCRIPT],
        env={key: value for key, value in os.environ.items() if key in passed_on} | variables,
        cwd=package.parent,
        capture_output=True,
        text=True,
        check=True,
    )
    figures, folder, more = done.stdout.splitlines()
    result, compiled, temporary = figures.split()
    processor, unsaved = more.split()
    return Ran(
        float(result), int(compiled), temporary == "True", Path(folder), processor, int(unsaved)
    )


def test_a_second_process_compiles_nothing(package: Path) -> None:
    assert run(package)[:3] == (6.0, 1, False)
    second = run(package)
    assert second[:3] == (6.0, 0, False)
    assert second.folder.is_relative_to(package)


def test_an_edit_of_an_inlined_kernel_compiles_again(package: Path) -> None:
    assert run(package).result == 6.0
    inner = package / "inner.py"
    inner.write_text(inner.read_text().replace("2.0", "5.0"))
    assert run(package)[:2] == (15.0, 1)


def test_machine_code_of_earlier_sources_is_removed(package: Path) -> None:
    inner = package / "inner.py"
    for factor in range(8):
        inner.write_text(inner.read_text().replace("return ", f"return {factor}.0 + 0.0 * "))
        run(package)
    assert len(list((package / "__pycache__").glob("kernels-*"))) == 4


def test_the_folder_of_numba_cache_dir_comes_first(package: Path, tmp_path: Path) -> None:
    folder = run(package, NUMBA_CACHE_DIR=str(tmp_path / "asked")).folder
    assert folder.is_relative_to(tmp_path / "asked")
    assert not list((package / "__pycache__").glob("kernels-*"))


def test_the_folder_of_numba_cache_dir_gets_what_another_holds(
    package: Path, tmp_path: Path
) -> None:
    assert run(package).compiled == 1
    asked = str(tmp_path / "asked")
    assert run(package, NUMBA_CACHE_DIR=asked).compiled == 0
    shutil.rmtree(package / "__pycache__")
    assert run(package, NUMBA_CACHE_DIR=asked).compiled == 0


def test_code_for_a_processor_asked_for_is_read_where_it_is_asked_for_again(
    package: Path,
) -> None:
    generic = {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": ""}
    first = run(package, **generic)
    assert (first.compiled, first.processor) == (1, "x86-64-v3")
    assert run(package).compiled == 1  # this machine's own
    assert run(package, **generic).compiled == 0


def test_shipped_code_needs_neither_its_path_nor_its_times(package: Path, tmp_path: Path) -> None:
    assert run(package, NUMBA_CACHE_DIR=str(tmp_path / "made")).compiled == 1
    shutil.rmtree(package / "__pycache__", ignore_errors=True)
    elsewhere = shutil.copytree(package, tmp_path / "elsewhere" / "renew")
    shipped = shutil.copytree(tmp_path / "made", tmp_path / "shipped")
    for path in (*elsewhere.rglob("*"), *shipped.rglob("*")):
        os.utime(path, (0, 0))
    assert run(elsewhere, NUMBA_CACHE_DIR=str(shipped))[:2] == (6.0, 0)


@pytest.mark.skipif(shutil.which("prlimit") is None, reason="needs prlimit of util-linux")
def test_code_that_cannot_be_saved_is_counted(package: Path) -> None:
    assert run(package).unsaved == 0
    shutil.rmtree(package / "__pycache__")
    full = run(package, "prlimit", "--fsize=16", PYTHONDONTWRITEBYTECODE="1")
    assert (full.result, full.compiled, full.unsaved) == (6.0, 1, 2)  # and the one inlined
    assert run(package).compiled == 1


def test_without_a_lasting_folder_it_is_written_to_a_private_temporary_one(
    package: Path, tmp_path: Path
) -> None:
    shutil.rmtree(package / "__pycache__", ignore_errors=True)
    (package / "__pycache__").touch()  # a file, where a folder should be
    places = {"HOME": os.devnull, "TMPDIR": str(tmp_path)}
    first = run(package, **places)
    folder = first.folder
    assert (first.result, first.temporary) == (6.0, True)
    assert folder.is_relative_to(tmp_path / f"renew-{os.getuid()}")
    assert run(package, **places).compiled == 0
    # A folder that others can write to is not trusted.
    (tmp_path / f"renew-{os.getuid()}").chmod(0o777)
    assert run(package, **places).folder != folder


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can run as another user")
@pytest.mark.skipif(shutil.which("setpriv") is None, reason="needs setpriv of util-linux")
def test_another_user_loads_what_root_has_compiled(package: Path, tmp_path: Path) -> None:
    for folder in (package, *package.parents):
        if folder != Path(tempfile.gettempdir()) and folder.is_relative_to(tempfile.gettempdir()):
            folder.chmod(0o755)
    home = tmp_path / "home"
    home.mkdir()
    home.chmod(0o777)
    nobody = ("setpriv", "--reuid=65534", "--regid=65534", "--clear-groups", "--inh-caps=-all")
    first = run(package, *nobody, HOME=str(home))
    assert first[:3] == (6.0, 1, False)
    assert first.folder.is_relative_to(home / ".cache")
    assert run(package, *nobody, HOME=str(home)).compiled == 0
    # What root has compiled is loaded, although this user can't write there.
    shutil.rmtree(home / ".cache")
    assert run(package).folder.is_relative_to(package)
    assert run(package, *nobody, HOME=str(home)).compiled == 0
    # A home folder that can't be written, such as that of a service.
    assert run(package, *nobody, HOME="/nonexistent", TMPDIR=str(home))[:3] == (6.0, 0, True)
