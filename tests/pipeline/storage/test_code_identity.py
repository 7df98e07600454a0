"""A stage's hash covers all code that it imports, at any depth."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.storage import code_identity
from pipeline.storage.code_identity import code_files, code_hash

ROOT = Path(code_identity.__file__).resolve().parents[2]
STAGES = ("land", "current", "simplify", "project", "plan", "evaluate", "write")


@pytest.mark.parametrize(
    ("stage", "file"),
    [
        ("land", "pipeline/sources/land/vector_layer.py"),
        ("project", "renew/kernels/current_table.py"),
        ("plan", "renew/kernels/capsules.py"),
        ("write", "pipeline/formats/report/templates/report.css"),
        ("write", "pipeline/formats/report/scripts/map.js"),
    ],
)
def test_indirect_imports_and_data_are_in_a_stages_hash(stage: str, file: str) -> None:
    assert ROOT / file in code_files(stage)


@pytest.mark.parametrize(
    ("stage", "file"),
    [
        ("simplify", "pipeline/sources/land/osm.py"),
        ("plan", "pipeline/stages/write.py"),
        ("write", "pipeline/cli/main.py"),
    ],
)
def test_unused_files_are_not_in_a_stages_hash(stage: str, file: str) -> None:
    assert (ROOT / file).is_file()
    assert ROOT / file not in code_files(stage)


@pytest.mark.parametrize("stage", STAGES)
def test_every_loaded_module_is_in_the_hash(stage: str) -> None:
    """The interpreter is the oracle: all that it loads for the stage's modules is among them."""
    modules = [
        m for entry in code_identity._ENTRIES[stage] for m in code_identity._modules_of(entry)
    ]
    script = (
        "import importlib, json, sys\n"
        f"for name in {modules!r}: importlib.import_module(name.removesuffix('.__init__'))\n"
        "ours = [m for n, m in sys.modules.items() if n.startswith(('renew', 'pipeline'))]\n"
        "print(json.dumps([m.__file__ for m in ours]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT
    )
    loaded = {Path(file).resolve() for file in json.loads(done.stdout.splitlines()[-1])}
    assert loaded <= set(code_files(stage)), sorted(loaded - set(code_files(stage)))


def test_an_edit_of_an_indirectly_imported_module_changes_the_hash(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name, text in {
        "pipeline/__init__.py": "",
        "pipeline/model.py": "",
        "pipeline/stages/__init__.py": "",
        "pipeline/stages/plan.py": "def plan():\n    from renew.deep import depth\n",
        "renew/__init__.py": "",
        "renew/deep.py": "depth = 1\n",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(code_identity, "_ROOT", tmp_path)
    before = code_hash.__wrapped__("plan")
    code_identity._imported.cache_clear()
    (tmp_path / "renew/deep.py").write_text("depth = 2\n")
    assert code_hash.__wrapped__("plan") != before
    code_identity._imported.cache_clear()
