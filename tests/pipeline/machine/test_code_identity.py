"""The hash covers all code and data that results depend on."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.machine import store
from pipeline.machine.store import code_files, code_hash

ROOT = Path(store.__file__).resolve().parents[2]


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
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT
    )
    loaded = {Path(file).resolve() for file in json.loads(done.stdout.splitlines()[-1])}
    assert loaded <= set(code_files()), sorted(loaded - set(code_files()))


@pytest.mark.parametrize("name", ["pipeline/stages/seasons/one_season.py", "renew/data/table.json"])
def test_an_edit_changes_the_hash(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str
) -> None:
    (tmp_path / name).parent.mkdir(parents=True)
    (tmp_path / name).write_text("1\n")
    monkeypatch.setattr(store, "_ROOT", tmp_path)
    before = code_hash.__wrapped__()
    (tmp_path / name).write_text("2\n")
    assert code_hash.__wrapped__() != before
