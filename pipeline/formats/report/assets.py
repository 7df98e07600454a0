"""Scripts and style sheets that are embedded in the page, so that it loads nothing."""

import base64
import hashlib
import re
from functools import cache
from pathlib import Path

from pipeline.formats.shared.palette import COLOURS, DARK, SEASON_COLOURS, SEASON_COLOURS_ON_DARK

_HERE = Path(__file__).parent
_LEAFLET = _HERE / "vendor" / "leaflet"
# In the order of their dependencies.
_SCRIPTS = (
    *("data", "text", "units", "currents", "particles", "probe"),
    *("map", "voyage", "strip", "report"),
)
# A rule that would fetch an image, for Leaflet's markers and layer button: the page uses neither.
_FETCHING_RULE = re.compile(r"[^{}]*\{[^{}]*url\([^{}]*\}")


@cache
def script() -> str:
    """Leaflet, then our own files in one scope."""
    leaflet = (_LEAFLET / "leaflet.js").read_text(encoding="utf-8")
    own = "\n".join(
        (_HERE / "scripts" / f"{name}.js").read_text(encoding="utf-8") for name in _SCRIPTS
    )
    return f'\n{leaflet}\n(() => {{\n"use strict";\n{own}\n}})();\n'


def style_colours() -> dict[str, object]:
    """Colours by the names that `report.css` takes them by."""
    return {
        "light": COLOURS,
        "dark": DARK,
        "seasons_on_light": SEASON_COLOURS,
        "seasons_on_dark": SEASON_COLOURS_ON_DARK,
    }


@cache
def leaflet_style() -> str:
    """Leaflet's style sheet without the rules that fetch images."""
    return _FETCHING_RULE.sub("", (_LEAFLET / "leaflet.css").read_text(encoding="utf-8"))


def content_hash(text: str) -> str:
    """Hash of a script as in a Content-Security-Policy: `sha256-…`."""
    digest = hashlib.sha256(text.encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"
