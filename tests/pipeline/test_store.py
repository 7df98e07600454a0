"""The store: whole or absent, named by content, one run at a time."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline import store as artefact
from pipeline.errors import StageError
from pipeline.model import Credit
from pipeline.store import Store

ROOT = Path(artefact.__file__).resolve().parent.parent
CREDIT = Credit("name", "land", "text", "licence")


def test_what_was_saved_is_loaded(tmp_path: Path) -> None:
    store = Store(tmp_path)
    path = store.save("plan", "key", CREDIT)
    assert store.load("plan", "key", Credit) == CREDIT
    assert [file.name for file in tmp_path.rglob("*") if file.is_file()] == [path.name]


def test_absent_and_of_another_kind_is_none(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert store.load("plan", "key", Credit) is None
    store.save("plan", "key", [1])
    assert store.load("plan", "key", Credit) is None


@given(st.data())
def test_a_damaged_artefact_counts_as_absent(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = tmp_path_factory.mktemp("store") / "one.artefact"
    artefact.save(path, CREDIT)
    whole = path.read_bytes()
    if data.draw(st.booleans()):
        damaged = whole[: data.draw(st.integers(0, len(whole) - 1))]
    else:
        place = data.draw(st.integers(0, len(whole) - 1))
        flipped = whole[place] ^ (1 << data.draw(st.integers(0, 7)))
        damaged = whole[:place] + bytes([flipped]) + whole[place + 1 :]
    path.write_bytes(damaged)
    assert artefact.load(path, Credit) is None


def test_made_once_and_made_anew_when_damaged(tmp_path: Path) -> None:
    store, made = Store(tmp_path), []

    def make() -> Credit:
        made.append(1)
        return CREDIT

    for _ in range(3):
        assert store.made("land", "key", Credit, make) == CREDIT
    assert len(made) == 1
    path = store.path("land", "key")
    path.write_bytes(path.read_bytes()[:40])
    assert store.made("land", "key", Credit, make) == CREDIT
    assert len(made) == 2


def test_a_failed_save_leaves_the_earlier_artefact_and_no_litter(tmp_path: Path) -> None:
    path = tmp_path / "one.artefact"
    artefact.save(path, CREDIT)
    with pytest.raises((AttributeError, TypeError)):
        artefact.save(path, lambda: 1)
    assert artefact.load(path, Credit) == CREDIT
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(StageError, match="--output"):
        artefact.save(path / "below-a-file" / "x.artefact", CREDIT)


def test_a_key_is_the_same_in_every_process_and_differs_with_every_input() -> None:
    script = (
        "from pipeline import store\n"
        "print(store.key('plan', 'a', {'x': [1.5, None], 'y': 'z'}, ('b',)))"
    )
    keys = {
        subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT
        ).stdout.strip()
        for _ in range(2)
    }
    assert keys == {artefact.key("plan", "a", {"x": [1.5, None], "y": "z"}, ("b",))}
    others = [
        artefact.key("plan", "a", {"x": [1.5, None], "y": "z"}, ("c",)),
        artefact.key("plan", "a", {"x": [1.25, None], "y": "z"}, ("b",)),
        artefact.key("evaluate", "a", {"x": [1.5, None], "y": "z"}, ("b",)),
        artefact.key("plan", np.zeros(3)),
        artefact.key("plan", np.ones(3)),
    ]
    assert len({*keys, *others}) == 1 + len(others)


def test_a_second_run_of_a_scenario_is_told_to_wait(tmp_path: Path) -> None:
    path = tmp_path / "outputs" / ".artefacts" / "one.lock"
    script = (
        "import sys\n"
        "from pathlib import Path\n"
        "from pipeline.store import only_run\n"
        f"with only_run(Path({str(path)!r}), 'one'):\n"
        "    print('in', flush=True)\n"
        "    sys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "in\n"
        with pytest.raises(StageError, match=r"another run of 'one'.*wait"):
            artefact.only_run(path, "one").__enter__()
        # A run that is killed gives the lock back.
        other.kill()
    with artefact.only_run(path, "one"):
        pass
