"""Hard-over turns at a route's tightest place under noise, and the distribution of their reach.

The padding of an edge is a quantile of the reaches of turns in draws of the current (RENEW, AAAI
2026). The figures show the draws that set it.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import renew
from pipeline._types import FloatArray
from pipeline.formats.figures import plots
from pipeline.formats.figures.artists import PLAIN_PT, POINTS_PER_INCH, SMALL_PT
from pipeline.formats.figures.chart_map import WIDTH_PT
from pipeline.formats.shared.palette import COLOURS
from pipeline.formats.shared.result import RankedRoute, RunResult
from pipeline.formats.shared.text import at_most_percent, clearance, distance
from renew.voyage.fuel import speeds_along

# Number of drawn turns to either side, and of points of each.
_TURNS, _TRACK_POINTS = 60, 181
_HEIGHT_SHARE, _MIN_HEIGHT_PT = 0.62, 190.0
# Share of a turn by which the picture reaches beyond the turns and the edge.
_MARGIN = 0.15

_HISTOGRAM_PT, _ROW_PT = 170.0, 14.0
_BINS = 30
# Greatest distance to the coast that is drawn, as a multiple of the greatest reach; greater
# distances are only written.
_MAX_GAP_REACHES = 2.0
# A mark further right than this share of the axis has its text on the left.
_TEXT_LEFT_FROM = 0.4
# Length of an axis, as a factor on the greatest value.
_AXIS_FACTOR = 1.06


class NothingToDrawError(Exception):
    """A season has nothing that the figure shows; the message says why."""


def turns_figure(result: RunResult, season: str, width_pt: float | None = None) -> Figure:
    """Draw turns to both sides in draws of the current's spread, with the padding of the edge."""
    found = _tightest(result, result.season_routes(season)[0])
    scale = result.scene.projection.scale
    vessel = _at_place(result, season, found)
    tracks = turn_tracks(found, vessel)[:, :: max(1, len(found.headings) // _TURNS)]
    tracks = tracks.reshape(-1, *tracks.shape[2:])
    unit, unit_m = plots.distance_unit(scale * float(np.ptp(tracks.reshape(-1, 2), axis=0).max()))
    # Along the edge to the right, and away from it upwards.
    along = found.edge[1] - found.edge[0]
    along = along / np.linalg.norm(along)
    away = np.array([-along[1], along[0]])
    if (found.point - found.edge[0]) @ away < 0:
        along, away = -along, -away
    local = tracks @ np.stack([along, away]).T * scale / unit_m
    figure, axes = _axes(width_pt)
    for track in local:
        axes.plot(*track.T, color=COLOURS["other"], linewidth=0.5, alpha=0.35, zorder=2)
    gap, padding = found.gap * scale / unit_m, found.padding * scale / unit_m
    axes.axhline(-gap, color=COLOURS["coast"], linewidth=2.2, zorder=3)
    axes.axhspan(-gap, padding - gap, color=COLOURS["soft"], alpha=0.3, linewidth=0, zorder=1)
    axes.plot([0], [0], "o", color=COLOURS["best"], markersize=5, zorder=4)
    low, high = local.reshape(-1, 2).min(axis=0), local.reshape(-1, 2).max(axis=0)
    room = _MARGIN * float((high - low).max())
    # An offing may be many times as wide as the turns, which must stay visible.
    bottom = max(min(low[1], -gap) - room, 2 * low[1] - high[1])
    # The limits are widened later to the figure's shape.
    axes.autoscale_view()
    axes.set_xlim(low[0] - room, high[0] + room, auto=True)
    axes.set_ylim(bottom, high[1] + room, auto=True)
    axes.set_aspect("equal", adjustable="datalim")
    no_go = f"no-go zone,\n{clearance(found.gap * scale)} off"
    # Beside the plot, where no turn crosses them.
    for text, level, side in (
        (no_go, -gap, "top")
        if -gap > bottom
        else (f"\N{DOWNWARDS ARROW} {no_go}", bottom, "bottom"),
        (f"soft no-go zone\n{clearance(found.padding * scale)}", padding - gap, "bottom"),
    ):
        axes.annotate(
            text,
            (1.0, level),
            xycoords=("axes fraction", "data"),
            xytext=(4, 0),
            textcoords="offset points",
            va=side,
            fontsize=SMALL_PT,
            color=COLOURS["ink"],
        )
    axes.set_xlabel(f"along the no-go zone's edge, {unit}", fontsize=SMALL_PT)
    axes.set_ylabel(f"away from it, {unit}", fontsize=SMALL_PT)
    _title(axes, "Hard-over turns at the tightest place, in draws of the current")
    return figure


def turn_tracks(found: renew.Tightest, vessel: renew.Vessel) -> FloatArray:
    """Return full turns (2, n, points, 2) to port and starboard from the origin, m, in all draws.

    Closed form: a circle through the water, carried by the current.
    """
    time = np.linspace(0.0, vessel.turn_period, _TRACK_POINTS)
    begin = found.headings[:, None]
    carried = found.currents[:, None] * time[:, None]
    tracks = []
    for side in (1, -1):
        heading = begin + side * vessel.turn_rate * time
        east, north = np.sin(heading) - np.sin(begin), np.cos(begin) - np.cos(heading)
        circle = vessel.turning_radius * side * np.stack([east, north], axis=-1)
        tracks.append(circle + carried)
    return np.stack(tracks)


def reach_figure(result: RunResult, season: str, width_pt: float | None = None) -> Figure:
    """Draw the distribution of the reach of turns at the tightest place, and its quantile."""
    ranked = result.season_routes(season)[0]
    found = _tightest(result, ranked)
    scale, risk = result.scene.projection.scale, result.scenario.planner.risk
    reach_m = np.asarray(found.reaches, dtype=float) * scale
    unit, unit_m = plots.distance_unit(float(reach_m.max()))
    figure, axes = _axes(width_pt)
    draw_reaches(axes, [("", reach_m / unit_m, COLOURS["other"])], risk)
    for value, name, colour in (
        (float(np.quantile(reach_m, 1 - risk)), "quantile", "other"),
        (found.turns * scale, "padding for turns", "soft"),
        (found.gap * scale, "route to no-go zone", "best"),
    ):
        axes.axvline(
            value / unit_m,
            color=COLOURS[colour],
            linewidth=1.6,
            label=f"{name} {distance(value)}",
        )
    axes.set_xlabel(f"reach towards the no-go zone, {unit}", fontsize=SMALL_PT)
    axes.set_ylabel("share of drawn turns", fontsize=SMALL_PT)
    columns = 3 if figure.get_figwidth() * POINTS_PER_INCH > WIDTH_PT else 1
    figure.legend(fontsize=7, loc="outside lower center", ncols=columns, frameon=False)
    _title(axes, f"Reach of hard-over turns: {100 * (1 - risk):g} % stay within the quantile")
    return figure


def draw_reaches(
    axes: Axes, samples: Sequence[tuple[str, FloatArray, str]], risk: float
) -> list[float]:
    """Draw the distribution of each sample (label, reaches (n,), colour); return the quantiles."""
    quantiles = []
    for label, reaches, colour in samples:
        ordered = np.sort(reaches)
        shares = np.arange(1, len(ordered) + 1) / len(ordered)
        axes.plot(ordered, shares, color=colour, label=label or "_reaches")
        quantiles.append(float(np.quantile(ordered, 1 - risk)))
    axes.axhline(1 - risk, color=COLOURS["frame"], linewidth=0.8, linestyle=plots.DASHES)
    axes.set_ylim(0, 1.05)
    return quantiles


def _tightest(result: RunResult, ranked: RankedRoute) -> renew.Tightest:
    """Return the tightest place of a route; an error if it has no padding."""
    found = tightest_place(result, ranked)
    if found is None:
        raise NothingToDrawError(
            "no edge beside its best route is padded, so there is no tightest place at which to "
            "turn (planner.padding = 'adaptive' pads)"
        )
    return found


def _at_place(result: RunResult, season: str, found: renew.Tightest) -> renew.Vessel:
    """Return the vessel at the speed at which the season's best route passes its tightest place."""
    route = result.season_routes(season)[0].route
    (speed,) = speeds_along(found.point[None], np.asarray(route.path, dtype=float), route.speeds)
    return replace(result.scene.vessel, speed=float(speed))


def _axes(width_pt: float | None) -> tuple[Figure, Axes]:
    """Return a figure with one plot."""
    width = width_pt or WIDTH_PT
    height = max(_MIN_HEIGHT_PT, _HEIGHT_SHARE * width)
    figure = Figure(
        figsize=(width / POINTS_PER_INCH, height / POINTS_PER_INCH),
        facecolor=COLOURS["halo"],
        layout="constrained",
    )
    axes = figure.subplots()
    axes.tick_params(labelsize=SMALL_PT, labelcolor=COLOURS["ink"], color=COLOURS["frame"])
    axes.grid(color=COLOURS["grid"], linewidth=0.5)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_color(COLOURS["frame"])
    return figure, axes


def _title(axes: Axes, text: str) -> None:
    """Write a plot's title, in two lines where it would be wider than the figure."""
    axes.set_title(
        text, fontsize=PLAIN_PT, fontweight="bold", color=COLOURS["ink"], loc="left", wrap=True
    )


def tightest_place(result: RunResult, ranked: RankedRoute) -> renew.Tightest | None:
    """Return the place where turns have the least room; None without padding."""
    return renew.tightest(
        ranked.route,
        result.scene.currents[ranked.season],
        result.scene.vessel_in(ranked.season),
        seed=result.scenario.planner.seed,
    )


def padding_figure(tightest: renew.Tightest, scale: float) -> Figure:
    """Return a histogram of turns' reaches, with the padding and the distance to the coast.

    `scale` is true metres to a planar metre.
    """
    reach_m = np.asarray(tightest.reaches, dtype=float) * scale
    padding_m, gap_m = tightest.turns * scale, tightest.gap * scale
    beyond = at_most_percent(float((reach_m > padding_m).mean()))
    marks = [
        _Mark(float(np.median(reach_m)), "median", "ink"),
        _Mark(padding_m, "padding for turns", "other", f", exceeded by {beyond}"),
        _Mark(gap_m, "route to no-go zone", "best"),
    ]
    furthest_m = max(float(reach_m.max()), padding_m)
    shown_gap_m = gap_m if gap_m <= _MAX_GAP_REACHES * furthest_m else 0.0
    end_m = _AXIS_FACTOR * max(furthest_m, shown_gap_m)
    unit, unit_m = plots.distance_unit(end_m)

    figure, (axes,) = plots.plot_panels(1, _HISTOGRAM_PT, 0.0)
    counts, edges = np.histogram(reach_m / unit_m, bins=_BINS)
    shares = 100 * counts / reach_m.size
    axes.stairs(shares, edges, fill=True, color=COLOURS["speed1"], zorder=2)
    over = np.maximum(edges, padding_m / unit_m)
    axes.stairs(shares, over, fill=True, color=COLOURS["other"], zorder=2.5)
    # Above the bars, each mark has a row for its text.
    rows = len(marks) * _ROW_PT / _HISTOGRAM_PT
    axes.set_xlim(0, end_m / unit_m)
    axes.set_ylim(0, _AXIS_FACTOR * shares.max() / (1 - rows))
    # The nearest mark is the lowest, so that text left of a line crosses no other line.
    for row, mark in enumerate(sorted(marks, key=lambda mark: -mark.value_m)):
        _draw_mark(axes, mark, unit_m, 1 - (row + 0.5) * _ROW_PT / _HISTOGRAM_PT)
    plots.plot_title(axes, "How far hard-over turns reach", "% of turns")
    plots.plot_x_label(axes, f"reach from the tightest place, {unit}")
    return figure


class _Mark(NamedTuple):
    """A distance (true metres) marked in a histogram: name, colour's role, and a remark."""

    value_m: float
    name: str
    role: str
    remark: str = ""


def _draw_mark(axes: Axes, mark: _Mark, unit_m: float, height: float) -> None:
    """Draw a mark as a line up to its text, at a share of the panel's height."""
    x, (_, end) = mark.value_m / unit_m, axes.get_xlim()
    text = f"{mark.name} {clearance(mark.value_m)}{mark.remark}"
    if x <= end:
        axes.axvline(x, 0, height, color=COLOURS[mark.role], linewidth=1.8, zorder=3)
    else:
        text += " \N{RIGHTWARDS ARROW}"
    plots.plot_text(
        axes,
        text,
        (min(x, end), height),
        on_left=x > _TEXT_LEFT_FROM * end,
        coordinates=axes.get_xaxis_transform(),
    )
