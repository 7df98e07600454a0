"""How maps and pages look: colours by role, and the scripts and style sheets of pages."""

import base64
import hashlib
import re
from functools import cache
from pathlib import Path

COLOURS = {
    "water": "#eef4f8",
    "land": "#c9a97c",
    "coast": "#8d6c42",
    "nogo": "#e2d3b8",
    "shoal": "#a9c8ae",
    "hazard": "#7a1f1f",
    "soft": "#6b7078",
    "restricted": "#8e24aa",
    "traffic": "#00796b",
    "shut": "#b3261e",
    "haven": "#1b5e20",
    "covered": "#43a047",
    "unsettled": "#ffb300",
    "uncovered": "#e00070",
    "narrow": "#2400ff",
    "adrift": "#b58900",
    "grid": "#c3d0d9",
    "ink": "#26323c",
    "frame": "#5c6b77",
    "halo": "#fdfefe",
    "best": "#c2185b",
    "other": "#47588a",
    "speed0": "#a9c6d9",
    "speed1": "#7dacce",
    "speed2": "#4a8fbe",
    "speed3": "#2070a6",
    "speed4": "#0b4878",
}
"""Role -> colour on a light background; each role has a colour of its own."""

STATES = {
    "covered": COLOURS["covered"],
    "not settled": COLOURS["unsettled"],
    "uncovered": COLOURS["uncovered"],
}
"""State of a stretch of a route that havens may cover -> its colour on a light background."""

DARK = {
    "water": "#14222e",
    "land": "#4a3d2a",
    "coast": "#b39365",
    "nogo": "#3b3a35",
    "shoal": "#3d5a47",
    "hazard": "#ff8a80",
    "soft": "#a9b2bb",
    "restricted": "#d08bf0",
    "traffic": "#5fd0c0",
    "shut": "#ff9488",
    "haven": "#9be7a0",
    "covered": "#4caf50",
    "unsettled": "#ffd54f",
    "uncovered": "#ff4fa3",
    "narrow": "#7c8cff",
    "adrift": "#e6c04d",
    "grid": "#2c3e4c",
    "ink": "#dbe4eb",
    "frame": "#7f909d",
    "halo": "#10171d",
    "best": "#ff6a9e",
    "other": "#9db0e0",
    "speed0": "#2f536b",
    "speed1": "#3b7596",
    "speed2": "#4f9cc2",
    "speed3": "#7cc2e4",
    "speed4": "#bfe6fb",
}
"""Role -> colour on a dark background."""

SEASON_COLOURS = ("#9d3c0e", "#4a148c", "#111111", "#1c52c0", "#651e07", "#6a526d")
"""Colours of cases on a light background, in the scenario's order; of a single case's sides."""

SEASON_COLOURS_ON_DARK = ("#ff8a3d", "#9a7bff", "#ffffff", "#4fc8ff", "#ffe000", "#ff3399")
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
