"""Kinds and file types of a season's figures."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pipeline.formats.shared.result import RunResult


class Kind(StrEnum):
    """What a figure shows of a season; `all` stands for all others."""

    MESH = "mesh"
    CHANNELS = "channels"
    PADDING = "padding"
    ROUTES = "routes"
    ALONG = "along"
    ALL = "all"

    @classmethod
    def selected(cls, kinds: tuple[Kind, ...]) -> tuple[Kind, ...]:
        """Selected kinds, each once and in the order above; all kinds if none is selected."""
        every = tuple(kind for kind in cls if kind is not cls.ALL)
        return tuple(kind for kind in every if kind in (kinds or every) or cls.ALL in kinds)


class Form(StrEnum):
    """File type of a figure."""

    PNG = "png"
    SVG = "svg"
    PDF = "pdf"


def figure(result: RunResult, season: str, kind: Kind) -> Figure:
    """Draw a figure, of any kind but `all`, of a season that has a route."""
    from pipeline.formats.figures.method import channels_figure, mesh_figure
    from pipeline.formats.figures.padding_map import padding_map_figure
    from pipeline.formats.figures.plots import profile_figure
    from pipeline.formats.figures.season_map import overview_figure

    draws = {
        Kind.MESH: lambda: mesh_figure(result, season),
        Kind.CHANNELS: lambda: channels_figure(result, season),
        Kind.PADDING: lambda: padding_map_figure(result, season),
        Kind.ROUTES: lambda: overview_figure(result, [season]),
        Kind.ALONG: lambda: profile_figure(result, result.season_routes(season)[0]),
    }
    return draws[kind]()
