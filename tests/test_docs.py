"""What the documents tell a reader to type works: Python blocks run, `make` targets exist."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
DOCUMENTS = ("README.md", "CONTRIBUTING.md")
FENCE = re.compile(r"^```(?P<language>\w+)[^\n]*\n(?P<body>.*?)^```\s*$", re.MULTILINE | re.DOTALL)


def _blocks(document: str, *languages: str) -> list[tuple[int, str]]:
    """Fenced blocks of a document in these languages, each with the line its text begins at."""
    path = ROOT / document
    text = path.read_text("utf-8") if path.exists() else ""
    return [
        (text.count("\n", 0, block.start("body")) + 1, block["body"])
        for block in FENCE.finditer(text)
        if block["language"] in languages
    ]


def _targets() -> list[str]:
    """Each `make TARGET` that a shell block of the documents names, once."""
    shell = (body for name in DOCUMENTS for _, body in _blocks(name, "sh", "bash", "console"))
    named = re.findall(r"^\s*(?:\$ )?make ([a-z][\w-]*)", "\n".join(shell), re.MULTILINE)
    return sorted(set(named))


@pytest.mark.parametrize("document", DOCUMENTS)
def test_python_blocks_run(document: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The blocks run in their order, in one namespace, as a reader would paste them."""
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, object] = {"__name__": "__main__"}
    for line, body in _blocks(document, "python"):
        # Blank lines before the block, so that a traceback names the document's own line.
        code = compile("\n" * (line - 1) + body, str(ROOT / document), "exec")
        exec(code, namespace)  # noqa: S102  # running the document's own example is the point


@pytest.mark.parametrize("document", DOCUMENTS)
def test_links_point_at_files_that_exist(document: str) -> None:
    path = ROOT / document
    text = path.read_text("utf-8") if path.exists() else ""
    links = re.findall(r"\]\((?!https?:|#|mailto:)([^)#\s]+)", text)
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_make_targets_exist() -> None:
    make = shutil.which("make")
    if make is None:
        pytest.skip("needs make")
    # The flags of an outer make (-j, --jobserver) are not meant for this one.
    environment = {key: value for key, value in os.environ.items() if not key.startswith("MAKE")}
    done = subprocess.run(
        [make, "--dry-run", "help", *_targets()],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
