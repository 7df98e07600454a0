"""One hash of all the code that a stage's result depends on, derived from the imports.

An artefact's key contains this hash, so that after an edit only what it may change is computed
again. Imports are read from the source, also those inside functions; imports for type checkers only
are left out.
"""

from __future__ import annotations

import ast
import hashlib
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TypeGuard

_ROOT = Path(__file__).resolve().parents[2]
_PACKAGES = frozenset({"pipeline", "renew"})
# Where the syntax tree keeps the statements inside a statement; no import stands in an expression.
_INNER = ("body", "orelse", "handlers", "finalbody", "cases")
# The modules and packages that a stage calls first. Results are pickled as the classes of
# `pipeline.model`, so that every stage depends on it.
_ENTRIES = {
    "region": ("pipeline.choices.region",),
    "land": (
        "pipeline.sources.land",
        "pipeline.sources.depths",
        "pipeline.stages.planar",
        "pipeline.model",
    ),
    "current": ("pipeline.sources.currents", "pipeline.model"),
    "simplify": ("pipeline.stages.simplify", "pipeline.stages.planar", "pipeline.model"),
    "project": ("pipeline.stages.project", "pipeline.model"),
    "offing": ("pipeline.choices.offing",),
    "departures": ("pipeline.stages.choose_departures", "pipeline.model"),
    "plan": ("pipeline.stages.plan", "pipeline.model"),
    "evaluate": ("pipeline.stages.evaluate", "pipeline.stages.gap_shares", "pipeline.model"),
    "night-chart": ("pipeline.nightly.planning.chart", "pipeline.model"),
    "night-case": ("pipeline.nightly.planning.worker", "pipeline.model"),
    "sides": ("pipeline.stages.side_bounds", "pipeline.stages.way_names", "pipeline.model"),
    "straits": ("pipeline.stages.shut_straits", "pipeline.model"),
    "write": ("pipeline.stages.write", "pipeline.stages.way_names", "pipeline.model"),
}


@cache
def code_hash(stage: str) -> str:
    """Return the SHA-256, hexadecimal, of the files that a stage's result depends on."""
    digest = hashlib.sha256()
    for file in code_files(stage):
        digest.update(file.relative_to(_ROOT).as_posix().encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()


@cache
def code_commit() -> str:
    """Return the commit of this checkout, with "-dirty" if files differ; empty where it is none."""
    # An installed package may lie inside another project's checkout.
    if _git("rev-parse", "--show-toplevel") != str(_ROOT):
        return ""
    return _git("describe", "--always", "--dirty", "--abbrev=40", "--match=")


def _git(*words: str) -> str:
    """Return what git says of this folder; empty without git, or outside a checkout."""
    command = ["git", "-C", str(_ROOT), *words]
    try:
        told = subprocess.run(command, capture_output=True, check=True, text=True)  # noqa: S603 - words are this module's
    except (OSError, subprocess.CalledProcessError):
        return ""
    return told.stdout.strip()


def code_files(stage: str) -> tuple[Path, ...]:
    """Return the source and data files that a stage's result depends on, sorted."""
    waiting = [module for entry in _ENTRIES[stage] for module in _modules_of(entry)]
    found: set[Path] = set()
    while waiting:
        file = _file(waiting.pop())
        if file is not None and file not in found:
            found.add(file)
            waiting += _imported(file)
    data = {path for file in found for path in _data_beside(file)}
    return tuple(sorted(found | data))


def _modules_of(entry: str) -> Iterator[str]:
    """Yield the dotted names of a module, or of all modules of a package, and its parents."""
    folder = _ROOT.joinpath(*entry.split("."))
    files = sorted(folder.rglob("*.py")) if folder.is_dir() else [folder.with_suffix(".py")]
    yield from _parents(entry)
    for file in files:
        yield ".".join(file.relative_to(_ROOT).with_suffix("").parts)


def _parents(module: str) -> Iterator[str]:
    """Yield the packages that contain a module: they are imported with it."""
    parts = module.split(".")
    return (".".join(parts[:depth]) for depth in range(1, len(parts)))


def _file(module: str) -> Path | None:
    """Return the source of a module or of a package's `__init__`; None if there is none."""
    path = _ROOT.joinpath(*module.split("."))
    for file in (path.with_suffix(".py"), path / "__init__.py"):
        if file.is_file():
            return file
    return None


@cache
def _imported(file: Path) -> tuple[str, ...]:
    """Return the modules of this project that a file imports, and the packages around them."""
    names: set[str] = set()
    waiting: list[ast.AST] = [ast.parse(file.read_bytes())]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif _is_for_type_checkers(node):
            waiting += node.orelse
        else:
            waiting += (inner for field in _INNER for inner in getattr(node, field, ()))
    own = {name for name in names if name.partition(".")[0] in _PACKAGES}
    return tuple(sorted(own | {package for name in own for package in _parents(name)}))


def _is_for_type_checkers(node: ast.AST) -> TypeGuard[ast.If]:
    """Whether a statement is `if TYPE_CHECKING`."""
    return (
        isinstance(node, ast.If)
        and isinstance(node.test, ast.Name)
        and node.test.id == "TYPE_CHECKING"
    )


def _data_beside(file: Path) -> Iterator[Path]:
    """Yield the data files in a module's own folder, and in its subfolders without modules."""
    for path in file.parent.iterdir():
        if path.is_dir() and path.name != "__pycache__" and not (path / "__init__.py").exists():
            yield from (below for below in path.rglob("*") if below.is_file())
        elif path.is_file() and path.suffix not in {".py", ".pyc"}:
            yield path
