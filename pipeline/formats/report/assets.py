"""What stands inside the page, so that it asks for nothing: Leaflet, our scripts, their styles."""

from __future__ import annotations

import base64
import hashlib
import re
from functools import cache
from pathlib import Path

_HERE = Path(__file__).parent
_LEAFLET = _HERE / "vendor" / "leaflet"
# In the order in which they build on each other.
_SCRIPTS = ("data", "words", "currents", "map", "voyage", "strip", "report")
# A rule that would fetch a picture: Leaflet's markers and layer button, which the page has not.
_FETCHES = re.compile(r"[^{}]*\{[^{}]*url\([^{}]*\}")


@cache
def script() -> str:
    """Leaflet, then our own files as one scope of their own."""
    leaflet = (_LEAFLET / "leaflet.js").read_text(encoding="utf-8")
    own = "\n".join(
        (_HERE / "scripts" / f"{name}.js").read_text(encoding="utf-8") for name in _SCRIPTS
    )
    return f'\n{leaflet}\n(() => {{\n"use strict";\n{own}\n}})();\n'


@cache
def leaflet_style() -> str:
    """Leaflet's style sheet without the rules that fetch pictures."""
    return _FETCHES.sub("", (_LEAFLET / "leaflet.css").read_text(encoding="utf-8"))


def content_hash(text: str) -> str:
    """Name a script as a Content-Security-Policy does: `sha256-…`."""
    digest = hashlib.sha256(text.encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"
