"""How far hard-over turns reach at a route's tightest place: a histogram, with padding and gap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

import renew
from pipeline.formats.figures.page_svg import page_svg
from pipeline.formats.figures.palette import COLOURS
from pipeline.formats.figures.plots import (
    distance_unit,
    plot_panels,
    plot_text,
    plot_title,
    plot_x_label,
)
from pipeline.formats.shared.result import RankedRoute, RunResult
from pipeline.formats.shared.text import distance, percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_HISTOGRAM_PT, _ROW_PT = 170.0, 14.0
_BINS = 30
# Greatest distance to the coast that is drawn, as a multiple of the greatest reach; a greater one
# is only written.
_MAX_GAP_REACHES = 2.0
# Position of a line, as a share of the axis, from which its text is on the left.
_TEXT_LEFT_FROM = 0.4
# Length of an axis, as a factor on the greatest value.
_AXIS_FACTOR = 1.06


def padding_svg(
    result: RunResult, ranked: RankedRoute, *, identity: str, label: str
) -> Markup | str:
    """Plot how far hard-over turns reach at the route's tightest place; "" without padding."""
    found = tightest_place(result, ranked)
    if found is None:
        return ""
    figure = padding_figure(found, result.scene.projection.scale)
    return page_svg(figure, identity=identity, label=label)


def tightest_place(result: RunResult, ranked: RankedRoute) -> renew.Tightest | None:
    """The place where a route leaves its turns the least room; None without padding."""
    return renew.tightest(
        ranked.route,
        result.scene.currents[ranked.season],
        result.scene.vessel_in(ranked.season),
        seed=result.scenario.planner.seed,
    )


def padding_figure(tightest: renew.Tightest, scale: float) -> Figure:
    """Histogram of the reaches of hard-over turns, with the padding and the distance to the coast.

    `scale` is true metres to a planar metre.
    """
    reach_m = np.asarray(tightest.reaches, dtype=float) * scale
    padding_m, gap_m = tightest.padding * scale, tightest.gap * scale
    beyond = float((reach_m > padding_m).mean())
    marks = [
        _Mark(float(np.median(reach_m)), "median", "ink"),
        _Mark(padding_m, "padding", "other", f", exceeded by {percent(beyond)}"),
        _Mark(gap_m, "route to no-go zone", "best"),
    ]
    furthest_m = max(float(reach_m.max()), padding_m)
    shown_gap_m = gap_m if gap_m <= _MAX_GAP_REACHES * furthest_m else 0.0
    end_m = _AXIS_FACTOR * max(furthest_m, shown_gap_m)
    unit, unit_m = distance_unit(end_m)

    figure, (axes,) = plot_panels(1, _HISTOGRAM_PT, 0.0)
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
    plot_title(axes, "How far hard-over turns reach", "% of turns")
    plot_x_label(axes, f"reach from the tightest place, {unit}")
    return figure


@dataclass(frozen=True)
class _Mark:
    """A distance (true metres) marked in a histogram: name, colour's role, and a remark."""

    value_m: float
    name: str
    role: str
    remark: str = ""


def _draw_mark(axes: Axes, mark: _Mark, unit_m: float, height: float) -> None:
    """Draw a mark as a line up to its text, at a share of the panel's height."""
    x, (_, end) = mark.value_m / unit_m, axes.get_xlim()
    text = f"{mark.name} {distance(mark.value_m)}{mark.remark}"
    if x <= end:
        axes.axvline(x, 0, height, color=COLOURS[mark.role], linewidth=1.8, zorder=3)
    else:
        text += " \N{RIGHTWARDS ARROW}"
    plot_text(
        axes,
        text,
        (min(x, end), height),
        on_left=x > _TEXT_LEFT_FROM * end,
        coordinates=axes.get_xaxis_transform(),
    )
