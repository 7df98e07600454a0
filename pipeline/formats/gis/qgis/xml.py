"""QGIS's XML, filled into the templates of this folder; all that is filled in is escaped."""

import re
import uuid
from functools import cache

from jinja2 import Environment

from pipeline.formats.shared.text import shortened
from pipeline.formats.shared.writing import XML_FORBIDDEN, xml_environment, xml_text

# Maximum number of characters of a name in the list of layers.
_MAX_TITLE_LENGTH = 60


def rendered(template: str, **values: object) -> str:
    """Fill in a template."""
    return _environment().get_template(template).render(values).lstrip()


def clean(text: str) -> str:
    """Text that is plain text to XML, and to QGIS, which evaluates what is between [% and %]."""
    return xml_text(text).replace("[%", "[\N{WORD JOINER}%")


def one_line(text: str, limit: int = _MAX_TITLE_LENGTH) -> str:
    """Clean text on one line, of at most `limit` characters."""
    return shortened(" ".join(clean(text).split()), limit)


def literal(text: str) -> str:
    """Write text as a string of QGIS's expression language."""
    parts = re.split(f"({XML_FORBIDDEN.pattern})", text)
    terms = [
        f"char({ord(part)})"
        if index % 2
        else "'" + part.replace("\\", "\\\\").replace("'", "''").replace("\n", "\\n") + "'"
        for index, part in enumerate(parts)
    ]
    return " || ".join(term for term in terms if term != "''") or "''"


@cache
def _environment() -> Environment:
    """Load the templates."""
    loaded = xml_environment("pipeline.formats.gis.qgis")
    loaded.filters.update(
        clean=clean,
        g=lambda value: f"{value:g}",
        # Where QGIS shows HTML: no markup takes effect.
        html=lambda text: clean(text).replace("<", "&lt;"),
        title_line=one_line,
        uuid=lambda name: f"{{{uuid.uuid5(uuid.NAMESPACE_URL, f'renew:{name}')}}}",
    )
    return loaded
