"""How far hard-over turns at a route's tightest place reach, in draws of the current.

The padding of an edge is a quantile of these reaches (RENEW, AAAI 2026).
"""

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import renew
from pipeline.findings.result import RankedRoute
from pipeline.findings.text import at_most_percent, clearance
from pipeline.formats.figures import plots
from pipeline.formats.palette import COLOURS

_HISTOGRAM_PT, _ROW_PT = 170.0, 14.0
_BINS = 30
# Greatest distance to the coast that is drawn, as a multiple of the greatest reach; greater
# distances are only written.
_MAX_GAP_REACHES = 2.0
# A mark further right than this share of the axis has its text on the left.
_TEXT_LEFT_FROM = 0.4
# Length of an axis, as a factor on the greatest value.
_AXIS_FACTOR = 1.06


def tightest_place(ranked: RankedRoute) -> renew.Tightest | None:
    """Return the place where turns have the least room; None without padding."""
    case, seed = ranked.case.case, ranked.case.scenario.planner.seed
    return renew.tightest(ranked.route, case.current, case.vessel, seed=seed)


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
