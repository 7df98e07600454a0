"""Where machine code is cached, and when it is compiled again; each run in its own process."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
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
print(_compiled.processor(), len(_compiled.save_failures()), len(_compiled.load_failures()))
"""

# Imports take longer than all else that the script does. So one process imports all that Numba
# needs to compile, reads requests, and forks for each: a process with these variables and no
# others, in which no code of RENEW has run and Numba has compiled nothing.
FORKS = """
import contextlib, importlib, json, os, platform, resource, subprocess, sys, tempfile, traceback
import numba
compiled = "import numba, sys; numba.njit(lambda x: x)(1.0); print(*sys.modules)"
for name in subprocess.check_output([sys.executable, "-c", compiled], text=True).split():
    with contextlib.suppress(ImportError):
        importlib.import_module(name)
for line in sys.stdin:
    folder, variables, script = json.loads(line)
    reader, writer = os.pipe()
    if child := os.fork():
        os.close(writer)
        with open(reader) as said:
            text = said.read()
        print(json.dumps([os.waitpid(child, 0)[1], text]), flush=True)
        continue
    os.dup2(writer, 1)
    os.dup2(writer, 2)
    code = 1
    try:
        os.chdir(folder)
        os.environ.clear()
        os.environ.update(variables)
        sys.dont_write_bytecode = "PYTHONDONTWRITEBYTECODE" in variables
        numba.config.reload_config()
        exec(script, {"os": os, "resource": resource})
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        os._exit(code)
"""


