"""Plot of fuel against arrival for a page, with the arrival that is chosen."""

from __future__ import annotations

from typing import TYPE_CHECKING

from markupsafe import Markup

from pipeline.formats.figures.page_svg import page_svg
from pipeline.formats.figures.palette import COLOURS
from pipeline.formats.figures.plots import (
    DASHES,
    draw_line,
    fuel_unit,
    mark_point,
    plot_panels,
    plot_text,
    plot_title,
    plot_x_label,
)
from pipeline.formats.shared.text import fuel, hours, moment_text
from pipeline.formats.shared.trade_offs import TradeOff

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HEIGHT_PT = 150.0
# Units of time: shortest axis on which it is used, s; length of the unit, s; its name.
_UNITS = ((3 * 86_400.0, 86_400.0, "days"), (7_200.0, 3_600.0, "hours"), (0.0, 60.0, "minutes"))
# Space above and below the curve, as a share of the range of fuel.
_MARGIN = 0.12


def trade_off_svg(found: TradeOff, *, identity: str, label: str) -> Markup | str:
    """Plot a trade-off; "" where there is but one arrival."""
    if len(found.durations_s) < 2:
        return ""
    return page_svg(trade_off_figure(found), identity=identity, label=label)


def trade_off_figure(found: TradeOff) -> Figure:
    """Figure for `trade_off_svg`: least fuel by time under way, the best route, the deadline."""
    figure, (axes,) = plot_panels(1, _HEIGHT_PT, 0.0)
    longest = float(found.durations_s[-1])
    unit_s, unit = next((size, name) for least, size, name in _UNITS if longest >= least)
    scale, scale_name = fuel_unit(float(found.fuels.max()))
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
