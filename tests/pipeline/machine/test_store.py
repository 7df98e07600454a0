"""The store: artefacts are complete or absent and named by content; one run at a time."""

import json
import os
import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from pipeline.errors import StageError
from pipeline.machine import store
from pipeline.machine.store import (
    Store,
    artefact_key,
    code_files,
    code_hash,
    load_artefact,
    remove_unfinished,
    save_artefact,
)
from pipeline.model import Credit
from tests.commands import PYTHON, ran
from tests.conftest import ROOT

CREDIT = Credit("name", "land", "text", "licence")


def test_a_saved_artefact_is_loaded(tmp_path: Path) -> None:
    store = Store(tmp_path)
    path = store.save("plan", "key", CREDIT)
    assert store.load("plan", "key", Credit) == CREDIT
    assert [file.name for file in tmp_path.rglob("*") if file.is_file()] == [path.name]


def test_an_absent_artefact_or_one_of_another_type_is_none(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert store.load("plan", "key", Credit) is None
    store.save("plan", "key", [1])
    assert store.load("plan", "key", Credit) is None


@given(st.data())
def test_a_damaged_artefact_counts_as_absent(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = tmp_path_factory.mktemp("store") / "one.artefact"
    save_artefact(path, CREDIT)
    content = path.read_bytes()
    if data.draw(st.booleans()):
        damaged = content[: data.draw(st.integers(0, len(content) - 1))]
    else:
        place = data.draw(st.integers(0, len(content) - 1))
        flipped = content[place] ^ (1 << data.draw(st.integers(0, 7)))
        damaged = content[:place] + bytes([flipped]) + content[place + 1 :]
    path.write_bytes(damaged)
    assert load_artefact(path, Credit) is None


def test_an_artefact_is_made_once_and_again_when_damaged(tmp_path: Path) -> None:
    store, made = Store(tmp_path), []

    def make() -> Credit:
        made.append(1)
        return CREDIT

    for _ in range(3):
        assert store.load_or_make("land", "key", Credit, make) == CREDIT
    assert len(made) == 1
    path = store.path("land", "key")
    path.write_bytes(path.read_bytes()[:40])
    assert store.load_or_make("land", "key", Credit, make) == CREDIT
    assert len(made) == 2


def test_a_failed_save_leaves_the_earlier_artefact_and_no_other_file(tmp_path: Path) -> None:
    path = tmp_path / "one.artefact"
    save_artefact(path, CREDIT)
    with pytest.raises((AttributeError, TypeError, pickle.PicklingError)):
        save_artefact(path, lambda: 1)
    assert load_artefact(path, Credit) == CREDIT
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(StageError, match="--output"):
        save_artefact(path / "below-a-file" / "x.artefact", CREDIT)


def test_a_key_is_the_same_in_every_process_and_differs_with_every_input() -> None:
    script = (
        "from pipeline.machine.store import artefact_key\n"
        "print(artefact_key('plan', 'a', {'x': [1.5, None], 'y': 'z'}, ('b',)))"
    )
    keys = {ran(*PYTHON, script, cwd=ROOT).strip() for _ in range(2)}
    assert keys == {artefact_key("plan", "a", {"x": [1.5, None], "y": "z"}, ("b",))}
    others = [
        artefact_key("plan", "a", {"x": [1.5, None], "y": "z"}, ("c",)),
        artefact_key("plan", "a", {"x": [1.25, None], "y": "z"}, ("b",)),
        artefact_key("evaluate", "a", {"x": [1.5, None], "y": "z"}, ("b",)),
        artefact_key("plan", np.zeros(3)),
        artefact_key("plan", np.ones(3)),
    ]
    assert len({*keys, *others}) == 1 + len(others)


def test_loading_an_artefact_says_that_it_is_in_use(tmp_path: Path) -> None:
    path = tmp_path / "one.artefact"
    save_artefact(path, CREDIT)
    os.utime(path, (1, 1))
    assert load_artefact(path, CREDIT.__class__) == CREDIT
    assert path.stat().st_mtime > 1e9


def test_unfinished_files_are_removed_by_their_owner(tmp_path: Path) -> None:
    (tmp_path / "plan").mkdir()
    mine, other = (tmp_path / "plan" / f".{name}.0a1b.tmp" for name in ("one", "one-more"))
    for file in (mine, other):
        file.touch()
    remove_unfinished(tmp_path, "one")
    assert list((tmp_path / "plan").iterdir()) == [other]
    remove_unfinished(tmp_path)
    assert not list((tmp_path / "plan").iterdir())


# --- The hash covers all code and data that results depend on ---


def test_data_files_are_in_the_hash_and_machine_code_is_not() -> None:
    files = set(code_files())
    assert ROOT / "pipeline/formats/report/templates/report.css" in files
    assert not any("__pycache__" in file.parts for file in files)


def test_every_loaded_module_is_in_the_hash() -> None:
    """The interpreter is the oracle: all of ours that it loads for a run is among the files."""
    script = (
        "import json, sys\n"
        "import pipeline.run, pipeline.formats.report.page\n"
        "ours = [m for n, m in sys.modules.items() if n.startswith(('renew', 'pipeline'))]\n"
        "print(json.dumps([m.__file__ for m in ours]))"
    )
    done = ran(*PYTHON, script, cwd=ROOT)
    loaded = {Path(file).resolve() for file in json.loads(done.splitlines()[-1])}
    assert loaded <= set(code_files()), sorted(loaded - set(code_files()))


@pytest.mark.parametrize("name", ["pipeline/stages/plan_case.py", "renew/data/table.json"])
def test_an_edit_changes_the_hash(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str
) -> None:
    (tmp_path / name).parent.mkdir(parents=True)
    (tmp_path / name).write_text("1\n")
    monkeypatch.setattr(store, "_ROOT", tmp_path)
    before = code_hash.__wrapped__()
    (tmp_path / name).write_text("2\n")
    assert code_hash.__wrapped__() != before
