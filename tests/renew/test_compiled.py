"""Where machine code is cached, when it is compiled again, and Ctrl-C within it."""

import ast
import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

import renew
from renew import _compiled
from tests.commands import PYTHON, ran

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
print(_compiled.processor())
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
    shutil.copy(PACKAGE / "_compiled.py", package)
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
    done = ran(*fresh, cwd=package.parent)
    assert done.startswith("6.0 1 False")
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


def run(package: Path, before: str = "", **variables: str) -> Ran:
    """Run the script in a new process, after a statement that changes the process itself."""
    figures, folder, processor = printed(package, f"{before}\n{SCRIPT}", **variables).splitlines()
    result, compiled, temporary = figures.split()
    return Ran(float(result), int(compiled), temporary == "True", Path(folder), processor)


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


# Two processes save code of one kernel for other types, each while the other is about to.
AT_ONCE = """
import os, time
from numba.core.caching import IndexDataCacheFile as Index
from renew import outer

def slowly(index, load=Index._load_index):
    found = load(index)
    time.sleep(0.3)
    return found

for number in (3.0, 3):
    if not os.fork():
        Index._load_index = slowly
        outer.doubled(number)
        os._exit(0)
os.wait(), os.wait()
entries = outer.doubled._cache._cache_file._load_index()
print(len(entries), len({*entries.values()}))
"""


def test_processes_that_compile_at_once_lose_no_entry(package: Path) -> None:
    assert printed(package, AT_ONCE) == "2 2\n"


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


def test_kernels_use_nothing_of_a_module_without_kernels() -> None:
    """An edit of such a module compiles nothing again, and values and types stay as they were."""
    trees = {
        ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts): ast.parse(text)
        for path in PACKAGE.rglob("*.py")
        if _compiled._HAS_KERNELS.search(text := path.read_bytes())
    }
    assert len(trees) > 20
    used = set[str]()
    for tree in trees.values():
        nodes = list(ast.walk(tree))
        imports = (node for node in nodes if isinstance(node, ast.ImportFrom))
        source = {
            one.asname or one.name: str(node.module) for node in imports for one in node.names
        }
        for function in (node for node in nodes if isinstance(node, ast.FunctionDef)):
            if any("kernel" in ast.unparse(one) for one in function.decorator_list):
                names = (one.id for one in ast.walk(function) if isinstance(one, ast.Name))
                used |= {source[name] for name in names if name in source}
    # Types of arrays are none of Numba's.
    assert {one for one in used if one.startswith("renew")} - {"renew._types"} <= trees.keys()


@pytest.mark.slow
def test_code_for_a_processor_asked_for_is_read_where_it_is_asked_for_again(package: Path) -> None:
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


def test_without_a_lasting_folder_it_is_written_to_one_that_goes_with_the_process(
    package: Path, tmp_path: Path
) -> None:
    shutil.rmtree(package / "__pycache__", ignore_errors=True)
    (package / "__pycache__").touch()  # a file, where a folder should be
    (tmp_path / "temporary").mkdir()
    done = ran(
        *PYTHON,
        SCRIPT,
        cwd=package.parent,
        env={"HOME": os.devnull, "TMPDIR": str(tmp_path / "temporary")},
    )
    assert done.startswith("6.0 1 True")
    assert list((tmp_path / "temporary").iterdir()) == []


NOTE = "from renew import _compiled, outer; outer.doubled(3.0); _compiled.note_all()"


def test_a_folder_that_holds_all_is_used_though_it_cannot_be_written(
    package: Path, tmp_path: Path
) -> None:
    """As in a container whose image was warmed up by root, or on a shared read-only disk."""
    asked = {"NUMBA_CACHE_DIR": str(tmp_path / "asked")}
    printed(package, NOTE, **asked)
    shutil.rmtree(package / "__pycache__", ignore_errors=True)
    for path in (tmp_path / "asked").rglob("*"):
        path.chmod(0o555 if path.is_dir() else 0o444)
    fail = "os.mkdir = tempfile = None"  # whoever runs this may be root, who may write everywhere
    found = run(package, fail, **asked)
    assert (found.compiled, found.temporary) == (0, False)
    assert found.folder.is_relative_to(tmp_path / "asked")


def test_the_note_that_all_is_there_holds_while_no_file_is_missing_or_cut(compiled: Path) -> None:
    has_all = "from renew import _compiled; print(_compiled.has_all())"
    assert printed(compiled, has_all) == "False\n"
    printed(compiled, NOTE)
    assert printed(compiled, has_all) == "True\n"
    assert (
        printed(compiled, has_all, NUMBA_CPU_NAME="x86-64-v3", NUMBA_CPU_FEATURES="") == "False\n"
    )
    for path in code_folder(compiled).glob("*.nbc"):
        content = path.read_bytes()
        path.write_bytes(content[: len(content) // 2])
        assert printed(compiled, has_all) == "False\n"
        path.write_bytes(content)
    (compiled / "caller.py").write_text("# calls kernels with other types")
    assert printed(compiled, has_all) == "False\n"


# A kernel with results of each kind, and one that it calls. It is at work when the signal comes,
# which is raised as soon as its results are made.
INTERRUPTED = """
import os, signal, sys, threading
import numpy as np
from typing import NamedTuple
from renew._compiled import kernel

signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it

class Results(NamedTuple):
    one: np.ndarray
    other: np.ndarray

@kernel
def root_of_sum(count):
    total = 0.0
    for k in range(count):
        total = np.sqrt(total + k)
    return total

@kernel
def results(count):
    total = root_of_sum(count)
    return Results(np.full(3, total), np.full(2, total)), np.full(3, total), [total]

results(1)
for _ in range(2):
    threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT)).start()
    try:
        results(60_000_000)
    except KeyboardInterrupt:
        print("interrupted")
"""


def test_ctrl_c_within_a_kernel_is_a_keyboard_interrupt(tmp_path: Path) -> None:
    package = install(tmp_path)
    (package / "interrupted.py").write_text(INTERRUPTED)
    assert printed(package, "import renew.interrupted") == "interrupted\n" * 2


# Plans that are interrupted at random moments, and prints how each of them ended.
INTERRUPTED_PLANS = """
import random, signal
import renew
from tests.strategies import single_gyre

def plan():
    scene.turns(scene.plan(classes=4).best)

scene, moments = single_gyre(), random.Random(1)
plan()
signal.signal(signal.SIGALRM, signal.default_int_handler)
for _ in range(500):
    try:
        signal.setitimer(signal.ITIMER_REAL, moments.uniform(0.001, 0.08))
        plan()
        signal.setitimer(signal.ITIMER_REAL, 0)
        print("ended")
    except BaseException as error:
        print(type(error).__name__)
"""


@pytest.mark.slow
def test_plans_that_are_interrupted_end_with_a_keyboard_interrupt(root: Path) -> None:
    done = ran(*PYTHON, INTERRUPTED_PLANS, cwd=root)
    ends = Counter(done.split())
    assert ends.total() == 500
    assert set(ends) <= {"KeyboardInterrupt", "ended"}
    assert ends["KeyboardInterrupt"] >= 300
