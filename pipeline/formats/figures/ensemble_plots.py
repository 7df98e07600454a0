"""How sure a side is, drawn: the fans of fuel by side, and a map of the members' best routes."""

import numpy as np
import shapely
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from pipeline._types import FloatArray
from pipeline.findings import text
from pipeline.findings.ensembles import way_text
from pipeline.findings.result import RankedRoute, RunResult
from pipeline.formats.figures.artists import PLAIN_PT, drawable, stroke
from pipeline.formats.figures.chart_map import draw_map, map_figure
from pipeline.formats.figures.plots import TEXT_PT, plot_panels, plot_title, plot_x_label
from pipeline.formats.figures.season_map import chart_layers, zone_layers
from pipeline.formats.palette import COLOURS
from pipeline.model import EnsembleFigures

# Height of a route's row (points), and largest number of rows.
_ROW_PT, _MAX_ROWS = 30.0, 6
# Ratio to the mean of the route taken from which a route is only drawn if it is the best somewhere;
# largest number of letters of a way.
_MUCH_DEARER, _MAX_WAY = 1.3, 52
# Widths of a route's line on the map (points): with no member, and what all of them add.
_THIN_PT, _THICK_PT = 0.8, 6.0
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
