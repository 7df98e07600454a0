"""Plots for a page: a route's profile and its padding; choices of departure and speeds; members.

They are as wide as a phone. The page sets their colours by role (see `page_svg`).
"""

from collections.abc import Sequence

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from pipeline._types import FloatArray
from pipeline.findings import text
from pipeline.findings.choices import AS_GOOD, SpeedTradeOff, way_text
from pipeline.findings.result import RankedRoute
from pipeline.findings.route_profile import RouteProfile, metres_along, route_profile
from pipeline.findings.text import (
    clearance as kept,
    fuel,
    fuel_unit,
    hours,
    moment_text,
    number,
    plain,
    speed_range,
)
from pipeline.formats.appearance import COLOURS
from pipeline.formats.figures.chart_map import POINTS_PER_INCH, drawable, mark_point, text_width
from pipeline.model import DepartureChoice, EnsembleFigures

_WIDTH_PT = 374.0
# Room left of the panels, for the labels of the vertical axes.
_LEFT_PT = 38.0
# Room right of the panels.
_RIGHT_PT = 12.0
# Room above the upper panel, for its title.
_TOP_PT = 22.0
# Room below the lowest panel, for the labels of the horizontal axis.
_BOTTOM_PT = 36.0
# Height of a panel of the profile.
_PANEL_PT = 66.0
# Room between panels of the profile, for the lower one's title.
_GAP_PT = 30.0
# Size of a panel's title.
_TITLE_PT = 10.0
# Size of all other text in a plot.
TEXT_PT = 9.0
# Ratio of the greatest to the least distance to land above which the axis is logarithmic.
_LOG_AXIS_RATIO = 6.0
# Minimum padding that is drawn, as a share of the least clearance.
_MIN_PADDING_SHARE = 0.02
_KILOMETRES_FROM_M = 2_000.0
DASHES = (0, (4, 3))


def profile_figure(ranked: RankedRoute) -> Figure:
    """Plot fuel, speed, current, and distance to land and water if known, by distance run."""
    profile = route_profile(ranked)
    unit, unit_m = distance_unit(float(profile.distance_m[-1]))
    run = profile.distance_m / unit_m
    draws = [_draw_fuel, _draw_speed, _draw_current]
    if np.isfinite(profile.clearance_m).all():
        draws.append(_draw_clearance)
    if ranked.route.least_water is not None:
        draws.append(_draw_water)
    figure, panels = plot_panels(len(draws), _PANEL_PT, _GAP_PT)
    for axes, draw in zip(panels, draws, strict=True):
        draw(axes, ranked, profile, run)
        axes.set_xlim(0, run[-1])
        axes.tick_params(labelbottom=axes is panels[-1])
    plot_x_label(panels[-1], f"distance run, {unit}")
    return figure


def _draw_fuel(axes: Axes, ranked: RankedRoute, at: RouteProfile, run: FloatArray) -> None:
    """Draw the fuel used, and the fuel for the same distance in still water."""
    metrics, share = ranked.metrics, at.distance_m / at.distance_m[-1]
    size, name = fuel_unit(max(metrics.fuel, metrics.still_fuel), metrics)
    still, used = size * metrics.still_fuel * share, size * at.fuel
    ink = COLOURS["ink"]
    axes.plot(run, still, color=ink, linewidth=1.0, linestyle=DASHES, zorder=2)
    draw_line(axes, run, used)
    axes.set_ylim(0, 1.05 * max(still[-1], used[-1]))
    note = f"dashed: still water, {number(still[-1])}"
    plot_title(axes, f"Fuel used, {name.partition(' of ')[0]}: {number(used[-1])}", note)


def _draw_speed(axes: Axes, ranked: RankedRoute, at: RouteProfile, run: FloatArray) -> None:
    """Draw the speed over ground, and through water."""
    speeds = at.through_water_m_s
    axes.plot(
        run,
        speeds,
        color=COLOURS["ink"],
        linewidth=1.0,
        linestyle=DASHES,
        drawstyle="steps-post",
        zorder=2,
    )
    draw_line(axes, run, at.speed_m_s)
    mean = ranked.metrics.speed_m_s
    _set_range(axes, [*at.speed_m_s, *speeds], min_range=0.1 * mean)
    low, high = speed_range(float(speeds.min()), float(speeds.max()))
    through = plain(round(mean, 2)) if low == high else f"{low}–{high}"
    plot_title(axes, "Speed over ground, m/s", f"dashed: through water, {through}")


