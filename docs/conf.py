"""Settings of the site: `make docs` builds it, strict and without the network."""

from __future__ import annotations

import inspect
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sphinx.util import logging

import renew

if TYPE_CHECKING:
    from sphinx.application import Sphinx

project = "RENEW"
author = "RENEW contributors"
release = version = renew.__version__
copyright = "RENEW contributors, MIT licence"  # noqa: A001  # Sphinx's name

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
]
exclude_patterns = ["notebooks/*"]  # the text of tutorials/*.ipynb
nitpick_ignore_regex = [("py:.*", ".*")]  # types of numpy and shapely have their pages elsewhere

html_theme = "furo"
html_title = "RENEW"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_theme_options = {
    "light_css_variables": {"color-brand-content": "#0b5394", "color-brand-primary": "#0b5394"},
    "dark_css_variables": {"color-brand-content": "#8ab4f8", "color-brand-primary": "#8ab4f8"},
}
html_copy_source = False
html_extra_path = ["reference/scenario.schema.json"]
pygments_style = "a11y-high-contrast-light"
pygments_dark_style = "a11y-high-contrast-dark"

myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
nb_execution_mode = (
    "off"  # they are executed by `make notebooks`; an unexecuted cell is a fault, below
)
suppress_warnings = ["mystnb.unknown_mime_type"]

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the NumPy sections say them
napoleon_google_docstring = False
napoleon_use_ivar = True  # a dataclass's attributes stand in its docstring, once
autodoc_default_options = {"members": True, "imported-members": True, "undoc-members": True}

_log = logging.getLogger(__name__)


def _require_docstring(
    app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]
) -> None:
    """Warn of a public name that has no docstring of its own: with -W the build fails."""
    del app, options
    if what in {"class", "exception", "function", "method", "property"} and not lines:
        _log.warning("%s %s has no docstring: %s", what, name, inspect.getmodule(obj))


def _skip(app: Sphinx, what: str, name: str, obj: object, skip: bool, options: object) -> bool:  # noqa: FBT001
    """Leave out attributes that a class's docstring explains already."""
    del app, what, name, options
    return skip or not (callable(obj) or isinstance(obj, property) or hasattr(obj, "func"))


def _require_execution(app: Sphinx, name: str, source: list[str]) -> None:
    """Warn of a notebook with a cell that was not executed, or that failed."""
    if Path(app.env.doc2path(name)).suffix != ".ipynb":
        return
    for number, cell in enumerate(json.loads(source[0])["cells"], start=1):
        failed = any(out["output_type"] == "error" for out in cell.get("outputs", ()))
        if failed or (cell["cell_type"] == "code" and not cell["execution_count"]):
            _log.warning("%s: cell %d failed or was not executed: make notebooks", name, number)


def _make_accessible(
    app: Sphinx, page: str, template: str, context: dict[str, Any], tree: object
) -> None:
    """Let the keyboard reach tables that scroll, and give captions of the navigation a level.

    Sphinx calls the captions headings.
    """
    del app, page, template, tree
    if "body" in context:
        wrapper = '<div class="table-wrapper'
        context["body"] = context["body"].replace(
            wrapper, f'{wrapper[:4]} tabindex="0"{wrapper[4:]}'
        )
    key = "furo_navigation_tree"
    if key in context:
        levelled = 'role="heading" aria-level="2"'
        context[key] = context[key].replace('role="heading"', levelled)


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the checks."""
    app.connect("autodoc-process-docstring", _require_docstring)
    app.connect("autodoc-skip-member", _skip)
    app.connect("source-read", _require_execution)
    app.connect("html-page-context", _make_accessible, priority=900)  # after the theme's own
    return {"parallel_read_safe": True, "parallel_write_safe": True}
