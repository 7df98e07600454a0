"""The method on one scene: the triangles, the channels of the best classes, and the padding.

`make pictures` draws them of the single gyre for the documents.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely
from matplotlib.collections import LineCollection

from pipeline.findings.text import distance, fuel
from pipeline.formats.appearance import COLOURS
from pipeline.formats.figures import chart_map, season_map
from renew.classes.triangulation import Triangulation, triangulate
from renew.kernels.turn_tracks import TurnsBegun
from renew.turns.contingency import fly_turns

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    import renew
    from pipeline.findings.result import RankedRoute, RunResult
    from renew._types import FloatArray

CLASS_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
"""Colours of classes, distinguishable with any colour vision (Okabe and Ito, 2008)."""

_CHANNEL_ALPHA = 0.3

_MAX_WINDOWS = 3
# Gap between two windows.
_GAP_PT = 12.0
# Height of the bar below the windows.
_BAR_PT = 26.0
# Distance of a window's number from its corner.
_CORNER_PT = 9.0
# Half width of a window, as a factor on the padding and turns that it shows.
_WINDOW_FACTOR = 1.4
# Minimum distance between windows, as a share of the route: closer ones would show the same coast.
_MIN_SPACING = 0.1
# Minimum padding of a place other than the tightest, as a share of its distance to the coast.
_MIN_PADDING_SHARE = 0.25
# Number of stations along the route at which the distance to the padding is measured.
_STATIONS = 400
# Maximum number of stations with turns on either side of a place.
_MAX_BESIDE = 4


def _lines(edges: FloatArray, colour: str, width_pt: float, zorder: float) -> LineCollection:
    """Return segments (e, 2, 2) as one artist."""
    return LineCollection(list(edges), colors=colour, linewidths=width_pt, zorder=zorder)


def mesh(result: RunResult, season: str) -> Figure:
    """Draw the triangles of the water, and the constrained edges, which bound the no-go zone."""
    triangles = _triangulation(result, season)
    passing, constrained = _passing_edges(triangles), triangles.constrained_edges
    handles = [
        *season_map.land_handles(result),
        season_map.line_handle("other", 0.8, f"{len(passing):,} passing edges"),
        season_map.line_handle("ink", 1.4, f"{len(constrained):,} constrained edges"),
    ]
    figure, [(axes, sea)] = chart_map.map_figure(result, handles)
    layers = [
        *season_map.chart_layers(axes, result),
        _lines(passing, COLOURS["other"], 0.5, 5),
        _lines(constrained, COLOURS["ink"], 1.1, 6),
    ]
    chart_map.draw_map(axes, sea, result, layers)
    return figure


def channels(result: RunResult, season: str) -> Figure:
    """Draw the best classes, one on each map: its channel of triangles, and its route.

    The best class of each passage of the main island is among them.
    """
    chosen = _best_of_passages(result.case(season).routes, len(CLASS_COLOURS))
    passing = _passing_edges(_triangulation(result, season))
    figure, maps = chart_map.map_figure(
        result,
        titles=[_class_title(ranked) for ranked in chosen],
        columns=min(2, len(chosen)),
    )
    for ranked, colour, (axes, sea) in zip(chosen, CLASS_COLOURS, maps, strict=False):
        channel = ranked.route.channel
        edges = np.stack([channel, np.roll(channel, -1, axis=1)], axis=2)
        layers = [
            *season_map.chart_layers(axes, result),
            _lines(passing, COLOURS["grid"], 0.5, 2),
            chart_map.patch(
                shapely.polygons(channel),
                facecolor=colour,
                edgecolor="none",
                alpha=_CHANNEL_ALPHA,
                zorder=3,
            ),
            _lines(edges.reshape(-1, 2, 2), colour, 0.7, 3.2),
            *season_map.haloed(ranked.route.path, colour),
        ]
        chart_map.draw_island_labels(axes, result)
        chart_map.draw_map(axes, sea, result, layers, [ranked.route.path])
    return figure


def _triangulation(result: RunResult, season: str) -> Triangulation:
    """Triangulate as the planner did, without the overpowered water."""
    plan = result.case(season).plan
    return triangulate(result.water.chart, closed=plan.overpowering if plan else None)


def _passing_edges(triangles: Triangulation) -> FloatArray:
    """Return edges (e, 2, 2) that two triangles share."""
    triangle, corner = np.nonzero(
        triangles.neighbours > np.arange(len(triangles.triangles))[:, None]
    )
    return np.asarray(triangles.vertices[triangles.edge_vertices(triangle, corner)])


def _best_of_passages(routes: tuple[RankedRoute, ...], count: int) -> list[RankedRoute]:
    """Choose the best route of each passage, fill up with the next best, and sort by rank."""
    passages: dict[str, RankedRoute] = {}
    for ranked in routes:
        passages.setdefault(ranked.metrics.main_passage, ranked)
    first = list(passages.values())[:count]
    rest = [ranked for ranked in routes if ranked not in first]
    return sorted([*first, *rest[: count - len(first)]], key=lambda ranked: ranked.rank)


def _class_title(ranked: RankedRoute) -> tuple[str, str]:
    """Return the title of a class's map, and its route's length and fuel."""
    metrics = ranked.metrics
    way = metrics.way or f"class {metrics.rank}"
    return (
        f"{metrics.rank}: {way}",
        f"{distance(metrics.length_m)}, fuel {fuel(metrics.fuel, metrics)}",
    )


def padding(result: RunResult, season: str) -> Figure:
    """Draw the best route's soft no-go zone, and hard-over turns at its tightest places."""
    best = result.case(season).routes[0]
    places = _tightest(best.route)
    handles = [
        *season_map.land_handles(result),
        season_map.soft_handle(),
        season_map.line_handle("best", 2.2, "best route"),
        season_map.line_handle("ink", 1.0, "hard-over turns in the current"),
    ]
    left_pt, right_pt = chart_map.side_room_pt(result)
    width = chart_map.WIDTH_PT - left_pt - right_pt
    side = (width - (_MAX_WINDOWS - 1) * _GAP_PT) / _MAX_WINDOWS
    first = left_pt + (width - len(places) * (side + _GAP_PT) + _GAP_PT) / 2
    below = side + _BAR_PT if places else 0.0
    figure, [(axes, sea)] = chart_map.map_figure(result, handles, below_pt=below)
    layers = [
        *season_map.chart_layers(axes, result),
        season_map.soft_layer(axes, best.route.soft_no_go),
        *season_map.haloed(best.route.path, COLOURS["best"]),
    ]
    chart_map.draw_map(axes, sea, result, layers, [best.route.path])
    map_bottom = axes.get_window_extent().y0 * chart_map.POINTS_PER_INCH / figure.dpi
    for number, place in enumerate(places, start=1):
        left = first + (number - 1) * (side + _GAP_PT)
        window = chart_map.axes_at(
            figure, (left, map_bottom - chart_map.BOTTOM_PT - side, side, side)
        )
        _draw_window(window, result, best, place)
        _draw_number(axes, _point_at(best.route, place.along), number)
        corner = np.array([window.get_xlim()[0], window.get_ylim()[1]])
        _draw_number(
            window, corner + _CORNER_PT * chart_map.point(window) * np.array([1, -1]), number
        )
    return figure


