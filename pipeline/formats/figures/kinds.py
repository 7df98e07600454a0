"""Kinds, widths and file types of a case's figures."""

from enum import StrEnum
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pipeline.findings.result import RunCase


class Kind(StrEnum):
    """What a figure shows of a case: its map, or what the best route meets along the way."""

    ROUTES = "routes"
    ALONG = "along"


Width: TypeAlias = Literal["column", "page", "screen"]
"""Width of a figure: a journal's column, a journal's page, or a width that suits a screen."""

Form: TypeAlias = Literal["png", "svg", "pdf"]
"""File type of a figure."""

WIDTHS_PT: dict[Width, float] = {"column": 72 * 3.3, "page": 72 * 7.0}
"""Widths in points, 72 to an inch; on a screen each map has its own width."""


def figure(case: "RunCase", kind: Kind, width: Width = "screen") -> "Figure":
    """Draw a figure of a case that has a route."""
    from pipeline.formats.figures.chart_map import in_season_colour
    from pipeline.formats.figures.plots import profile_figure
    from pipeline.formats.figures.season_map import overview_figure
    from pipeline.formats.palette import season_colour

    width_pt = WIDTHS_PT.get(width)
    if kind is Kind.ROUTES:
        return overview_figure([case], width_pt)
    drawn = profile_figure(case.routes[0], width_pt)
    in_season_colour(drawn, season_colour(case.number))
    return drawn
