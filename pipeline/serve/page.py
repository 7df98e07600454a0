"""The page's files: its own scripts and styles, and the report's map, text and colours."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

from pipeline.formats.palette import style_colours
from pipeline.formats.report import assets
from pipeline.serve.request import ASKED

_HERE = Path(__file__).parent
# A name that a script of the report defines at its top level.
_DEFINED = re.compile(r"^(?:async )?(?:function|class|const) (\w+)", re.MULTILINE)

REPORT_POLICY = (
    f"sandbox allow-scripts allow-popups; default-src 'none'; "
    f"script-src '{assets.content_hash(assets.script())}'; style-src 'unsafe-inline'; "
    "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""What a report may do: run its own script, in an origin of its own."""


def page_files(interface: Mapping[str, Any]) -> dict[str, bytes]:
    """Return the content of each path of the page, and of that of an interface in OpenAPI."""
    packages = ("pipeline.serve", "pipeline.formats.report")
    templates = Environment(
        loader=ChoiceLoader([PackageLoader(one) for one in packages]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    style = "\n".join(
        (
            assets.leaflet_style(),
            *(
                templates.get_template(name).render(style_colours())
                for name in ("report.css", "explorer.css")
            ),
            (_HERE / "templates" / "plan.css").read_text("utf-8"),
        )
    )
    own = {
        f"/static/{path.name}": path.read_text("utf-8")
        for path in sorted((_HERE / "scripts").glob("*.js"))
    }
    files = {
        "/": templates.get_template("plan.html.jinja").render(
            options={one.field: one for one in ASKED}
        ),
        "/api": templates.get_template("api.html.jinja").render(api=interface),
        "/static/style.css": style,
        "/static/leaflet.js": assets.leaflet(),
        "/static/text.js": _as_module(assets.own_script("text")),
        **own,
    }
    return {path: content.encode() for path, content in files.items()}


def _as_module(script: str) -> str:
    """Return a script of the report as a module that exports all that it defines."""
    return f"{script}\nexport {{ {', '.join(_DEFINED.findall(script))} }};\n"
