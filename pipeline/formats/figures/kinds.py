"""Kinds, widths and file types of a case's figures."""

from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pipeline.findings.result import RunCase


class Kind(StrEnum):
    """What a figure shows of a case: its map, or what the best route meets along the way."""

    ROUTES = "routes"
    ALONG = "along"


class Width(StrEnum):
    """Width of a figure: a journal's column, a journal's page, or a width that suits a screen."""

    COLUMN = "column"
    PAGE = "page"
    SCREEN = "screen"

    @property
    def points(self) -> float | None:
        """The width in points, 72 to an inch; None if each map has its own width."""
        inches = {Width.COLUMN: 3.3, Width.PAGE: 7.0}.get(self)
        return None if inches is None else 72 * inches


class Form(StrEnum):
    """File type of a figure."""

    PNG = "png"
    SVG = "svg"
    PDF = "pdf"


def figure(case: "RunCase", kind: Kind, width: Width = Width.SCREEN) -> "Figure":
    """Draw a figure of a case that has a route."""
    from pipeline.formats.figures.chart_map import in_season_colour
    from pipeline.formats.figures.plots import profile_figure
    from pipeline.formats.figures.season_map import overview_figure
    from pipeline.formats.palette import season_colour

    if kind is Kind.ROUTES:
        return overview_figure([case], width.points)
    drawn = profile_figure(case.routes[0], width.points)
    in_season_colour(drawn, season_colour(case.number))
    return drawn