def _draw_current(axes: Axes, ranked: RankedRoute, at: RouteProfile, run: FloatArray) -> None:
    """Draw the current's component along the course, shaded by its sign."""
    along_track = at.current_along_m_s
    for role, alpha, part in (
        ("speed2", 0.75, np.maximum(along_track, 0)),
        ("soft", 0.45, np.minimum(along_track, 0)),
    ):
        axes.fill_between(run, part, color=COLOURS[role], alpha=alpha, linewidth=0)
    axes.axhline(0, color=COLOURS["ink"], linewidth=0.7)
    axes.plot(run, along_track, color=COLOURS["ink"], linewidth=0.8)
    min_range = 0.05 * ranked.metrics.speed_m_s
    _set_range(axes, [*along_track, 0.0], min_range=min_range)
    plot_title(axes, "Current along the course, m/s", "blue helps, grey hinders")


def _draw_clearance(axes: Axes, ranked: RankedRoute, at: RouteProfile, run: FloatArray) -> None:
    """Draw the distance to no-go areas, their padding, and the least distance."""
    unit, unit_m = distance_unit(float(at.clearance_m.max()))
    clearance, (padding, turns) = at.clearance_m / unit_m, _padding_m(ranked, at) / unit_m
    least = int(np.argmin(clearance))
    min_padding = _MIN_PADDING_SHARE * clearance[least]
    shown = np.concatenate([clearance, padding[padding > min_padding]])
    low, high = float(shown[shown > 0].min(initial=1.0)), float(shown.max())
    if high > _LOG_AXIS_RATIO * low:
        axes.set_yscale("log")
        axes.set_ylim(low / 1.4, high * 1.3)
        _round_ticks(axes)
    else:
        axes.set_ylim(0, 1.1 * high)
    floor = axes.get_ylim()[0]
    rooms = {"soft": padding, **({"turning": turns} if (turns < padding).any() else {})}
    for role, room in rooms.items():
        axes.fill_between(run, room, floor, color=COLOURS[role], alpha=0.45, linewidth=0)
    draw_line(axes, run, np.maximum(clearance, floor))
    mark_point(axes, (run[least], max(clearance[least], floor)), "best", (5.0, 1.6))
    least_text = kept(at.clearance_m[least])
    text = f"Distance to {ranked.metrics.no_go_name}, {unit}: least {least_text}"
    said = "grey: its padding" if len(rooms) == 1 else "grey: padding, red: turns"
    plot_title(axes, text, said if padding.max() > floor else "")


def _draw_water(axes: Axes, ranked: RankedRoute, at: RouteProfile, run: FloatArray) -> None:
    """Draw the water under the keel where depth and tide are known, and the least allowed."""
    route, case = ranked.route, ranked.case.case
    kept_m, depth = case.under_keel_clearance_m, case.tidal_depth
    if depth is None:
        raise ValueError(f"{case.name} has no tide")
    points = case.projection.to_plane(at.lonlat)
    times = np.interp(metres_along(points), metres_along(route.path), route.times)
    spare = depth.spare_along(points, times) + kept_m
    water = np.where(np.isfinite(spare), spare, np.nan)
    axes.axhline(kept_m, color=COLOURS["ink"], linewidth=1.0, linestyle=DASHES, zorder=2)
    draw_line(axes, run, np.append(water, water[-1:]))
    axes.set_ylim(0, 1.2 * max(float(np.nanmax(water, initial=kept_m)), kept_m))
    least = ranked.metrics.least_water_m
    plot_title(
        axes, f"Water under the keel, m: least {least:.1f}", f"dashed: to be kept, {plain(kept_m)}"
    )


def _padding_m(ranked: RankedRoute, at: RouteProfile) -> FloatArray:
    """Return padding, and what of it turns need (2, n), m, of the edge nearest to each point."""
    padded = ranked.route.padding_used
    projection = ranked.case.case.projection
    if not len(padded):
        return np.zeros((2, len(at.lonlat)))
    edges = shapely.linestrings(padded[:, :4].reshape(-1, 2, 2))
    points = shapely.points(projection.to_plane(at.lonlat))
    nearest = shapely.STRtree(edges).query_nearest(points, all_matches=False)[1]
    rooms = np.array([padded[:, 4], ranked.route.turn_padding.clip(min=0.0)])
    return np.asarray(rooms[:, nearest] * projection.scale)


def distance_unit(longest_m: float) -> tuple[str, float]:
    """Return the unit for distances up to `longest_m`, and its length in metres."""
    return ("km", 1000.0) if longest_m >= _KILOMETRES_FROM_M else ("m", 1.0)


