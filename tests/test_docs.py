"""What the documents say holds: Python blocks run; targets, files and names exist."""

import ast
import dataclasses
import os
import re
import shutil
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import jupytext
import pytest

import renew
from tests.commands import ended, ran
from tests.conftest import ROOT
from tests.notebooks import EXECUTED, SOURCES

PAPER_MAP = "docs/explanation/paper-map.md"
DOCUMENTS = (
    "README.md",
    "CONTRIBUTING.md",
    "SECURITY.md",
    *sorted(
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "docs").rglob("*.md")
        if path.parent.name != "notebooks"  # run by their own test
    ),
)
# Pages whose Python takes seconds: a slow test runs it.
LONG = ("docs/changing-currents.md", "docs/how-to/ensembles.md", "docs/how-to/havens.md")
FENCE = re.compile(r"^```(?P<language>\w+)[^\n]*\n(?P<body>.*?)^```\s*$", re.MULTILINE | re.DOTALL)
SHELL = ("sh", "bash", "console")
NOT_RUN = re.compile(r"<!-- not run: [^\n]+ -->\n$")
# Pages whose commands a slow test runs.
RUN = (
    "docs/gallery.md",
    "docs/how-to/check-route.md",
    "docs/how-to/copernicus.md",
    "docs/how-to/departure.md",
    "docs/how-to/own-chart.md",
    "docs/how-to/own-currents.md",
    "docs/how-to/own-vessel.md",
    "docs/how-to/plotter.md",
    "docs/how-to/tides.md",
    "docs/how-to/under-way.md",
    "docs/how-to/vehicle.md",
    "docs/how-to/via-and-avoid.md",
)
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


@pytest.mark.parametrize(
    "document", [pytest.param(one, marks=[pytest.mark.slow] * (one in LONG)) for one in DOCUMENTS]
)
def test_python_blocks_run(document: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The blocks run in their order, in one namespace, as a reader would paste them."""
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, object] = {"__name__": "__main__"}
    for line, body in _blocks(document, "python"):
        # Blank lines before the block, so that a traceback names the document's own line.
        code = compile("\n" * (line - 1) + body, str(ROOT / document), "exec")
        exec(code, namespace)  # noqa: S102  # running the document's own example is the point


@pytest.mark.parametrize("document", DOCUMENTS)
def test_shell_blocks_are_run_or_say_why_not(document: str) -> None:
    text = _text(document)
    silent = [
        text.count("\n", 0, block.start()) + 1
        for block in FENCE.finditer(text)
        if block["language"] in SHELL and not NOT_RUN.search(text[: block.start()])
    ]
    assert silent == [] or document in RUN, "put `<!-- not run: why -->` before the block"


@pytest.mark.slow
@pytest.mark.parametrize("document", RUN)
def test_shell_blocks_run(document: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A page's blocks in one folder: Python and named TOML files, then commands that take them."""
    monkeypatch.chdir(tmp_path)
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    }
    text, namespace = _text(document), dict[str, object]({"__name__": "__main__"})
    for _, body in _blocks(document, "python"):
        exec(compile(body, document, "exec"), namespace)  # noqa: S102  # as above
    for _, body in _blocks(document, "toml"):
        if named := re.match(r"# ([\w-]+\.toml)\n", body):
            (tmp_path / named[1]).write_text(body, encoding="utf-8")
    count = 0
    for block in FENCE.finditer(text):
        if block["language"] in SHELL and not NOT_RUN.search(text[: block.start()]):
            ran("/bin/sh", "-ec", block["body"], env=environment)
            count += 1
    assert count


@pytest.mark.parametrize("name", sorted(path.stem for path in SOURCES.glob("*.md")))
def test_executed_notebooks_are_those_of_their_text(name: str) -> None:
    """If not: `make notebooks`."""
    text = jupytext.read(SOURCES / f"{name}.md").cells
    executed = jupytext.read(EXECUTED / f"{name}.ipynb").cells
    assert [cell.source for cell in executed] == [cell.source for cell in text]
    assert all(cell.execution_count for cell in executed if cell.cell_type == "code")


def test_the_readme_is_one_screen() -> None:
    assert len(_text("README.md").split()) <= 700


def test_every_page_of_the_site_is_in_its_index() -> None:
    listed = set(re.findall(r"^([\w/-]+)$", _text("docs/index.md"), re.MULTILINE))
    pages = {
        path.relative_to(ROOT / "docs").with_suffix("").as_posix()
        for kind in ("*.md", "*.ipynb")
        for path in (ROOT / "docs").rglob(kind)
    }
    assert {page for page in pages if not page.startswith("notebooks/")} - {"index"} == listed


