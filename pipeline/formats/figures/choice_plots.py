"""The plots of a choice: of the departure, of speeds for an arrival, of a side among members."""

import numpy as np
import shapely
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from pipeline._types import FloatArray
from pipeline.findings import text
from pipeline.findings.choices import AS_GOOD, SpeedTradeOff
from pipeline.findings.ensembles import way_text
from pipeline.findings.result import RankedRoute, RunResult
from pipeline.findings.text import fuel, hours, moment_text
from pipeline.formats.figures.chart_map import PLAIN_PT, draw_map, drawable, map_figure, stroke
from pipeline.formats.figures.plots import (
    DASHES,
    TEXT_PT,
    draw_line,
    mark_point,
    plot_panels,
    plot_text,
    plot_title,
    plot_x_label,
    titled_fuel_unit,
)
from pipeline.formats.figures.season_map import chart_layers, zone_layers
from pipeline.formats.palette import COLOURS
from pipeline.model import DepartureChoice, EnsembleFigures

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
    )
    note = "dashed: no departure takes less, apart from the paths' error" if has_floor else ""
    what = "Time under way, h (fuel in proportion)"
    plot_title(axes, "Fuel above the least, %" if choice.has_speeds else what, note)
    plot_x_label(axes, f"departure, {unit} after {moment_text(choice.first)}")
    return figure


def trade_off_figure(found: SpeedTradeOff) -> Figure | None:
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


# Height of a route's row, points.
_ROW_PT = 30.0
# Largest number of rows.
_MAX_ROWS = 6
# Ratio to the mean of the route taken from which a route is only drawn if it is the best somewhere.
_MUCH_DEARER = 1.3
# Largest number of letters of a way.
_MAX_WAY = 52
# Width of a route's line on the map if it is the best in no member, points.
_THIN_PT = 0.8
# What is added to that width if it is the best in all of them, points.
_THICK_PT = 6.0
# Places along a route at which its share may stand.
_PLACES = np.linspace(0.15, 0.85, 29)


def fan_figure(found: EnsembleFigures, routes: tuple[RankedRoute, ...]) -> Figure | None:
    """Plot each route's fuel in each member, with its mean, P90 and the tenth below which few are.

    None where no route can be sailed in every member.
    """
    base = found.statistic("mean", 1)
    if not np.isfinite(base):
        return None
    # A few routes that are much dearer would squeeze the others together.
    shown = [
        one
        for one in routes
        if found.share(one.rank) > 0 or np.median(found.fuels[one.rank - 1]) < _MUCH_DEARER * base
    ][:_MAX_ROWS]
    figure, (axes,) = plot_panels(1, _ROW_PT * len(shown), 0.0)
    for row, one in enumerate(reversed(shown)):
        fuels = found.fuels[one.rank - 1]
        known = np.isfinite(fuels)
        more = 100 * (fuels[known] / base - 1)
        colour = COLOURS["best" if one.rank == 1 else "other"]
        low, middle, high = _quantiles(more, found.weights[known])
        axes.plot([low, high], [row, row], color=colour, linewidth=5, alpha=0.3, zorder=2)
        axes.plot(
            more, np.full(more.size, row), "|", color=colour, markersize=8, alpha=0.7, zorder=3
        )
        axes.plot([middle], [row], "o", color=colour, markersize=4.5, zorder=4)
        share = text.percent(found.share(one.rank), 0)
        axes.text(
            0.005,
            row + 0.34,
            f"{drawable(one.metrics.way or way_text(one.metrics), _MAX_WAY)}: best in {share}",
            transform=axes.get_yaxis_transform(),
            fontsize=TEXT_PT,
            color=COLOURS["ink"],
            va="center",
        )
    axes.set_ylim(-0.4, len(shown) - 0.35)
    axes.yaxis.set_visible(False)
    axes.spines["left"].set_visible(False)
    plot_title(axes, "Fuel in each member", "dot: mean; bar: eight members in ten")
    plot_x_label(axes, "above the mean of the route taken, %")
    return figure


def _quantiles(values: FloatArray, weights: FloatArray) -> tuple[float, float, float]:
    """Return the value that a tenth lie below, the mean, and the value that a tenth lie above."""
    order = np.argsort(values)
    below = np.cumsum(weights[order]) / weights.sum()
    low, high = (values[order][np.searchsorted(below, share - 1e-9)] for share in (0.1, 0.9))
    return float(low), float(np.average(values, weights=weights)), float(high)


def share_map(result: RunResult, found: EnsembleFigures, routes: tuple[RankedRoute, ...]) -> Figure:
    """Draw the routes, each the thicker the more members it is the best in, with its share."""
    figure, [(axes, sea)] = map_figure(result)
    layers = [*chart_layers(axes, result), *zone_layers(result)]
    ordered = sorted(routes, key=lambda one: found.share(one.rank))
    paths = [shapely.LineString(one.route.path) for one in ordered]
    for one in ordered:
        width = _THIN_PT + _THICK_PT * found.share(one.rank)
        colour = COLOURS["best" if one.rank == 1 else "other"]
        layers += [
            stroke(one.route.path, COLOURS["halo"], width + 1.6, 6),
            stroke(one.route.path, colour, width, 7),
        ]
    draw_map(axes, sea, result, layers, [one.route.path for one in ordered])
    for one, path in zip(ordered, paths, strict=True):
        share = found.share(one.rank)
        if share > 0:
            x, y = _apart(path, [other for other in paths if other is not path])
            axes.text(
                x,
                y,
                text.percent(share, 0),
                ha="center",
                va="center",
                fontsize=PLAIN_PT,
                fontweight="bold",
                color=COLOURS["ink"],
                zorder=9,
                path_effects=[withStroke(linewidth=2.4, foreground=COLOURS["halo"])],
            )
    return figure


def _apart(path: shapely.LineString, others: list[shapely.LineString]) -> tuple[float, float]:
    """Return the place on a path that is farthest from the others, and off its ends."""
    places = [path.interpolate(share, normalized=True) for share in _PLACES]
    rest = shapely.MultiLineString(others)
    place = max(places, key=rest.distance) if others else places[len(places) // 2]
    return float(place.x), float(place.y)
