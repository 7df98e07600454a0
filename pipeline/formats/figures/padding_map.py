"""The padding of one season as in the paper: the soft no-go zone around land, and its turns.

Beside the whole map stand windows on the route's tightest places, since a turning circle is but a
speck on a map of a voyage.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.formats.figures.chart_map import (
    BOTTOM_PT,
    LEFT_PT,
    RIGHT_PT,
    SOFT_ALPHA,
    WIDTH_PT,
    add_layers,
    draw_ends,
    draw_frame,
    land_handles,
    land_layers,
    line_handle,
    map_figure,
    no_go_layers,
    soft_layer,
)
from pipeline.formats.figures.palette import COLOURS
from pipeline.formats.figures.sheet import (
    POINTS_PER_INCH,
    axes_at,
    draw_scale_bar,
    lines,
    patch,
    point,
    stroke,
)

if TYPE_CHECKING:
    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    import renew
    from pipeline.formats.shared.result import RankedRoute, RunResult

    FloatArray = npt.NDArray[np.float64]

_WINDOWS = 3
_GAP_PT, _BAR_PT, _CORNER_PT = 12.0, 26.0, 9.0
# A window reaches so many times as far as the padding and the turns it shows.
_AROUND = 1.4
# Tightest places lie apart by this share of the route, or they would show the same coast.
_APART = 0.1
# After the tightest, only places are shown whose padding is no less than this share of the gap.
_TIGHT = 0.25
_STATIONS = 400
# Turns are shown from the place itself and so many to either side.
_MOST_BESIDE = 4


def padding_map_figure(result: RunResult, season: str) -> Figure:
    """Draw the best route's soft no-go zone, and hard-over turns at its tightest places."""
    from matplotlib.patches import Patch

    best = result.season_routes(season)[0]
    places = _tightest(best.route)
    handles = [
        *land_handles(result),
        Patch(facecolor=COLOURS["soft"], alpha=SOFT_ALPHA, label="soft no-go: the padding"),
        line_handle("best", 2.2, "best route"),
        line_handle("ink", 1.0, "hard-over turns in the current"),
    ]
    width = WIDTH_PT - LEFT_PT - RIGHT_PT
    side = (width - (_WINDOWS - 1) * _GAP_PT) / _WINDOWS
    first = LEFT_PT + (width - len(places) * (side + _GAP_PT) + _GAP_PT) / 2
    below = side + _BAR_PT if places else 0.0
    figure, [(axes, sea)] = map_figure(result, handles, below_pt=below)
    layers = [
        *no_go_layers(result),
        *land_layers(axes, result),
        soft_layer(axes, best.route.soft_no_go),
        stroke(best.route.path, COLOURS["halo"], 3.2, 6),
        stroke(best.route.path, COLOURS["best"], 1.8, 7),
    ]
    add_layers(axes, layers, sea)
    draw_ends(axes, result, [best.route.path])
    draw_frame(axes, result, sea)
    map_bottom = axes.get_window_extent().y0 * POINTS_PER_INCH / figure.dpi
    for number, place in enumerate(places, start=1):
        left = first + (number - 1) * (side + _GAP_PT)
        window = axes_at(figure, (left, map_bottom - BOTTOM_PT - side, side, side))
        _draw_window(window, result, best, place)
        _number(axes, _on(best.route, place.along), number)
        corner = np.array([window.get_xlim()[0], window.get_ylim()[1]])
        _number(window, corner + _CORNER_PT * point(window) * np.array([1, -1]), number)
    return figure


@dataclass(frozen=True)
class _Place:
    """A place by its distance along the path, and how far its window reaches at least (m)."""

    along: float
    reach: float


