"""Kinds, widths and file types of a season's figures."""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pipeline.formats.figures.method import Variant
    from pipeline.formats.shared.result import RunResult


class Kind(StrEnum):
    """What a figure shows of a season; `all` stands for all others."""

    MESH = "mesh"
    CHANNELS = "channels"
    PADDING = "padding"
    ROUTES = "routes"
    ALONG = "along"
    TURNS = "turns"
    REACH = "reach"
    CLASSES = "classes"
    PADDINGS = "paddings"
    ALL = "all"

    @classmethod
    def selected(cls, kinds: "tuple[Kind, ...]") -> "tuple[Kind, ...]":
        """Return the selected kinds, each once, in the order above; all if none is selected."""
        every = tuple(kind for kind in cls if kind is not cls.ALL)
        return tuple(kind for kind in every if kind in (kinds or every) or cls.ALL in kinds)


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


def figure(
    result: "RunResult",
    season: str,
    kind: Kind,
    width: Width = Width.SCREEN,
    variants: "Mapping[Kind, Sequence[Variant]] | None" = None,
) -> "Figure":
    """Draw a figure, of any kind but `all`, of a season that has a route.

    `variants` are the runs with other options that `classes` and `paddings` compare.
    """
    from pipeline.formats.figures.artists import in_season_colour
    from pipeline.formats.figures.method import (
        channels_figure,
        mesh_figure,
        padding_map_figure,
        variants_figure,
    )
    from pipeline.formats.figures.plots import profile_figure
    from pipeline.formats.figures.season_map import overview_figure
    from pipeline.formats.figures.turning import reach_figure, turns_figure
    from pipeline.formats.shared.palette import season_colour

    size = width.points

    def compared() -> "Figure":
        chosen = (variants or {})[kind]
        padded = kind is Kind.PADDINGS
        return variants_figure(result, season, chosen, with_padding=padded, width_pt=size)

    draws = {
        Kind.MESH: lambda: mesh_figure(result, season, size),
        Kind.CHANNELS: lambda: channels_figure(result, season, size),
        Kind.PADDING: lambda: padding_map_figure(result, season, size),
        Kind.ROUTES: lambda: overview_figure(result, [season], size),
        Kind.ALONG: lambda: profile_figure(result, result.season_routes(season)[0], size),
        Kind.TURNS: lambda: turns_figure(result, season, size),
        Kind.REACH: lambda: reach_figure(result, season, size),
        Kind.CLASSES: compared,
        Kind.PADDINGS: compared,
    }
    drawn = draws[kind]()
    in_season_colour(drawn, season_colour(result.season_index(season)))
    return drawn
