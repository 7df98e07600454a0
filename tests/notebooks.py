"""Execute the site's notebooks: `python -m tests.notebooks` (`make notebooks`).

They are kept as text in docs/notebooks/; what they printed and drew is kept beside it in
docs/tutorials/, which the site is built from.
"""

import os
import re
import sys
from pathlib import Path
from typing import Any

import jupytext
from nbclient import NotebookClient

from tests.conftest import ROOT

SOURCES, EXECUTED = ROOT / "docs" / "notebooks", ROOT / "docs" / "tutorials"
# Time that one cell may take, s.
_MAX_SECONDS = 1800


def executed(source: Path) -> Any:  # noqa: ANN401  # nbformat has no types
    """Execute a notebook's text from the top, and return it with what it printed and drew."""
    notebook = jupytext.read(source)
    os.environ["PYDEVD_DISABLE_FILE_VALIDATION"] = "1"
    client = NotebookClient(
        notebook, timeout=_MAX_SECONDS, resources={"metadata": {"path": str(ROOT)}}
    )
    client.execute()
    return _without_noise(notebook)


def _without_noise(notebook: Any) -> Any:  # noqa: ANN401
    """Drop what differs from run to run: times, ids, progress, names of temporary folders."""
    notebook.metadata = {"kernelspec": notebook.metadata["kernelspec"]}
    for number, cell in enumerate(notebook.cells):
        cell.id = f"cell-{number}"
        cell.metadata = {}
        if cell.cell_type != "code":
            continue
        cell.outputs = [
            out
            for out in cell.outputs
            if not (out.output_type == "stream" and out.name == "stderr")
        ]
        for out in cell.outputs:
            for kind in ("text/plain", "text/html"):
                if kind in out.get("data", {}):
                    shown = re.sub(r"/tmp/\w+", "…", out.data[kind])  # noqa: S108
                    out.data[kind] = re.sub(r"\bseconds=[\d.]+", "seconds=…", shown)
    return notebook


def execute(names: list[str]) -> None:
    """Execute the notebooks of these names, or all of them."""
    for source in sorted(SOURCES.glob("*.md")):
        if not names or source.stem in names:
            target = EXECUTED / f"{source.stem}.ipynb"
            jupytext.write(executed(source), target, fmt="ipynb")
            sys.stdout.write(f"{target.relative_to(ROOT)}\n")


if __name__ == "__main__":
    execute(sys.argv[1:])
