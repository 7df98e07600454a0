"""Runs that share an output folder: nobody removes or replaces what is another's."""

import contextlib
import hashlib
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from pipeline.errors import RequestError, StageError
from pipeline.machine.store import Store
from pipeline.scenario.catalogue import ScenarioFile
from pipeline.session import clean, session
from tests.pipeline.processes import started

# Holds a session until its input ends, after its script.
HOLD = """
import sys
from pathlib import Path
from pipeline.session import session
with session(sys.argv[2], Path(sys.argv[1])) as held:
    held.store.save("plan", "key", [1])
    (held.store.root / "plan" / f".{sys.argv[2]}.0a.tmp").touch()
    print("in", flush=True)
    import time
    time.sleep(600)
"""


@contextlib.contextmanager
def holding(output: Path, name: str) -> Iterator[None]:
    """Run a scenario in a process of its own, which is killed at the end of the block."""
    with started(sys.executable, "-c", HOLD, str(output), name) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "in\n"
        yield


def refused(output: Path, name: str, during: Callable[[], object] = lambda: None) -> None:
    """Begin a session that ends in a RequestError."""
    with pytest.raises(RequestError), session(name, output):  # noqa: PT012
        during()
        raise RequestError(["wrong"])


def test_a_refused_run_leaves_no_new_folder(tmp_path: Path) -> None:
    refused(tmp_path / "outputs", "a")
    assert list(tmp_path.iterdir()) == []
    refused(tmp_path, "a")
    assert list(tmp_path.iterdir()) == []


def test_a_refused_run_leaves_the_store_and_the_locks_of_another(tmp_path: Path) -> None:
    """A begins in a new folder, B joins, A is refused; a second B still has to wait."""
    output = tmp_path / "outputs"
    with contextlib.ExitStack() as stack:
        refused(output, "a", lambda: stack.enter_context(holding(output, "b")))
        assert (output / ".artefacts" / "plan" / "key.artefact").exists()
        with pytest.raises(StageError, match=r"another run of 'b' is writing.*wait"):
            session("b", output).__enter__()
        with pytest.raises(StageError, match="a run is at work"):
            clean(output, max_bytes=0)
        # A killed run releases its locks.
    with session("b", output):
        pass


def test_leftovers_of_a_killed_run_go_at_its_next_start_and_those_of_a_running_one_stay(
    tmp_path: Path,
) -> None:
    left = tmp_path / ".artefacts" / "plan" / ".killed.0a.tmp"
    left.parent.mkdir(parents=True)
    left.touch()
    with holding(tmp_path, "running"), session("killed", tmp_path) as held:
        names = {path.name for path in (held.store.root / "plan").iterdir()}
        assert names == {"key.artefact", ".running.0a.tmp"}


def test_the_data_of_a_refused_run_stay_in_the_store(tmp_path: Path) -> None:
    def fetch() -> None:
        Store(tmp_path / "outputs" / ".artefacts").save("land", "key", [1])

    refused(tmp_path / "outputs", "a", fetch)
    assert (tmp_path / "outputs" / ".artefacts" / "land" / "key.artefact").exists()


def test_runs_that_are_refused_at_once_do_not_disturb_each_other(tmp_path: Path) -> None:
    """Each makes and removes the folder and its locks, one at a time."""
    program = (
        "import sys, time\n"
        "from pathlib import Path\n"
        "from pipeline.errors import RequestError, StageError\n"
        "from pipeline.session import session\n"
        "output, done = Path(sys.argv[1]) / 'outputs', 0\n"
        "while done < 6:\n"
        "    try:\n"
        "        with session('one', output) as held:\n"
        "            (held.store.root / 'mark').mkdir()\n"  # fails if another is in, too
        "            (held.store.root / 'mark').rmdir()\n"
        "            done += 1\n"
        "            raise RequestError(['wrong'])\n"
        "    except RequestError: pass\n"
        "    except StageError as error:\n"
        "        assert 'another run' in str(error), error\n"
        "        time.sleep(0.001)\n"
    )
    with contextlib.ExitStack() as stack:
        command = (sys.executable, "-c", program, str(tmp_path))
        processes = [stack.enter_context(started(*command)) for _ in range(2)]
        for process in processes:
            assert process.wait(120) == 0, process.stderr and process.stderr.read()
    # The one that made the folder need not be the last in it: it may be left, empty.
    assert {path.name for path in tmp_path.rglob("*")} <= {"outputs"}


