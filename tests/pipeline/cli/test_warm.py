"""`renew warm`: what it says, where the machine code goes, and what it refuses."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from renew._compiled import cache_folder
from tests.pipeline.processes import renew


def warm(root: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own."""
    return subprocess.run(
        renew("warm"),
        cwd=root,
        env=os.environ | variables,
        capture_output=True,
        text=True,
        check=False,
    )


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
    assert '"step"' not in done.stderr  # all was noted to be there, and no plan was made


@pytest.mark.slow  # two minutes
@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="the compiler is off")
@pytest.mark.usefixtures("rehearsed")
def test_where_a_part_is_missing_that_alone_is_compiled(root: Path, tmp_path: Path) -> None:
    assert warm(root, NUMBA_CACHE_DIR=str(tmp_path)).returncode == 0
    (folder,) = tmp_path.iterdir()
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
    # On a busy machine a line between them says that it is still at work.
    lines = [json.loads(line) for line in done.stderr.splitlines() if line.startswith("{")]
    assert [line["step"] for line in lines] == list(range(lines[0]["steps"]))
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
