"""The scripts and styles of the report: Leaflet, as its makers publish it, and our own."""

import base64
import hashlib
import re
from functools import cache
from pathlib import Path

_HERE = Path(__file__).parent
_LEAFLET = _HERE / "vendor" / "leaflet"
# In the order of their dependencies.
_SCRIPTS = (
    *("data", "text", "units", "currents", "particles", "probe"),
    *("map", "playback", "strip", "report"),
)
# A rule that would fetch an image, for Leaflet's markers and layer button: the page uses neither.
_FETCHING_RULE = re.compile(r"[^{}]*\{[^{}]*url\([^{}]*\}")


def leaflet() -> str:
    """Return Leaflet."""
    return (_LEAFLET / "leaflet.js").read_text(encoding="utf-8")


def own_script(name: str) -> str:
    """Return one of our own files."""
    return (_HERE / "scripts" / f"{name}.js").read_text(encoding="utf-8")


@cache
def script() -> str:
    """Return Leaflet, then our own files in one scope."""
    own = "\n".join(map(own_script, _SCRIPTS))
    return f'\n{leaflet()}\n(() => {{\n"use strict";\n{own}\n}})();\n'


@cache
def leaflet_style() -> str:
    """Return Leaflet's style sheet without the rules that fetch images."""
    return _FETCHING_RULE.sub("", (_LEAFLET / "leaflet.css").read_text(encoding="utf-8"))


def content_hash(text: str) -> str:
    """Return the hash of a script as in a Content-Security-Policy: `sha256-…`."""
    digest = hashlib.sha256(text.encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"