def plot_panels(count: int, height_pt: float, gap_pt: float) -> tuple[Figure, list[Axes]]:
    """Make a figure with panels of equal height below each other."""
    whole = _TOP_PT + count * height_pt + (count - 1) * gap_pt + _BOTTOM_PT
    figure = Figure(
        figsize=(_WIDTH_PT / POINTS_PER_INCH, whole / POINTS_PER_INCH), facecolor=COLOURS["halo"]
    )
    panels = []
    for row in range(count):
        bottom = whole - _TOP_PT - (row + 1) * height_pt - row * gap_pt
        inner = 1 - (_LEFT_PT + _RIGHT_PT) / _WIDTH_PT
        axes = figure.add_axes((_LEFT_PT / _WIDTH_PT, bottom / whole, inner, height_pt / whole))
        axes.set_facecolor("none")
        axes.grid(color=COLOURS["grid"], linewidth=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(
            labelsize=TEXT_PT, labelcolor=COLOURS["ink"], color=COLOURS["frame"], length=3, pad=2
        )
        for side, spine in axes.spines.items():
            spine.set_visible(side in {"left", "bottom"})
            spine.set_color(COLOURS["frame"])
        axes.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 2.5, 5, 10]))
        axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 2.5, 5, 10]))
        panels.append(axes)
    return figure, panels


def plot_title(axes: Axes, title: str, note: str) -> None:
    """Write a panel's title above its left end, and a note above its right end.

    In a figure too narrow for both, the note is inside the panel.
    """
    # A given `y` keeps matplotlib from looking for ticks above the panel, which takes long.
    ink = COLOURS["ink"]
    heading = axes.set_title(
        title, loc="left", fontsize=_TITLE_PT, fontweight="bold", color=ink, pad=5, y=1.0
    )
    room = axes.get_position().width * axes.figure.bbox.width / axes.figure.dpi * POINTS_PER_INCH
    wide = text_width(title, _TITLE_PT, bold=True) + text_width(note, TEXT_PT)
    if wide + TEXT_PT <= room:
        axes.set_title(note, loc="right", fontsize=TEXT_PT, color=ink, pad=5, y=1.0)
    else:
        heading.set_fontsize(TEXT_PT)
        axes.text(
            1.0, 0.98, note, transform=axes.transAxes, ha="right", va="top", fontsize=7, color=ink
        )


def plot_x_label(axes: Axes, text: str) -> None:
    """Label a panel's horizontal axis."""
    axes.set_xlabel(text, fontsize=TEXT_PT, color=COLOURS["ink"], labelpad=3)


def plot_text(
    axes: Axes,
    text: str,
    at: tuple[float, float],
    *,
    on_left: bool,
    offset_pt: tuple[float, float] = (4.0, 0.0),
) -> None:
    """Write text left or right of a place in a plot, and above it if the offset goes up."""
    box = {"boxstyle": "square,pad=0.1", "facecolor": COLOURS["halo"], "edgecolor": "none"}
    across, up = offset_pt
    axes.annotate(
        text,
        at,
        xytext=(-across if on_left else across, up),
        textcoords="offset points",
        ha="right" if on_left else "left",
        va="bottom" if up else "center",
        fontsize=TEXT_PT,
        color=COLOURS["ink"],
        bbox=box,
        zorder=4,
    )


def draw_line(axes: Axes, x: FloatArray, y: FloatArray) -> None:
    """Draw the line of a route's values."""
    axes.plot(x, y, color=COLOURS["best"], linewidth=1.8, solid_joinstyle="round", zorder=3)


def _set_range(axes: Axes, values: Sequence[float], min_range: float) -> None:
    """Set the axis to all values with a margin, and to at least `min_range`."""
    low, high = min(values), max(values)
    margin = max(0.1 * (high - low), min_range / 2)
    axes.set_ylim(low - margin, high + margin)


def _round_ticks(axes: Axes) -> None:
    """Mark a logarithmic axis at 1, 2, 5, 10, ..., or with fewer ticks if those are too many."""
    low, high = axes.get_ylim()
    powers = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    for factors in ([1, 2, 5], [1, 3], [1]):
        ticks = np.outer(powers, factors).ravel()
        ticks = ticks[(ticks >= low) & (ticks <= high)]
        if len(ticks) <= 5:
            break
    axes.yaxis.set_major_locator(FixedLocator(ticks.tolist()))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: plain(value)))
    axes.yaxis.set_minor_locator(NullLocator())