def install(folder: Path) -> Path:
    """Install a package with two kernels; one inlines the other."""
    package = folder / "installed" / "renew"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    for name in ("_compiled.py", "_compiler.py"):
        shutil.copy(PACKAGE / name, package)
    (package / "inner.py").write_text(
        "from renew._compiled import reading_kernel\n"
        "@reading_kernel\ndef factor():\n    return 2.0\n"
    )
    (package / "outer.py").write_text(
        "from renew._compiled import kernel\nfrom renew.inner import factor\n"
        "@kernel\ndef doubled(x):\n    return factor() * x\n"
    )
    return package


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Install the package, with nothing compiled."""
    return install(tmp_path)


@pytest.fixture(scope="session")
def _made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Machine code of the two kernels, and Python's."""
    package = install(tmp_path_factory.mktemp("made"))
    fresh = [sys.executable, "-c", SCRIPT]
    done = subprocess.run(fresh, cwd=package.parent, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("6.0 1 False")
    return package / "__pycache__"


@pytest.fixture
def compiled(package: Path, _made: Path) -> Path:
    """Install the package with its machine code, as after its first run."""
    shutil.copytree(_made, package / "__pycache__")
    return package


def code_folder(package: Path) -> Path:
    """Folder of a package's machine code."""
    (folder,) = (package / "__pycache__").glob("kernels-*")
    return folder


class Ran(NamedTuple):
    """What the script printed."""

    result: float
    compiled: int
    temporary: bool
    folder: Path
    processor: str
    unsaved: int
    unread: int


def run(package: Path, before: str = "", **variables: str) -> Ran:
    """Run the script in a new process, after a statement that changes the process itself."""
    figures, folder, more = printed(package, f"{before}\n{SCRIPT}", **variables).splitlines()
    result, compiled, temporary = figures.split()
    processor, *failures = more.split()
    return Ran(
        float(result),
        int(compiled),
        temporary == "True",
        Path(folder),
        processor,
        *map(int, failures),
    )


def printed(package: Path, script: str, **variables: str) -> str:
    """What a script prints in a new process in the package's folder."""
    server = forks()
    assert server.stdin is not None
    assert server.stdout is not None
    passed_on = {"PATH", "LD_LIBRARY_PATH"}
    kept = {key: value for key, value in os.environ.items() if key in passed_on}
    server.stdin.write(json.dumps([str(package.parent), kept | variables, script]) + "\n")
    server.stdin.flush()
    code, text = json.loads(server.stdout.readline())
    assert code == 0, text
    return str(text)


@pytest.fixture(scope="module", autouse=True)
def _forks_end() -> Iterator[None]:
    """End the process that forks."""
    yield
    if forks.cache_info().currsize:
        with forks():
            forks.cache_clear()


@cache
def forks() -> subprocess.Popen[str]:
    """Start a process that has imported Numba, and forks for each request."""
    return subprocess.Popen(
        [sys.executable, "-c", FORKS],
        cwd="/",
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def test_a_second_process_compiles_nothing(package: Path) -> None:
    assert run(package)[:3] == (6.0, 1, False)
    second = run(package)
    assert second[:3] == (6.0, 0, False)
    assert second.folder.is_relative_to(package)


def test_only_kernels_that_python_calls_have_machine_code(compiled: Path) -> None:
    folder = code_folder(compiled)
    assert {path.name.split(".")[0] for path in folder.iterdir()} == {"outer"}
    call_both = "from renew import inner, outer; print(outer.doubled(1.0), inner.factor())"
    assert printed(compiled, call_both) == "2.0 2.0\n"
    assert {path.name.split(".")[0] for path in folder.iterdir()} == {"inner", "outer"}


def test_an_edit_of_an_inlined_kernel_compiles_again(compiled: Path) -> None:
    inner = compiled / "inner.py"
    # Of another size: within a second Python tells an edit by that alone.
    inner.write_text(inner.read_text().replace("2.0", "5.00"))
    assert run(compiled)[:2] == (15.0, 1)


def test_machine_code_of_earlier_sources_is_removed(compiled: Path) -> None:
    inner = compiled / "inner.py"
    for factor in range(4):
        inner.write_text(inner.read_text().replace("return ", f"return {factor}.0 + 0.0 * "))
        run(compiled)
    assert len(list((compiled / "__pycache__").glob("kernels-*"))) == 4


def test_the_folder_of_numba_cache_dir_comes_first(package: Path, tmp_path: Path) -> None:
    folder = run(package, NUMBA_CACHE_DIR=str(tmp_path / "asked")).folder
    assert folder.is_relative_to(tmp_path / "asked")
    assert not list((package / "__pycache__").glob("kernels-*"))


def test_the_folder_of_numba_cache_dir_gets_what_another_holds(
    compiled: Path, tmp_path: Path
) -> None:
    asked = str(tmp_path / "asked")
    assert run(compiled, NUMBA_CACHE_DIR=asked).compiled == 0
    shutil.rmtree(compiled / "__pycache__")
    assert run(compiled, NUMBA_CACHE_DIR=asked).compiled == 0


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


def limit_files(size_bytes: int) -> str:
    """Statement that lets a process write no longer files."""
    return f"resource.setrlimit(resource.RLIMIT_FSIZE, ({size_bytes}, {size_bytes}))"


def test_code_that_cannot_be_saved_is_counted(package: Path) -> None:
    full = run(package, limit_files(16), PYTHONDONTWRITEBYTECODE="1")
    assert (full.result, full.compiled, full.unsaved) == (6.0, 1, 1)
    again = run(package)
    assert (again.compiled, again.unsaved) == (1, 0)


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


NOBODY = "os.setgroups([]), os.setgid(65534), os.setuid(65534)"
needs_nobody = pytest.mark.skipif(os.geteuid() != 0, reason="only root can run as another user")


@pytest.fixture
def home(package: Path, tmp_path: Path) -> Path:
    """Give a home folder of another user, who can read the package."""
    for folder in (package, *package.parents):
        if folder != Path(tempfile.gettempdir()) and folder.is_relative_to(tempfile.gettempdir()):
            folder.chmod(0o755)
    home = tmp_path / "home"
    home.mkdir()
    home.chmod(0o777)
    return home


@needs_nobody
def test_another_user_loads_what_root_has_compiled(package: Path, home: Path) -> None:
    first = run(package, NOBODY, HOME=str(home))
    assert first[:3] == (6.0, 1, False)
    assert first.folder.is_relative_to(home / ".cache")
    assert run(package, NOBODY, HOME=str(home)).compiled == 0
    # What root has compiled is loaded, although this user can't write there.
    shutil.rmtree(home / ".cache")
    assert run(package).folder.is_relative_to(package)
    assert run(package, NOBODY, HOME=str(home)).compiled == 0
    # A home folder that can't be written, such as that of a service.
    assert run(package, NOBODY, HOME="/nonexistent", TMPDIR=str(home))[:3] == (6.0, 0, True)


@needs_nobody
def test_what_root_compiles_under_umask_077_can_be_read_as_the_package_can(
    package: Path, home: Path
) -> None:
    folder = run(package, "os.umask(0o077)").folder
    assert {oct(path.stat().st_mode & 0o777) for path in (folder, folder.parent)} == {"0o755"}
    assert {path.stat().st_mode & 0o777 for path in folder.iterdir()} == {0o644}
    assert run(package, NOBODY, HOME=str(home), PYTHONDONTWRITEBYTECODE="1").compiled == 0


OTHER_UNREADABLE = ("folder", "pycache", "asked", "home")


@needs_nobody
@pytest.mark.parametrize(
    "what", ["files", *(pytest.param(one, marks=pytest.mark.slow) for one in OTHER_UNREADABLE)]
)
def test_a_cache_that_cannot_be_read_is_no_cache(package: Path, home: Path, what: str) -> None:
    asked = {"NUMBA_CACHE_DIR": str(home / "asked")} if what == "asked" else {}
    folder = run(package, HOME=str(home), **asked).folder
    if what == "home":
        private = [home / ".cache" / "renew"]
        shutil.copytree(folder, private[0] / folder.name)
    else:
        private = {"files": list(folder.iterdir()), "pycache": [folder.parent]}.get(what, [folder])
    for path in private:
        path.chmod(0o000)
    again = run(package, NOBODY, HOME=str(home), TMPDIR=str(home), **asked)
    assert (again.result, again.compiled) == (6.0, 0 if what == "home" else 1)
    assert again.unread


def cut(path: Path) -> None:
    """Leave the first half of a file."""
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def empty(path: Path) -> None:
    """Leave a file with nothing in it."""
    path.write_bytes(b"")


def flip(path: Path) -> None:
    """Change a bit in the middle of a file."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 4
    path.write_bytes(content)


def overwrite(path: Path) -> None:
    """Put something else into a file."""
    path.write_bytes(b"cos\nsystem\n(S'exit 1'\ntR.")


def replace_by_folder(path: Path) -> None:
    """Put a folder where a file was."""
    path.unlink()
    path.mkdir()


DAMAGE = [(flip, ".nbc"), (cut, ".nbi")]
MORE_DAMAGE = [
    (damage, kind)
    for damage in (cut, empty, flip, overwrite, replace_by_folder)
    for kind in (".nbi", ".nbc")
    if (damage, kind) not in DAMAGE
]


@pytest.mark.parametrize(
    ("damage", "kind"),
    [*DAMAGE, *(pytest.param(*one, marks=pytest.mark.slow) for one in MORE_DAMAGE)],
)
def test_a_damaged_cache_counts_as_missing_and_is_made_again(
    compiled: Path, kind: str, damage: Callable[[Path], None]
) -> None:
    for path in code_folder(compiled).glob(f"*{kind}"):
        damage(path)
    again = run(compiled)
    assert again[:3] == (6.0, 1, False)
    lasts = damage is replace_by_folder
    assert (again.unsaved, again.unread) == ((1, 1) if lasts else (0, 0))
    assert run(compiled).compiled == int(lasts)


def test_without_any_folder_to_write_to_it_runs_all_the_same(package: Path) -> None:
    shutil.rmtree(package / "__pycache__", ignore_errors=True)
    (package / "__pycache__").touch()
    found = run(package, limit_files(0), HOME=os.devnull)
    assert (found.result, found.compiled, found.temporary) == (6.0, 1, True)
    assert found.unsaved
