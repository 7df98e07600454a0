"""How maps and pages look: colours by role, and the scripts and style sheets of pages."""

import base64
import hashlib
import re
from functools import cache
from pathlib import Path

from pipeline.texts import table_beside

_ROLES: dict[str, list[str]] = table_beside(__file__, "colours.toml")
COLOURS, DARK = ({role: both[at] for role, both in _ROLES.items()} for at in (0, 1))
"""Role -> colour on a light background, and on a dark one."""

STATES = {
    "covered": COLOURS["covered"],
    "not settled": COLOURS["unsettled"],
    "uncovered": COLOURS["uncovered"],
}
"""State of a stretch of a route that havens may cover -> its colour on a light background."""

SEASON_COLOURS = ("#9d3c0e", "#4a148c", "#111111", "#1c52c0", "#651e07", "#6a526d")
"""Colours of cases on a light background, in the scenario's order; of a single case's sides."""

SEASON_COLOURS_ON_DARK = ("#ff8a3d", "#9a7bff", "#ffffff", "#4fc8ff", "#ffe000", "#f2a6b3")
"""Colours of cases on a dark background, one for each of `SEASON_COLOURS`."""


def season_colour(index: int) -> str:
    """Return the colour of the case `index`, from 0; colours repeat if need be."""
    return SEASON_COLOURS[index % len(SEASON_COLOURS)]


def style_colours() -> dict[str, object]:
    """Return colours by the names that `report.css` takes them by."""
    return {
        "light": COLOURS,
        "dark": DARK,
        "seasons_on_light": SEASON_COLOURS,
        "seasons_on_dark": SEASON_COLOURS_ON_DARK,
    }


_REPORT = Path(__file__).parent / "report"
_LEAFLET = _REPORT / "vendor" / "leaflet"
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


@cache
def own_scripts() -> str:
    """Return our own files, as one text."""
    files = (_REPORT / "scripts" / f"{name}.js" for name in _SCRIPTS)
    return "\n".join(file.read_text(encoding="utf-8") for file in files)


@cache
def script() -> str:
    """Return Leaflet, then our own files in one scope."""
    return f'\n{leaflet()}\n(() => {{\n"use strict";\n{own_scripts()}\n}})();\n'


@cache
def leaflet_style() -> str:
    """Return Leaflet's style sheet without the rules that fetch images."""
    return _FETCHING_RULE.sub("", (_LEAFLET / "leaflet.css").read_text(encoding="utf-8"))


def content_hash(text: str) -> str:
    """Return the hash of a script as in a Content-Security-Policy: `sha256-…`."""
    digest = hashlib.sha256(text.encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"