def _tightest(route: renew.Route) -> list[_Place]:
    """Places where a route comes nearest to the edge of its soft no-go zone, the tightest first."""
    padded = route.padding_used
    if not len(padded):
        return []
    line = shapely.LineString(route.path)
    # At the ends there is no choice: harbours lie in the padding.
    along = np.linspace(_APART, 1 - _APART, _STATIONS) * line.length
    edges = shapely.linestrings(padded[:, :4].reshape(-1, 2, 2))
    apart = shapely.distance(shapely.line_interpolate_point(line, along)[:, None], edges)
    room = apart - padded[:, 4]
    edge, least = room.argmin(axis=1), room.min(axis=1)
    rows = np.arange(_STATIONS)
    tight = padded[edge, 4] >= _TIGHT * apart[rows, edge]
    tight[least.argmin()] = True
    beside = np.pad(least, 1, constant_values=np.inf)
    narrow = np.flatnonzero(tight & (least <= beside[:-2]) & (least <= beside[2:]))
    chosen: list[int] = []
    for station in narrow[np.argsort(least[narrow], kind="stable")].tolist():
        if len(chosen) < _WINDOWS and all(
            abs(along[station] - along[other]) >= _APART * line.length for other in chosen
        ):
            chosen.append(station)
    return [
        _Place(float(along[i]), _AROUND * float(max(apart[i, edge[i]], padded[edge[i], 4])))
        for i in chosen
    ]


def _draw_window(axes: Axes, result: RunResult, ranked: RankedRoute, place: _Place) -> None:
    """Draw the surroundings of a tight place, and the turns from there and beside it."""
    scene, route = result.scene, ranked.route
    middle = _on(route, place.along)
    (turn,) = _turns(result, ranked, np.array([place.along]))
    carried = float(np.linalg.norm(turn - middle, axis=-1).max())
    half = max(place.reach, _AROUND * carried)
    low, high = middle - half, middle + half
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    box = shapely.box(*low, *high)
    sea = patch(box, facecolor=COLOURS["water"], edgecolor="none", zorder=0)
    axes.add_patch(sea)
    # So far apart that they don't tangle.
    count = min(_MOST_BESIDE, int(half / carried))
    stations = place.along + carried * np.arange(-count, count + 1, dtype=float)
    turns = _turns(result, ranked, stations[(stations > 0) & (stations < route.length)])
    layers = [
        *no_go_layers(result, box),
        *land_layers(axes, result, box),
        soft_layer(axes, shapely.intersection(route.soft_no_go, box)),
        stroke(route.path, COLOURS["halo"], 3.2, 6),
        stroke(route.path, COLOURS["best"], 1.8, 6.1),
        lines(turns.reshape(-1, *turns.shape[2:]), COLOURS["ink"], 0.8, 7),
    ]
    add_layers(axes, layers, sea)
    frame = patch(box, facecolor="none", edgecolor=COLOURS["frame"], linewidth=0.9, zorder=9)
    axes.add_patch(frame)
    frame.set_clip_on(False)
    draw_scale_bar(axes, scene.projection, drop_pt=8)


def _on(route: renew.Route, along: float) -> FloatArray:
    """Point (2,) of a route so many metres from its start, between its ends."""
    line = shapely.LineString(route.path)
    # A negative distance would count from the goal.
    return np.asarray(shapely.get_coordinates(line.interpolate(max(along, 0.0)))[0])


def _turns(result: RunResult, ranked: RankedRoute, along: FloatArray) -> FloatArray:
    """Tracks (n, 2, steps, 2) of turns to port and to starboard, begun so far along a route (m)."""
    from renew.turns.contingency import fly_turns

    points = np.stack([_on(ranked.route, place) for place in along])
    step = ranked.route.length / _STATIONS / 2
    ahead = np.stack(
        [_on(ranked.route, place + step) - _on(ranked.route, place - step) for place in along]
    )
    return fly_turns(
        points,
        np.arctan2(ahead[:, 1], ahead[:, 0]),
        result.scene.currents[ranked.season],
        result.scene.vessel,
        np.zeros((1, 1, 2)),
    )


def _number(axes: Axes, place: FloatArray, number: int) -> None:
    """Write a window's number in a circle."""
    x, y = place
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