@dataclass(frozen=True)
class _TightPlace:
    """Distance of a place along the path, and minimum half width of its window, planar metres."""

    along: float
    min_half_width: float


def _tightest(route: renew.Route) -> list[_TightPlace]:
    """Return the places where a route is closest to its soft no-go zone, the tightest first."""
    padded = route.padding_used
    if not len(padded):
        return []
    line = shapely.LineString(route.path)
    # Start and goal are left out: harbours lie in the padding.
    along = np.linspace(_MIN_SPACING, 1 - _MIN_SPACING, _STATIONS) * line.length
    edges = shapely.linestrings(padded[:, :4].reshape(-1, 2, 2))
    apart = shapely.distance(shapely.line_interpolate_point(line, along)[:, None], edges)
    margins = apart - padded[:, 4]
    edge, margin = margins.argmin(axis=1), margins.min(axis=1)
    rows = np.arange(_STATIONS)
    tight = padded[edge, 4] >= _MIN_PADDING_SHARE * apart[rows, edge]
    tight[margin.argmin()] = True
    neighbours = np.pad(margin, 1, constant_values=np.inf)
    minima = np.flatnonzero(tight & (margin <= neighbours[:-2]) & (margin <= neighbours[2:]))
    chosen: list[int] = []
    for station in minima[np.argsort(margin[minima], kind="stable")].tolist():
        if len(chosen) < _MAX_WINDOWS and all(
            abs(along[station] - along[other]) >= _MIN_SPACING * line.length for other in chosen
        ):
            chosen.append(station)
    return [
        _TightPlace(
            float(along[i]), _WINDOW_FACTOR * float(max(apart[i, edge[i]], padded[edge[i], 4]))
        )
        for i in chosen
    ]


