"""Colours of seasons, the same in the report, in QGIS, in figures and on paper.

In the manner of Okabe and Ito (2008), from vermillion on: they differ in lightness as well as in
hue, so that they stay apart with protanopia, deuteranopia and tritanopia.
"""

SEASON_COLOURS = ("#d55e00", "#4a148c", "#111111", "#4f7fd0", "#7e0000", "#006666")
"""Colours of seasons on a light background, in the order of the scenario's seasons."""

SEASON_COLOURS_ON_DARK = ("#ff8a3d", "#9a7bff", "#ffffff", "#4fc8ff", "#ffe000", "#ff3399")
"""Colours of the seasons on a dark background, one for each of `SEASON_COLOURS`."""


def season_colour(index: int) -> str:
    """Colour, such as "#d55e00", of the scenario's season `index`, from 0 on.

    Where seasons outnumber the colours, these begin anew.
    """
    return SEASON_COLOURS[index % len(SEASON_COLOURS)]
