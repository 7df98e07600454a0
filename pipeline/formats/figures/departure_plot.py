"""Plot of fuel against departure for a page, with the best one and what any other may save."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from pipeline.formats.figures.page_svg import page_svg
from pipeline.formats.figures.palette import COLOURS
from pipeline.formats.figures.plots import DASHES, plot_panels, plot_text, plot_title, plot_x_label
from pipeline.formats.shared.departure_text import AS_GOOD
from pipeline.formats.shared.text import hours, moment_text
from pipeline.model import DepartureChoice

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HEIGHT_PT = 150.0
_HOUR_S, _DAY_S = 3600.0, 86_400.0
# Windows longer than this have an axis in days.
_DAYS_FROM_S = 3 * _DAY_S
# The bound is drawn if it lies no further below the least duration than this multiple of the range
# of durations.
_MAX_DEPTH = 3.0
# Space above and below the durations, as a share of their range.
_MARGIN = 0.12


def departure_svg(choice: DepartureChoice, *, identity: str, label: str) -> Markup | str:
    """Plot a choice of departures; "" where there was but one."""
    if len(choice.departures_s) < 2:
        return ""
    return page_svg(departure_figure(choice), identity=identity, label=label)


def departure_figure(choice: DepartureChoice) -> Figure:
    """Figure for `departure_svg`: time under way by departure, and the bound between them.

    Where speeds are chosen it shows fuel: each voyage then takes all the time that it may, or
    nearly.
    """
    figure, (axes,) = plot_panels(1, _HEIGHT_PT, 0.0)
    is_long = np.ptp(choice.departures_s) > _DAYS_FROM_S
    unit_s, unit = (_DAY_S, "days") if is_long else (_HOUR_S, "hours")
    known = np.isfinite(choice.fuels)
    x, y = choice.departures_s / unit_s, choice.durations_s / _HOUR_S
    if choice.has_speeds:
        y = 100 * (choice.fuels / choice.fuels.min() - 1)
    low, high = float(y[known].min()), float(y[known].max())
    floor = low - choice.unproven_s / _HOUR_S
    has_floor = floor > low - _MAX_DEPTH * (high - low)
    axes.plot(x, np.where(known, y, np.nan), color=COLOURS["best"], linewidth=1.4, zorder=3)
    axes.plot(
        x[known], y[known], "o", color=COLOURS["best"], markersize=2.2, markeredgewidth=0, zorder=3
    )
    if has_floor:
        axes.axhline(floor, color=COLOURS["ink"], linewidth=1.0, linestyle=DASHES, zorder=2)
        low = floor
    begin_s, end_s = choice.good_window(AS_GOOD)
    axes.axvspan(begin_s / unit_s, end_s / unit_s, color=COLOURS["grid"], alpha=0.6, zorder=1)
    at = choice.chosen_s / unit_s
    axes.axvline(at, color=COLOURS["other"], linewidth=1.8, zorder=2.5)
    room = _MARGIN * (max(high - low, 0.02 * high) or 1.0)
    axes.set_ylim(low - room, high + 2.5 * room)
    on_left = at > (x[0] + x[-1]) / 2
    plot_text(
        axes,
        f"leave {moment_text(choice.chosen)}: {hours(choice.least_s)}",
        (at, high + 1.4 * room),
        on_left=on_left,
        boxed=False,
    )
    note = "dashed: no departure takes less, to within the paths' error" if has_floor else ""
    what = "Time under way, h (fuel in proportion)"
    plot_title(axes, "Fuel above the least, %" if choice.has_speeds else what, note)
    plot_x_label(axes, f"departure, {unit} after {moment_text(choice.first)}")
    return figure
