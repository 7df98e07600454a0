"""The plots of a choice: of the departure, or of speeds for an arrival."""

import numpy as np
from matplotlib.figure import Figure

from pipeline.findings.choices import AS_GOOD, TradeOff
from pipeline.findings.text import fuel, hours, moment_text
from pipeline.formats.figures.plots import (
    DASHES,
    draw_line,
    mark_point,
    plot_panels,
    plot_text,
    plot_title,
    plot_x_label,
    titled_fuel_unit,
)
from pipeline.formats.palette import COLOURS
from pipeline.model import DepartureChoice

_HEIGHT_PT = 150.0
# Units of time: shortest axis on which it is used, s; length of the unit, s; its name.
_UNITS = ((3 * 86_400.0, 86_400.0, "days"), (7_200.0, 3_600.0, "hours"), (0.0, 60.0, "minutes"))
# The bound is drawn if it lies no further below the least duration than this multiple of the range
# of durations.
_MAX_DEPTH = 3.0
# Space above and below the values, as a share of their range.
_MARGIN = 0.12


def departure_figure(choice: DepartureChoice) -> Figure | None:
    """Plot time under way by departure, and the bound between them; None for a single departure.

    Where speeds are chosen it shows fuel, since each voyage takes nearly all the allowed time.
    """
    if len(choice.departures_s) < 2:
        return None
    figure, (axes,) = plot_panels(1, _HEIGHT_PT, 0.0)
    is_long = np.ptp(choice.departures_s) > _UNITS[0][0]
    _, unit_s, unit = _UNITS[0 if is_long else 1]
    known = np.isfinite(choice.fuels)
    x, y = choice.departures_s / unit_s, choice.durations_s / 3600
    if choice.has_speeds:
        y = 100 * (choice.fuels / choice.fuels.min() - 1)
    low, high = float(y[known].min()), float(y[known].max())
    floor = low - choice.unproven_s / 3600
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
    note = "dashed: no departure takes less, apart from the paths' error" if has_floor else ""
    what = "Time under way, h (fuel in proportion)"
    plot_title(axes, "Fuel above the least, %" if choice.has_speeds else what, note)
    plot_x_label(axes, f"departure, {unit} after {moment_text(choice.first)}")
    return figure


def trade_off_figure(found: TradeOff) -> Figure | None:
    """Plot least fuel by time, the best route, the deadline; None for a single arrival."""
    if len(found.durations_s) < 2:
        return None
    figure, (axes,) = plot_panels(1, _HEIGHT_PT, 0.0)
    longest = float(found.durations_s[-1])
    unit_s, unit = next((size, name) for least, size, name in _UNITS if longest >= least)
    scale, scale_name = titled_fuel_unit(float(found.fuels.max()))
    x, y = found.durations_s / unit_s, found.fuels / scale
    draw_line(axes, x, y)
    low, high = float(y.min()), float(y.max())
    room = _MARGIN * max(high - low, 0.02 * high)
    axes.set_ylim(max(0.0, low - room), high + room)
    deadline = found.choice.within_s / unit_s
    if deadline <= x[-1]:
        axes.axvline(deadline, color=COLOURS["ink"], linewidth=1.0, linestyle=DASHES, zorder=2)
    at, chosen = found.duration_s / unit_s, found.fuel / scale
    mark_point(axes, at, chosen, "other", (6.0, 2.0))
    # Above and right of the falling curve there is room, unless the point is at its right end.
    on_left = at > 0.65 * x[-1] + 0.35 * x[0]
    plot_text(
        axes,
        f"{moment_text(found.moment(found.duration_s))}\n{hours(found.duration_s)}, "
        f"fuel {fuel(found.fuel)}",
        (at, chosen),
        on_left=on_left,
        offset_pt=(8.0, 8.0),
    )
    note = "dashed: deadline" if deadline <= x[-1] else ""
    plot_title(axes, f"Least fuel by arrival{scale_name}", note)
    plot_x_label(axes, f"arrival, {unit} after {moment_text(found.departure)}")
    return figure