_HEIGHT_PT = 150.0
# Units of time: shortest axis on which it is used, s; length of the unit, s; its name.
_UNITS = ((3 * 86_400.0, 86_400.0, "days"), (7_200.0, 3_600.0, "hours"), (0.0, 60.0, "minutes"))
# The bound is drawn if it lies no further below the least duration than this multiple of the range
# of durations.
_MAX_DEPTH = 3.0
# Space above and below the values, as a share of their range.
_MARGIN = 0.12


def departure_figure(choice: DepartureChoice) -> Figure | None:
    """Plot time under way by departure, with its lower bound; None for a single departure.

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


def trade_off_figure(curve: SpeedTradeOff) -> Figure | None:
    """Plot least fuel by time, the best route, the deadline; None for a single arrival."""
    if len(curve.durations_s) < 2:
        return None
    figure, (axes,) = plot_panels(1, _HEIGHT_PT, 0.0)
    longest = float(curve.durations_s[-1])
    unit_s, unit = next((size, name) for least, size, name in _UNITS if longest >= least)
    size, name = fuel_unit(float(curve.fuels.max()), curve.metrics)
    x, y = curve.durations_s / unit_s, curve.fuels * size
    draw_line(axes, x, y)
    low, high = float(y.min()), float(y.max())
    room = _MARGIN * max(high - low, 0.02 * high)
    axes.set_ylim(max(0.0, low - room), high + room)
    deadline = curve.choice.within_s / unit_s
    if deadline <= x[-1]:
        axes.axvline(deadline, color=COLOURS["ink"], linewidth=1.0, linestyle=DASHES, zorder=2)
    at, chosen = curve.duration_s / unit_s, curve.fuel * size
    mark_point(axes, (at, chosen), "other", (6.0, 2.0))
    # Above and right of the falling curve there is room, unless the point is at its right end.
    on_left = at > 0.65 * x[-1] + 0.35 * x[0]
    plot_text(
        axes,
        f"{moment_text(curve.moment(curve.duration_s))}\n{hours(curve.duration_s)}, "
        f"fuel {fuel(curve.fuel, curve.metrics)}",
        (at, chosen),
        on_left=on_left,
        offset_pt=(8.0, 8.0),
    )
    note = "dashed: deadline" if deadline <= x[-1] else ""
    plot_title(axes, f"Least fuel by arrival, {name}", note)
    plot_x_label(axes, f"arrival, {unit} after {moment_text(curve.departure)}")
    return figure


# Height of a route's row, points.
_ROW_PT = 30.0
# Largest number of rows.
_MAX_ROWS = 6
# A route that needs this multiple of the first route's fuel is drawn only if it is the best in some
# member.
_MUCH_DEARER = 1.3
# Largest number of letters of a way.
_MAX_WAY = 52


def fan_figure(ensemble: EnsembleFigures, routes: tuple[RankedRoute, ...]) -> Figure | None:
    """Plot each route's fuel in each member, its mean, and the range of the middle eight tenths.

    None where no route can be sailed in every member.
    """
    base = ensemble.statistic("mean", 1)
    if not np.isfinite(base):
        return None
    # A few routes that are much dearer would squeeze the others together.
    shown = [
        one
        for one in routes
        if ensemble.share(one.rank) > 0
        or np.median(ensemble.fuels[one.rank - 1]) < _MUCH_DEARER * base
    ][:_MAX_ROWS]
    figure, (axes,) = plot_panels(1, _ROW_PT * len(shown), 0.0)
    for row, one in enumerate(reversed(shown)):
        fuels = ensemble.fuels[one.rank - 1]
        known = np.isfinite(fuels)
        more = 100 * (fuels[known] / base - 1)
        colour = COLOURS["best" if one.rank == 1 else "other"]
        low, middle, high = _quantiles(more, ensemble.weights[known])
        axes.plot([low, high], [row, row], color=colour, linewidth=5, alpha=0.3, zorder=2)
        axes.plot(
            more, np.full(more.size, row), "|", color=colour, markersize=8, alpha=0.7, zorder=3
        )
        axes.plot([middle], [row], "o", color=colour, markersize=4.5, zorder=4)
        share = text.percent(ensemble.share(one.rank), 0)
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
    """Return the first decile, the mean and the ninth decile of weighted values."""
    order = np.argsort(values)
    below = np.cumsum(weights[order]) / weights.sum()
    low, high = (values[order][np.searchsorted(below, share - 1e-9)] for share in (0.1, 0.9))
    return float(low), float(np.average(values, weights=weights)), float(high)
