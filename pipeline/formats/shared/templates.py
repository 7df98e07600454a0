"""Jinja's templates, set up alike for the report, the night's page and QGIS's XML."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Environment


def environment(*packages: str, finalize: Callable[[object], object] | None = None) -> Environment:
    """Load the templates of some packages; all that is filled in is escaped, and has to be there.

    A template that several packages have is that of the first.
    """
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=ChoiceLoader([PackageLoader(package) for package in packages]),
        autoescape=True,
        finalize=finalize,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
