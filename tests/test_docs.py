"""What the documents say holds: Python blocks run; targets, files and names exist."""

from __future__ import annotations

import ast
import inspect
import os
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import renew

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parent.parent
PAPER_MAP = "docs/paper-map.md"
DOCUMENTS = (
    "README.md",
    "CONTRIBUTING.md",
    *sorted(f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md")),
)
FENCE = re.compile(r"^```(?P<language>\w+)[^\n]*\n(?P<body>.*?)^```\s*$", re.MULTILINE | re.DOTALL)
SPAN = re.compile(r"`([^`\n]+)`")
FILE_IN_REPOSITORY = re.compile(r"(?:renew|pipeline|catalog|tests|docs)/[\w./-]*")
# The column of the paper map's tables that names files, and what is defined in each.
CODE_COLUMN = "in the code"


def _text(document: str) -> str:
    """Text of a document."""
    return (ROOT / document).read_text("utf-8")


def _blocks(document: str, *languages: str) -> list[tuple[int, str]]:
    """Fenced blocks of a document in these languages, each with the line its text begins at."""
    text = _text(document)
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
    links = re.findall(r"\]\((?!https?:|#|mailto:)([^)#\s]+)(?:#[^)\s]*)?\)", _text(document))
    folder = (ROOT / document).parent
    assert [link for link in links if not (folder / link).exists()] == []


@pytest.mark.parametrize("document", DOCUMENTS)
def test_files_and_public_names_exist(document: str) -> None:
    spans = SPAN.findall(_text(document))
    files = [span for span in spans if FILE_IN_REPOSITORY.fullmatch(span)]
    assert [file for file in files if not (ROOT / file).exists()] == []

    names = [span.removeprefix("renew.") for span in spans if re.fullmatch(r"renew\.\w+", span)]
    assert [name for name in names if not hasattr(renew, name)] == []


def test_the_paper_map_names_what_is_defined() -> None:
    rows = list(_code_cells(_text(PAPER_MAP)))
    named = 0
    for cell in rows:
        file = ""
        for span in SPAN.findall(cell):
            if FILE_IN_REPOSITORY.fullmatch(span):
                file = span
                continue
            assert file, f"{span} stands before any file in {cell!r}"
            assert span in _defined_in(file), f"{span} is not defined in {file}"
            named += 1
        assert file, f"no file in {cell!r}"
    assert named >= len(rows) > 0


def test_the_paper_map_names_options_of_plan() -> None:
    options = re.findall(r"`(\w+)=[^`]*`", _text(PAPER_MAP))
    assert (
        {"order", "method", "drift"}
        <= set(options)
        <= set(inspect.signature(renew.plan).parameters)
    )


def _code_cells(text: str) -> Iterator[str]:
    """Cells of the tables' code column, headers left out."""
    column, in_table = -1, False
    for line in text.splitlines():
        if not line.startswith("|"):
            in_table = False
            continue
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)]
        if not in_table:
            in_table = True
            column = cells.index(CODE_COLUMN) if CODE_COLUMN in cells else -1
        elif column >= 0 and set(cells[column]) != {"-"}:
            yield cells[column]


@cache
def _defined_in(file: str) -> frozenset[str]:
    """Names that a module defines, and "Class.member" of its classes."""
    module = ast.parse(_text(file))
    members = (
        f"{node.name}.{name}"
        for node in module.body
        if isinstance(node, ast.ClassDef)
        for name in _names(node.body)
    )
    return frozenset([*_names(module.body), *members])


def _names(body: list[ast.stmt]) -> Iterator[str]:
    """Names that statements define, attributes of a dataclass too."""
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        targets = node.targets if isinstance(node, ast.Assign) else []
        targets = [node.target] if isinstance(node, ast.AnnAssign) else targets
        yield from (target.id for target in targets if isinstance(target, ast.Name))


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


def test_systemd_accepts_the_unit(tmp_path: Path) -> None:
    analyze, program = shutil.which("systemd-analyze"), shutil.which("env")
    if analyze is None or program is None:
        pytest.skip("needs systemd-analyze")
    unit = tmp_path / "renew@.service"
    found = re.search(r"(?ms)^```\n(\[Unit\].*?)^```", _text("docs/service.md"))
    assert found is not None
    unit.write_text(found[1].replace("/opt/renew/bin/renew", program))
    command = [analyze, "verify", str(unit)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