@pytest.mark.slow
def test_the_site_is_built_strictly_and_has_every_public_name(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sphinx", "-W", "-E", "-q", "-b", "html", "docs"]
    ran(*command, str(tmp_path), cwd=ROOT)
    page = (tmp_path / "reference" / "python.html").read_text("utf-8")
    anchors = set(re.findall(r'id="((?:renew|pipeline)\.[\w.]+)"', page))
    assert {f"renew.{name}" for name in renew.__all__} <= anchors


_TITLE = "# Title\n\n"
# A page of a site, the further file of it, and what the strict build must say of the two.
FAULTS = {
    "none": (_TITLE + "A [link](other.md).\n", "other.md", "# Other\n", ""),
    "broken link": (_TITLE + "A [link](gone.md).\n\n", "other.md", "# Other\n", "gone.md"),
    "no docstring": (
        _TITLE + "```{eval-rst}\n.. automodule:: bare_names\n```\n",
        "bare_names.py",
        '"""A module."""\n\ndef without_words() -> None:\n    pass\n',
        "function bare_names.without_words has no docstring",
    ),
    "cell not executed": (
        _TITLE + "A [link](cells.ipynb).\n",
        "cells.ipynb",
        jupytext.writes(jupytext.reads("# # Other\n\n1 + 1\n", "py:light"), "ipynb"),
        "failed or was not executed",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("faults", [(one,) for one in FAULTS])
def test_a_strict_build_fails_at_faults(faults: tuple[str, ...], tmp_path: Path) -> None:
    source = tmp_path / "docs"
    shutil.copytree(ROOT / "docs" / "static", source / "static")
    (source / "reference").mkdir()
    shutil.copy(ROOT / "docs" / "reference" / "scenario.schema.json", source / "reference")
    shutil.copy(ROOT / "docs" / "conf.py", source)
    begin, pages = "", []
    for index, name, text, _ in map(FAULTS.__getitem__, faults):
        (source / name).write_text(text, encoding="utf-8")
        begin += index.removeprefix(_TITLE if begin else "")
        if not name.endswith(".py"):
            pages.append(name.partition(".")[0])
    tree = "\n".join(["", "```{toctree}", *pages, "```", ""])
    (source / "index.md").write_text(begin + tree, encoding="utf-8")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-E", "-q", "-b", "html"]
    path = os.pathsep.join([str(ROOT), str(source)])
    done = ended(*command, source, tmp_path / "site", env={**os.environ, "PYTHONPATH": path})
    assert (done.returncode != 0) == (faults != ("none",)), done.stderr
    for fault in faults:
        assert FAULTS[fault][-1] in done.stderr


@pytest.mark.parametrize("document", DOCUMENTS)
def test_links_point_at_files_and_headings_that_exist(document: str) -> None:
    """The strict build says so of the site, but takes a minute."""
    links = re.findall(r"\]\((?!https?:|mailto:)([^)#\s]*)#?([^)\s]*)\)", _text(document))
    folder = (ROOT / document).parent
    assert [link for link, _ in links if not (folder / link).exists()] == []
    for link, anchor in links:
        page = folder / link if link else ROOT / document
        if anchor and page.suffix == ".md":
            headings = re.findall("^#+ (.*)", page.read_text("utf-8"), re.MULTILINE)
            slugs = [re.sub(r"[^\w\- ]", "", line.lower()).replace(" ", "-") for line in headings]
            assert anchor in slugs or not headings, link  # a page may only include another


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
    named = {one.name for one in dataclasses.fields(renew.PlanOptions)}
    assert {"order", "method", "drift"} <= set(options) <= named


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


# What is told to be installed, up to the end of the command.
INSTALLED = re.compile(r"(?:pip|pipx|uv tool|uvx) install ((?:[-./\w*'\"\[\]<>=,]+[ ]?)+)")
# Folders with texts that a reader follows: messages, pages, settings.
READ = ("renew", "pipeline", "experiments", "qgis", "catalog", "docs", "outputs")


def test_nothing_is_installed_by_a_name_that_is_not_ours() -> None:
    """RENEW is in no index: a command that names it would install what others put there.

    A command installs from the clone, from a wheel, or libraries that pyproject.toml names.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    extras = project["project"]["optional-dependencies"].values()
    groups = (project["project"]["dependencies"], *extras)
    known = {re.split(r"[^\w.-]", one)[0] for group in groups for one in group}
    known |= {"or", *project["dependency-groups"]}  # pip install --group experiments
    files = [
        path
        for room in READ
        for path in (ROOT / room).rglob("*")
        if path.suffix in {".py", ".md", ".ipynb", ".jinja", ".js", ".toml", ".yml"}
        and not path.is_relative_to(ROOT / "outputs" / ".results")
    ]
    found = []
    for path in (*files, *(ROOT / page for page in DOCUMENTS)):
        text = path.read_text("utf-8")
        assert "renew-planner[" not in text, path
        for command in INSTALLED.findall(text):
            for word in command.rstrip(" .,").split(", ")[0].split():
                name = re.split(r"[\[<>=,]", word.strip("'\""))[0]
                if not name.startswith(("-", ".", "/")) and ".whl" not in word:
                    found.append(name)
                    assert name in known, f"{path}: {command}"
    assert {"eccodes", "fastapi", "pyfes", "triangle"} <= set(found)


def test_make_targets_exist() -> None:
    make = shutil.which("make")
    if make is None:
        pytest.skip("needs make")
    # The flags of an outer make (-j, --jobserver) are not meant for this one.
    environment = {key: value for key, value in os.environ.items() if not key.startswith("MAKE")}
    ran(make, "--dry-run", "help", *_targets(), cwd=ROOT, env=environment)


def test_systemd_accepts_the_unit(tmp_path: Path) -> None:
    analyze, program = shutil.which("systemd-analyze"), shutil.which("env")
    if analyze is None or program is None:
        pytest.skip("needs systemd-analyze")
    unit = tmp_path / "renew@.service"
    text = (ROOT / "catalog" / "operation" / unit.name).read_text(encoding="utf-8")
    unit.write_text(text.replace("/opt/renew/bin/renew", program), encoding="utf-8")
    command = [analyze, "verify", str(unit)]
    done = ended(*command)
    assert (done.returncode, done.stderr) == (0, "")