def _draw_window(axes: Axes, result: RunResult, ranked: RankedRoute, place: _TightPlace) -> None:
    """Draw the surroundings of a tight place, and hard-over turns from there and nearby."""
    route = ranked.route
    middle = _point_at(route, place.along)
    (turn,) = _turns(ranked, np.array([place.along]))
    reach = float(np.linalg.norm(turn - middle, axis=-1).max())
    half = max(place.min_half_width, _WINDOW_FACTOR * reach)
    low, high = middle - half, middle + half
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    box = shapely.box(*low, *high)
    sea = chart_map.patch(box, facecolor=COLOURS["water"], edgecolor="none", zorder=0)
    axes.add_artist(sea)
    # Turns are one reach apart, so that they don't overlap much.
    count = min(_MAX_BESIDE, int(half / reach))
    stations = place.along + reach * np.arange(-count, count + 1, dtype=float)
    turns = _turns(ranked, stations[(stations > 0) & (stations < route.length)])
    layers = [
        *season_map.chart_layers(axes, result),
        season_map.soft_layer(axes, route.soft_no_go),
        *season_map.haloed(route.path, COLOURS["best"]),
        _lines(turns.reshape(-1, *turns.shape[2:]), COLOURS["ink"], 0.8, 7),
    ]
    chart_map.add_layers(axes, layers, sea)
    frame = chart_map.patch(
        box, facecolor="none", edgecolor=COLOURS["frame"], linewidth=0.9, zorder=9
    )
    axes.add_artist(frame)
    frame.set_clip_on(False)
    chart_map.draw_scale_bar(axes, result.water.projection, drop_pt=8)


def _point_at(route: renew.Route, along: float) -> FloatArray:
    """Return the point (2,) at a distance along a route, planar m; beyond an end, that end."""
    line = shapely.LineString(route.path)
    # Shapely counts a negative distance from the goal.
    return np.asarray(shapely.get_coordinates(line.interpolate(max(along, 0.0)))[0])


def _turns(ranked: RankedRoute, along: FloatArray) -> FloatArray:
    """Return tracks (n, 2, steps, 2) of turns to port and starboard at distances (n,) run."""
    points = np.stack([_point_at(ranked.route, at) for at in along])
    step = ranked.route.length / _STATIONS / 2
    ahead = np.stack(
        [_point_at(ranked.route, at + step) - _point_at(ranked.route, at - step) for at in along]
    )
    passed = np.cumsum(np.linalg.norm(np.diff(ranked.route.path, axis=0), axis=1))
    leg = np.minimum(np.searchsorted(passed, along, "right"), len(passed) - 1)
    begun = TurnsBegun(
        points,
        np.arctan2(ahead[:, 1], ahead[:, 0]),
        np.interp(along, np.append(0.0, passed), ranked.route.times),
        ranked.route.speeds[leg],
    )
    case = ranked.case.case
    return fly_turns(begun, case.current, case.vessel, np.zeros((1, 1, 2)))


def _draw_number(axes: Axes, position: FloatArray, number: int) -> None:
    """Write a window's number in a circle."""
    x, y = position
    axes.annotate(
        str(number),
        (float(x), float(y)),
        ha="center",
        va="center",
        fontsize=7.5,
        fontweight="bold",
        color=COLOURS["ink"],
        bbox={
            "boxstyle": "circle,pad=0.18",
            "facecolor": COLOURS["halo"],
            "edgecolor": COLOURS["ink"],
            "linewidth": 0.8,
        },
        zorder=9.5,
    )
