"""Jinja's templates, set up alike for the report, the night's page and all XML."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

if TYPE_CHECKING:
    from jinja2 import Environment

# Characters in an attribute that a reader of XML would take for other white space.
_WHITE_SPACE = {"\t": "&#9;", "\n": "&#10;", "\r": "&#13;"}
XML_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 can't write, among them lone halves of a surrogate pair."""


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


@cache
def xml_environment(package: str) -> Environment:
    """Load a package's templates of XML, for any text: what XML forbids is replaced."""
    return environment(package, finalize=_escaped)


def _escaped(value: object) -> Markup:
    """Escape a value for an attribute or an element; what a macro returns is XML already."""
    if isinstance(value, Markup):
        return value
    text = escape(xml_text(str(value)))
    for character, reference in _WHITE_SPACE.items():
        text = text.replace(character, Markup(reference))  # noqa: S704 - our own
    return text


def xml_text(text: str) -> str:
    """Replace what XML forbids by U+FFFD; markup is left for the writer to escape."""
    return XML_FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)
