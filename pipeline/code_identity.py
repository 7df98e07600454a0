"""Which code a stage's result depends on, derived from the imports, as one hash.

An artefact's key holds this hash, so that an edit makes anew just what it may change. Imports are
read from the source (those inside functions too); what only a type checker imports is left out.
"""

from __future__ import annotations

import ast
import hashlib
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

_HOME = Path(__file__).resolve().parents[1]
_PACKAGES = frozenset({"pipeline", "renew"})
# The modules and packages in which a stage's work begins. What a stage hands on is pickled by the
# classes of `pipeline.model`.
_ENTRIES = {
    "land": ("pipeline.sources.land", "pipeline.stages.planar", "pipeline.model"),
    "current": ("pipeline.sources.currents", "pipeline.model"),
    "simplify": ("pipeline.stages.simplify", "pipeline.stages.planar", "pipeline.model"),
    "project": ("pipeline.stages.project", "pipeline.model"),
    "plan": ("pipeline.stages.plan", "pipeline.model"),
    "evaluate": ("pipeline.stages.evaluate", "pipeline.model"),
    "write": ("pipeline.stages.write", "pipeline.model"),
}


@cache
def code_hash(stage: str) -> str:
    """SHA-256, hexadecimal, of the files that a stage's result depends on."""
    digest = hashlib.sha256()
    for file in code_files(stage):
        digest.update(file.relative_to(_HOME).as_posix().encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()


def code_files(stage: str) -> tuple[Path, ...]:
    """Source and data files that a stage's result depends on, sorted."""
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
    """Give a module, or all modules of a package, by their dotted names."""
    folder = _HOME.joinpath(*entry.split("."))
    files = sorted(folder.rglob("*.py")) if folder.is_dir() else [folder.with_suffix(".py")]
    yield from _around(entry)
    for file in files:
        yield ".".join(file.relative_to(_HOME).with_suffix("").parts)


def _around(module: str) -> Iterator[str]:
    """Give the packages around a module: they are imported with it."""
    parts = module.split(".")
    return (".".join(parts[:depth]) for depth in range(1, len(parts)))


def _file(module: str) -> Path | None:
    """Source of a module or of a package's `__init__`; None where there is no such module."""
    place = _HOME.joinpath(*module.split("."))
    for file in (place.with_suffix(".py"), place / "__init__.py"):
        if file.is_file():
            return file
    return None


@cache
def _imported(file: Path) -> tuple[str, ...]:
    """Modules of this project that a file imports, with the packages around them."""
    names: set[str] = set()
    waiting: list[ast.AST] = [ast.parse(file.read_bytes())]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            waiting += node.orelse
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
        else:
            waiting += ast.iter_child_nodes(node)
    own = {name for name in names if name.partition(".")[0] in _PACKAGES}
    return tuple(sorted(own | {package for name in own for package in _around(name)}))


def _data_beside(file: Path) -> Iterator[Path]:
    """Files that are no code in a module's own folder and in its folders without modules."""
    for path in file.parent.iterdir():
        if path.is_dir() and path.name != "__pycache__" and not (path / "__init__.py").exists():
            yield from (below for below in path.rglob("*") if below.is_file())
        elif path.is_file() and path.suffix not in {".py", ".pyc"}:
            yield path
