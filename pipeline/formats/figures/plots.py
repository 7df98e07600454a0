"""Plots of one route for a page: what it meets along its way, and its padding where it is tightest.

They are drawn in the maps' colours by role, so that the page decides them, light or dark, and as
wide as a phone; see `page_svg`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.formats.figures.page_svg import page_svg
from pipeline.formats.figures.palette import COLOURS
from pipeline.formats.shared.along import along
from pipeline.formats.shared.text import distance, number, percent, plain

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    import renew
    from pipeline.formats.shared.along import Along
    from pipeline.formats.shared.result import RankedRoute, RunResult

    FloatArray = npt.NDArray[np.float64]

_WIDTH_PT, _POINTS_PER_INCH = 374.0, 72.0
_LEFT_PT, _RIGHT_PT, _TOP_PT, _BOTTOM_PT = 38.0, 12.0, 22.0, 36.0
_PANEL_PT, _GAP_PT = 66.0, 30.0
_TITLE_PT, _TEXT_PT = 10.0, 9.0
_HISTOGRAM_PT, _ROW_PT = 170.0, 14.0
_BINS = 30
# Distances to land that span more than this factor are drawn on a logarithmic axis, and what is
# below the least by more than the second is left out.
_SPAN, _FLOOR = 6.0, 0.02
# A distance to the coast beyond so many times the furthest reach is told and not drawn.
_BEYOND = 2.0
# Free space beyond what is drawn; words stand left of what is further right than this share.
_ROOM, _ON_LEFT = 1.06, 0.4
_KILOMETRES_FROM_M = 2_000.0
# Fuel has the units of whoever gave the vessel's rate: it may be any number.
_FUEL_UNITS = (
    (1e9, 1e9, " in billions"),
    (1e6, 1e6, " in millions"),
    (1e5, 1e3, " in thousands"),
    (0.0, 1.0, ""),
)


def profile_svg(result: RunResult, ranked: RankedRoute, *, identity: str, label: str) -> str:
    """Draw fuel, speed, current and distance to land of a route against the distance run."""
    return page_svg(profile_figure(result, ranked), identity=identity, label=label)


def padding_svg(result: RunResult, ranked: RankedRoute, *, identity: str, label: str) -> str:
    """Draw how far hard-over turns reach at the route's tightest place; "" where none is tight."""
    import renew

    scene = result.scene
    tightest = renew.tightest(
        ranked.route,
        scene.currents[ranked.season],
        scene.vessel,
        seed=result.scenario.planner.seed,
    )
    if tightest is None:
        return ""
    figure = padding_figure(tightest, scene.projection.scale)
    return page_svg(figure, identity=identity, label=label)


def profile_figure(result: RunResult, ranked: RankedRoute) -> Figure:
    """Draw what `profile_svg` shows; without land, three panels in place of four."""
    found = along(ranked, result)
    profile = _Profile(result, ranked, found, *_unit(float(found.distance_m[-1])))
    draws: list[Callable[[Axes], None]] = [
        profile.draw_fuel,
        profile.draw_speed,
        profile.draw_current,
    ]
    if np.isfinite(found.clearance_m).all():
        draws.append(profile.draw_clearance)
    figure, panels = _panels(len(draws), _PANEL_PT, _GAP_PT)
    for axes, draw in zip(panels, draws, strict=True):
        draw(axes)
        axes.set_xlim(0, profile.run[-1])
        axes.tick_params(labelbottom=axes is panels[-1])
    panels[-1].set_xlabel(
        f"distance run, {profile.unit}", fontsize=_TEXT_PT, color=COLOURS["ink"], labelpad=3
    )
    return figure


def padding_figure(tightest: renew.Tightest, scale: float) -> Figure:
    """Draw the reaches of hard-over turns as a histogram, in true metres, beside what is kept.

    `scale` is true metres to a planar one.
    """
    reach_m = np.asarray(tightest.reaches, dtype=float) * scale
    padding_m, gap_m = tightest.padding * scale, tightest.gap * scale
    beyond = float((reach_m > padding_m).mean())
    marks = [
        _Mark(float(np.median(reach_m)), "median", "ink"),
        _Mark(padding_m, "padding", "other", f", exceeded by {percent(beyond)}"),
        _Mark(gap_m, "route to coast", "best"),
    ]
    furthest_m = max(float(reach_m.max()), padding_m)
    end_m = _ROOM * max(furthest_m, gap_m if gap_m <= _BEYOND * furthest_m else 0.0)
    unit, unit_m = _unit(end_m)

    figure, (axes,) = _panels(1, _HISTOGRAM_PT, 0.0)
    counts, edges = np.histogram(reach_m / unit_m, bins=_BINS)
    shares = 100 * counts / reach_m.size
    axes.stairs(shares, edges, fill=True, color=COLOURS["speed1"], zorder=2)
    over = np.maximum(edges, padding_m / unit_m)
    axes.stairs(shares, over, fill=True, color=COLOURS["other"], zorder=2.5)
    # Above the bars each mark has a row for its words.
    rows = len(marks) * _ROW_PT / _HISTOGRAM_PT
    axes.set_xlim(0, end_m / unit_m)
    axes.set_ylim(0, _ROOM * shares.max() / (1 - rows))
    # The nearest is the lowest, so that words to the left of a line meet no other line.
    for row, mark in enumerate(sorted(marks, key=lambda mark: -mark.value_m)):
        _draw_mark(axes, mark, unit_m, 1 - (row + 0.5) * _ROW_PT / _HISTOGRAM_PT)
    _title(axes, "How far hard-over turns reach to land", "% of turns")
    axes.set_xlabel(
        f"reach from the tightest place, {unit}",
        fontsize=_TEXT_PT,
        color=COLOURS["ink"],
        labelpad=3,
    )
    return figure


