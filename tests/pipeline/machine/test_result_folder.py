"""A folder of results is replaced whole, whatever operation of the disk is the last one."""

import contextlib
import os
import threading
from pathlib import Path

import pytest

from pipeline.machine.files import remove_leftovers, replacing
from tests.commands import PYTHON, ended
from tests.conftest import ROOT

NAMES = ("manifest", "routes", "summer", "winter")
# Writes results of a number; is killed just before its n-th call of the operating system that
# changes the disk. Prints how many there were.
SCRIPT = """
import os, signal, sys
from pathlib import Path
from pipeline.machine.files import replacing
target, number, names, last = sys.argv[1:]
names, last = names.split(), int(last)
changes = {f"os.{name}" for name in ("mkdir", "rename", "link", "symlink", "remove", "rmdir")}
count = 0

def watch(event, arguments):
    global count
    if event in changes or (event == "open" and set(str(arguments[1])) & set("wax")):
        count += 1
        if count == last:
            os.kill(os.getpid(), signal.SIGKILL)

sys.addaudithook(watch)
with replacing(Path(target), lambda: ["manifest", "routes", "summer", "winter"]) as folder:
    for name in names:
        (folder / name).write_text(number)
print(count)
"""


def put(target: Path, number: int, names: tuple[str, ...] = NAMES) -> None:
    with replacing(target, lambda: NAMES) as folder:
        for name in names:
            (folder / name).write_text(str(number))


def put_and_kill(target: Path, number: int, names: tuple[str, ...], last: int) -> int:
    """Number of the disk's operations, or 0 where the process was killed before the last."""
    done = ended(*PYTHON, SCRIPT, str(target), str(number), " ".join(names), str(last), cwd=ROOT)
    assert done.returncode in {0, -9}, done.stderr
    return 0 if done.returncode else int(done.stdout)


def contents(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir() if path.is_file()}


def test_results_are_replaced_and_the_users_own_files_stay(tmp_path: Path) -> None:
    target = tmp_path / "run"
    put(target, 1)
    (target / "notes.txt").write_text("mine")
    (target / "figures").mkdir()
    (target / "figures" / "map.png").write_text("drawn")
    put(target, 2, NAMES[:3])
    assert contents(target) == dict.fromkeys(NAMES[:3], "2") | {"notes.txt": "mine"}
    assert (target / "figures" / "map.png").read_text() == "drawn"
    assert [path.name for path in (tmp_path / ".results" / "run").iterdir()] == [
        target.resolve().name
    ]


def test_an_error_leaves_the_earlier_results(tmp_path: Path) -> None:
    put(tmp_path / "run", 1)
    with contextlib.suppress(ZeroDivisionError), replacing(tmp_path / "run", set) as folder:
        (folder / "routes").write_text(str(1 / 0))
    assert contents(tmp_path / "run") == dict.fromkeys(NAMES, "1")
    assert len(list((tmp_path / ".results" / "run").iterdir())) == 1


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("begin", ["link", "folder", "nothing"])
def test_killed_at_any_operation_old_or_new_is_whole_and_the_next_run_clears_up(
    tmp_path: Path, begin: str
) -> None:
    """At each operation of the disk; `winter` was withdrawn."""
    total = put_and_kill(tmp_path / "count", 2, NAMES[:3], 10**6)
    assert total >= 6
    for last in range(1, total + 12):
        target = tmp_path / f"at-{last}" / "run"
        target.parent.mkdir()
        if begin == "link":
            put(target, 1)
        elif begin == "folder":
            target.mkdir()
            for name in NAMES:
                (target / name).write_text("1")
        earlier = contents(target) if target.exists() else {}
        finished = put_and_kill(target, 2, NAMES[:3], last)
        remove_leftovers(target)  # as the next start does
        now = contents(target) if target.exists() else {}
        assert now in (earlier, dict.fromkeys(NAMES[:3], "2")), f"killed at operation {last}"
        put(target, 3, NAMES[:3])
        assert contents(target) == dict.fromkeys(NAMES[:3], "3")
        hidden = target.parent / ".results"
        assert [path.name for path in target.parent.iterdir() if path != hidden] == ["run"]
        assert len(list((hidden / "run").iterdir())) == 1
        if finished and last > finished:
            break
    else:
        pytest.fail("no run was left to finish")


def test_a_reader_never_sees_old_and_new_mixed(tmp_path: Path) -> None:
    target, stop, mixed, seen = tmp_path / "run", threading.Event(), [], set()
    put(target, 0)

    def read() -> None:
        while not stop.is_set():
            folder = os.open(target, os.O_RDONLY | os.O_DIRECTORY)
            try:
                texts = []
                for name in NAMES:
                    try:
                        file = os.open(name, os.O_RDONLY, dir_fd=folder)
                    except FileNotFoundError:  # replaced and gone: read anew
                        break
                    texts.append(os.read(file, 100))
                    os.close(file)
                else:
                    seen.add(texts[0])
                    if len(set(texts)) > 1:
                        mixed.append(texts)
            finally:
                os.close(folder)

    reader = threading.Thread(target=read)
    reader.start()
    try:
        for number in range(1, 80):
            put(target, number)
    finally:
        stop.set()
        reader.join()
    assert not mixed
    assert len(seen) > 15