def fill(output: Path, days: tuple[float, ...], size: int = 1000) -> list[Path]:
    """Store artefacts that were last used some days ago."""
    paths = []
    for i, ago in enumerate(days):
        path = output / ".artefacts" / "plan" / f"{i}.artefact"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"x" * size)
        os.utime(path, (time.time() - ago * 86_400,) * 2)
        paths.append(path)
    return paths


def test_cleaning_removes_what_is_old_then_what_is_too_much(tmp_path: Path) -> None:
    paths = fill(tmp_path, (40, 20, 3, 1, 0))
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "report.html").touch()
    freed = clean(tmp_path, max_bytes=1e9, used_before=time.time() - 30 * 86_400)
    assert (freed.files, freed.size, freed.remaining) == (1, 1000, 4000)
    assert [path.exists() for path in paths] == [False, True, True, True, True]
    freed = clean(tmp_path, max_bytes=2500)
    assert [path.exists() for path in paths] == [False, False, False, True, True]
    assert clean(tmp_path, max_bytes=0).remaining == 0
    assert (tmp_path / "run" / "report.html").exists()
    with pytest.raises(RequestError, match="holds no results"):
        clean(tmp_path / "elsewhere", max_bytes=0)


def test_a_run_prunes_a_large_store_but_never_what_it_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipeline.session.MAX_STORE_BYTES", 1500)
    paths = fill(tmp_path, (3, 2, 1))
    with holding(tmp_path, "other"), session("a", tmp_path):
        pass
    assert all(path.exists() for path in paths), "another run was at work"
    with session("a", tmp_path) as held:
        large = held.store.save("plan", "large", b"x" * 5000)
    assert [path.exists() for path in (*paths, large)] == [False, False, False, True]


def origin(path: Path, text: str) -> ScenarioFile:
    """Write a scenario's file, and describe it."""
    path.write_text(text)
    return ScenarioFile(path, hashlib.sha256(path.read_bytes()).hexdigest(), {})


def finish(output: Path, made_by: ScenarioFile) -> None:
    """Run a scenario called `one` to its end."""
    with session("one", output, made_by) as held:
        held.directory.mkdir(exist_ok=True)
        held.record_origin()


def test_a_file_of_the_same_name_does_not_replace_the_results_of_another(tmp_path: Path) -> None:
    a, b, output = tmp_path / "a.toml", tmp_path / "b.toml", tmp_path / "outputs"
    finish(output, origin(a, "first"))
    with pytest.raises(RequestError) as caught:
        finish(output, origin(b, "other"))
    assert all(str(path) in str(caught.value) for path in (a, b))
    # The same file edited, a copy of it, and the file that made the results all count as the same
    # scenario.
    finish(output, origin(a, "edited"))
    finish(output, origin(b, "edited"))
    finish(output, origin(a, "edited"))
    # The other scenario is gone, or the results are.
    a.unlink()
    finish(output, origin(b, "again"))
    (output / "one").rmdir()
    finish(output, origin(a, "new"))


def test_the_scenario_among_the_results_may_be_run_and_leaves_the_name_to_its_file(
    tmp_path: Path,
) -> None:
    output, mine = tmp_path / "outputs", tmp_path / "a.toml"
    finish(output, origin(mine, "first"))
    written = output / "one" / "scenario.toml"
    finish(output, origin(written, "as it was planned"))
    with pytest.raises(RequestError):
        finish(output, origin(tmp_path / "b.toml", "another"))
    finish(output, origin(mine, "edited"))