@dataclass(frozen=True)
class _Mark:
    """A distance (true metres) to tell of in a histogram: its name, and what follows the figure."""

    value_m: float
    name: str
    role: str
    remark: str = ""


def _draw_mark(axes: Axes, mark: _Mark, unit_m: float, height: float) -> None:
    """Draw a distance as a line from below up to its words, at a share of the panel's height."""
    place, (_, end) = mark.value_m / unit_m, axes.get_xlim()
    words = f"{mark.name} {distance(mark.value_m)}{mark.remark}"
    if place <= end:
        axes.axvline(place, 0, height, color=COLOURS[mark.role], linewidth=1.8, zorder=3)
    else:
        words += " \N{RIGHTWARDS ARROW}"
    on_left = place > _ON_LEFT * end
    axes.annotate(
        words,
        (min(place, end), height),
        xycoords=axes.get_xaxis_transform(),
        xytext=(-4 if on_left else 4, 0),
        textcoords="offset points",
        ha="right" if on_left else "left",
        va="center",
        fontsize=_TEXT_PT,
        color=COLOURS["ink"],
        bbox={"boxstyle": "square,pad=0.1", "facecolor": COLOURS["halo"], "edgecolor": "none"},
        zorder=4,
    )


@dataclass(frozen=True)
class _Profile:
    """A route's panels, each against the distance run."""

    result: RunResult
    ranked: RankedRoute
    found: Along
    unit: str
    unit_m: float

    @property
    def run(self) -> FloatArray:
        """Distance from the start (n,), in the plot's unit."""
        return self.found.distance_m / self.unit_m

    def draw_fuel(self, axes: Axes) -> None:
        """Draw the fuel used, and what it would be in still water."""
        vessel, scale = self.result.scene.vessel, self.result.scene.projection.scale
        still = vessel.fuel_rate / vessel.speed * self.found.distance_m / scale
        used, most = self.found.fuel, float(max(still[-1], self.found.fuel[-1]))
        unit, words = next((unit, words) for least, unit, words in _FUEL_UNITS if most >= least)
        _draw_dashed(axes, self.run, still / unit)
        _draw_line(axes, self.run, used / unit)
        axes.set_ylim(0, 1.05 * most / unit)
        _title(
            axes,
            f"Fuel used{words}: {number(used[-1] / unit)}",
            f"dashed: in still water, {number(still[-1] / unit)}",
        )

    def draw_speed(self, axes: Axes) -> None:
        """Draw the speed over ground, and that through water."""
        speed = self.result.scene.vessel.speed
        _draw_dashed(axes, self.run[[0, -1]], np.array([speed, speed]))
        _draw_line(axes, self.run, self.found.speed_m_s)
        _widen(axes, [*self.found.speed_m_s, speed], least=0.1 * speed)
        _title(axes, "Speed over ground, m/s", f"dashed: through water, {plain(speed)} m/s")

    def draw_current(self, axes: Axes) -> None:
        """Draw the current's part along the course; a following one is shaded."""
        along_track = self.found.current_along_m_s
        for role, alpha, part in (
            ("speed2", 0.75, np.maximum(along_track, 0)),
            ("soft", 0.45, np.minimum(along_track, 0)),
        ):
            axes.fill_between(self.run, part, color=COLOURS[role], alpha=alpha, linewidth=0)
        axes.axhline(0, color=COLOURS["ink"], linewidth=0.7)
        axes.plot(self.run, along_track, color=COLOURS["ink"], linewidth=0.8)
        _widen(axes, [*along_track, 0.0], least=0.05 * self.result.scene.vessel.speed)
        _title(axes, "Current along the course, m/s", "blue: it helps; grey: it hinders")

    def draw_clearance(self, axes: Axes) -> None:
        """Draw the distance to land, the padding of the coast there, and the least distance."""
        unit, unit_m = _unit(float(self.found.clearance_m.max()))
        clearance, padding = self.found.clearance_m / unit_m, self._padding_m() / unit_m
        least = int(np.argmin(clearance))
        shown = np.concatenate([clearance, padding[padding > _FLOOR * clearance[least]]])
        low, high = float(shown[shown > 0].min(initial=1.0)), float(shown.max())
        if high > _SPAN * low:
            axes.set_yscale("log")
            axes.set_ylim(low / 1.4, high * 1.3)
            _round_ticks(axes)
        else:
            axes.set_ylim(0, 1.1 * high)
        floor = axes.get_ylim()[0]
        axes.fill_between(self.run, padding, floor, color=COLOURS["soft"], alpha=0.45, linewidth=0)
        _draw_line(axes, self.run, np.maximum(clearance, floor))
        axes.plot(
            [self.run[least]],
            [max(clearance[least], floor)],
            marker="o",
            markersize=5,
            color=COLOURS["halo"],
            markeredgecolor=COLOURS["best"],
            markeredgewidth=1.6,
            clip_on=False,
            zorder=4,
        )
        words = f"Distance to land, {unit}: least {distance(self.found.clearance_m[least])}"
        _title(axes, words, "grey: its padding" if padding.max() > floor else "")

    def _padding_m(self) -> FloatArray:
        """Padding (n,) of the coast that is nearest to each place as it is planned on, true m."""
        padded = self.ranked.route.padding_used
        projection = self.result.scene.projection
        if not len(padded):
            return np.zeros(len(self.run))
        edges = shapely.linestrings(padded[:, :4].reshape(-1, 2, 2))
        places = shapely.points(projection.to_plane(self.found.lonlat))
        nearest = shapely.STRtree(edges).query_nearest(places, all_matches=False)[1]
        return np.asarray(padded[nearest, 4] * projection.scale)


