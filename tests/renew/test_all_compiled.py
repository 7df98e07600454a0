"""The note that everything is compiled, and what makes it invalid."""

from __future__ import annotations

import importlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

from tests.conftest import ROOT
from tests.renew.test_compiled import install

# Prints whether the note holds: before it is made and after; while a file is damaged, missing, or
# as it was when less was compiled; once all files are back; and when a caller's source changes.
NOTED = """
import importlib
import json
from pathlib import Path
from typing import get_args, get_type_hints
from renew import _compiled, outer
from tests.renew.test_compiled import cut, flip

outer.doubled(3.0)
holds = {"before": _compiled.has_all()}
folder = _compiled.cache_folder()
(index,), earlier = folder.glob("outer*.nbi"), next(folder.glob("outer*.nbi")).read_bytes()
outer.doubled(3)
_compiled.list_all()
holds["after"] = _compiled.has_all()
for path in sorted(folder.iterdir()):
    content = path.read_bytes()
    for change in (flip, cut, Path.unlink):
        change(path)
        holds[f"{change.__name__} {path.name}"] = _compiled.has_all()
        path.write_bytes(content)
content = index.read_bytes()
index.write_bytes(earlier)
holds["earlier index"] = _compiled.has_all()
index.write_bytes(content)
holds["all back"] = _compiled.has_all()
outer.doubled(3j)
holds["more compiled"] = _compiled.has_all()
caller = Path(outer.__file__).with_name("caller.py")
caller.write_text("# calls kernels with other types")
holds["another caller"] = _compiled.has_all()
caller.unlink()
print(json.dumps(holds))
"""
# Prints whether it holds, and once more when a file is missing in the folder that is written to.
HOLDS = """
from renew import _compiled
print(_compiled.has_all())
for path in _compiled.cache_folder().glob("outer*.nbc"):
    path.unlink()
print(_compiled.has_all())
"""


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A package with two kernels, and nothing compiled."""
    return install(tmp_path_factory.mktemp("noted"))


def printed(package: Path, script: str, **variables: str) -> str:
    """What a script prints in a process of its own."""
    return subprocess.run(
        [sys.executable, "-c", script],
        cwd=package.parent,
        env=os.environ
        | {"PYTHONPATH": os.pathsep.join([str(package.parent), str(ROOT)])}
        | variables,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()


@pytest.fixture(scope="module")
def holds(package: Path) -> dict[str, bool]:
    """Return in which of the script's situations the note holds."""
    found: dict[str, bool] = json.loads(printed(package, NOTED))
    return found


def test_the_note_holds_while_everything_is_there(holds: dict[str, bool]) -> None:
    assert {when for when, is_so in holds.items() if is_so} == {
        "after",
        "all back",
        "more compiled",
    }
    assert len([when for when in holds if when.startswith(("flip", "cut", "unlink"))]) == 3 * 5


@pytest.mark.usefixtures("holds")
def test_a_folder_asked_for_gets_all_while_it_is_empty(package: Path, tmp_path: Path) -> None:
    # Though another folder still has the missing file, this folder may be shipped alone.
    found = printed(package, HOLDS, NUMBA_CACHE_DIR=str(tmp_path))
    assert found.split() == ["True", "False"]


@pytest.mark.usefixtures("holds")
def test_the_note_is_for_one_processor(package: Path) -> None:
    found = printed(package, HOLDS, NUMBA_CPU_NAME="x86-64-v3", NUMBA_CPU_FEATURES="")
    assert found.split() == ["False", "False"]


def returns_scalars(kind: object) -> bool:
    """Whether a kernel's return type, as annotated, holds no arrays."""
    if kind in {type(None), bool, int, float}:
        return True
    fields = getattr(kind, "__annotations__", None)
    parts = get_args(kind) if fields is None else get_type_hints(kind).values()
    return bool(parts) and all(returns_scalars(part) for part in parts)


def test_no_kernel_that_counts_no_references_returns_an_array() -> None:
    # Its caller would free the array, which crashes the process.
    found = 0
    for path in sorted((ROOT / "renew").rglob("*.py")):
        names = re.findall(r"^@(?:reading|small)_kernel\ndef (\w+)", path.read_text(), re.MULTILINE)
        module = path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".")
        for name in names:
            compiled = getattr(importlib.import_module(module), name)
            function = getattr(compiled, "py_func", compiled)
            assert returns_scalars(get_type_hints(function)["return"]), f"{module}.{name}"
            found += 1
    assert found > 40
