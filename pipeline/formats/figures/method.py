"""Figures of the method, as in the paper: the mesh of triangles, and the channels of classes.

RENEW: Risk- and Energy-Aware Navigation in Dynamic Waterways (AAAI 2026).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline._types import FloatArray
from pipeline.formats.figures.artists import draw_island_labels, lines, patch
from pipeline.formats.figures.maps.chart_map import draw_map, map_figure
from pipeline.formats.figures.maps.layers import chart_layers, haloed, land_handles, line_handle
from pipeline.formats.figures.palette import CLASS_COLOURS, COLOURS
from pipeline.formats.shared.result import RankedRoute, RunResult
from pipeline.formats.shared.text import distance, fuel
from renew.classes.triangulation import Triangulation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CHANNEL_ALPHA = 0.3


def mesh_figure(result: RunResult, season: str, width_pt: float | None = None) -> Figure:
    """Draw the triangles of the water, and the constrained edges, which bound the no-go zone."""
    mesh = _triangulation(result, season)
    passing, constrained = _passing_edges(mesh), mesh.constrained_edges
    handles = [
        *land_handles(result),
        line_handle("other", 0.8, f"{len(passing):,} passing edges"),
        line_handle("ink", 1.4, f"{len(constrained):,} constrained edges"),
    ]
    figure, [(axes, sea)] = map_figure(result, handles, width_pt=width_pt)
    layers = [
        *chart_layers(axes, result),
        lines(passing, COLOURS["other"], 0.5, 5),
        lines(constrained, COLOURS["ink"], 1.1, 6),
    ]
    draw_map(axes, sea, result, layers)
    return figure


def channels_figure(result: RunResult, season: str, width_pt: float | None = None) -> Figure:
    """Draw the best classes, one on each map: its channel of triangles, and its route.

    For every passage of the main island, the best class that takes it is among them.
    """
    chosen = _best_of_passages(result.season_routes(season), len(CLASS_COLOURS))
    passing = _passing_edges(_triangulation(result, season))
    figure, maps = map_figure(
        result,
        titles=[_class_title(ranked) for ranked in chosen],
        columns=min(2, len(chosen)),
        width_pt=width_pt,
    )
    for ranked, colour, (axes, sea) in zip(chosen, CLASS_COLOURS, maps, strict=False):
        channel = ranked.route.channel
        layers = [
            *chart_layers(axes, result),
            lines(passing, COLOURS["grid"], 0.5, 2),
            patch(
                shapely.polygons(channel),
                facecolor=colour,
                edgecolor="none",
                alpha=_CHANNEL_ALPHA,
                zorder=3,
            ),
            lines(_edges(channel), colour, 0.7, 3.2),
            *haloed(ranked.route.path, colour),
        ]
        draw_island_labels(axes, result)
        draw_map(axes, sea, result, layers, [ranked.route.path])
    return figure


def _triangulation(result: RunResult, season: str) -> Triangulation:
    """Triangulate as the planner did, without the overpowered water."""
    from renew.classes.triangulation import triangulate

    plan = next((entry.plan for entry in result.plans if entry.season == season), None)
    return triangulate(result.scene.chart, closed=plan.overpowering if plan else None)


def _passing_edges(mesh: Triangulation) -> FloatArray:
    """Edges (e, 2, 2) that two triangles share."""
    triangle, corner = np.nonzero(mesh.neighbours > np.arange(len(mesh.triangles))[:, None])
    return np.asarray(mesh.vertices[mesh.edge_vertices(triangle, corner)])


def _edges(triangles: FloatArray) -> FloatArray:
    """All edges (3 t, 2, 2) of triangles (t, 3, 2)."""
    return np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2, 2)


def _best_of_passages(routes: tuple[RankedRoute, ...], count: int) -> list[RankedRoute]:
    """Choose the best route of each passage, fill up with the next best, and sort by rank."""
    passages: dict[str, RankedRoute] = {}
    for ranked in routes:
        passages.setdefault(ranked.metrics.main_passage, ranked)
    first = list(passages.values())[:count]
    rest = [ranked for ranked in routes if ranked not in first]
    return sorted([*first, *rest[: count - len(first)]], key=lambda ranked: ranked.rank)


def _class_title(ranked: RankedRoute) -> tuple[str, str]:
    """Title of a class's map, and its route's length and fuel."""
    metrics = ranked.metrics
    way = metrics.way or f"class {metrics.rank}"
    return f"{metrics.rank}: {way}", f"{distance(metrics.length_m)}, fuel {fuel(metrics.fuel)}"