def _unit(longest_m: float) -> tuple[str, float]:
    """Unit for distances up to `longest_m`, and its metres."""
    return ("km", 1000.0) if longest_m >= _KILOMETRES_FROM_M else ("m", 1.0)


def _panels(count: int, height_pt: float, gap_pt: float) -> tuple[Figure, list[Axes]]:
    """Make a figure with panels of one height below each other, the page's width."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    whole = _TOP_PT + count * height_pt + (count - 1) * gap_pt + _BOTTOM_PT
    figure = Figure(
        figsize=(_WIDTH_PT / _POINTS_PER_INCH, whole / _POINTS_PER_INCH), facecolor=COLOURS["halo"]
    )
    panels = []
    for row in range(count):
        bottom = whole - _TOP_PT - (row + 1) * height_pt - row * gap_pt
        axes = figure.add_axes(
            (
                _LEFT_PT / _WIDTH_PT,
                bottom / whole,
                1 - (_LEFT_PT + _RIGHT_PT) / _WIDTH_PT,
                height_pt / whole,
            )
        )
        axes.set_facecolor("none")
        axes.grid(color=COLOURS["grid"], linewidth=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(
            labelsize=_TEXT_PT, labelcolor=COLOURS["ink"], color=COLOURS["frame"], length=3, pad=2
        )
        for side, spine in axes.spines.items():
            spine.set_visible(side in {"left", "bottom"})
            spine.set_color(COLOURS["frame"])
        axes.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 2.5, 5, 10]))
        axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 2.5, 5, 10]))
        panels.append(axes)
    return figure, panels


def _title(axes: Axes, words: str, note: str) -> None:
    """Name a panel above its left end, and explain its marks above its right end."""
    ink = COLOURS["ink"]
    axes.set_title(words, loc="left", fontsize=_TITLE_PT, fontweight="bold", color=ink, pad=5)
    axes.set_title(note, loc="right", fontsize=_TEXT_PT, color=ink, pad=5)


def _draw_line(axes: Axes, x: FloatArray, y: FloatArray) -> None:
    """Draw a route's own figures."""
    axes.plot(x, y, color=COLOURS["best"], linewidth=1.8, solid_joinstyle="round", zorder=3)


def _draw_dashed(axes: Axes, x: FloatArray, y: FloatArray) -> None:
    """Draw what they are held against."""
    axes.plot(x, y, color=COLOURS["ink"], linewidth=1.0, linestyle=(0, (4, 3)), zorder=2)


def _widen(axes: Axes, values: Sequence[float], least: float) -> None:
    """Take in all values with some room, and a range of `least` about them if they are all one."""
    low, high = min(values), max(values)
    room = max(0.1 * (high - low), least / 2)
    axes.set_ylim(low - room, high + room)


def _round_ticks(axes: Axes) -> None:
    """Mark a logarithmic axis at 1, 2, 5, 10, ..., written out; at powers of ten if those crowd."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

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
