"""A season planned in several ways, side by side: few and many classes, kinds of padding."""

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.formats.figures import map_layers
from pipeline.formats.figures.artists import POINTS_PER_INCH, SMALL_PT, drawable
from pipeline.formats.figures.chart_map import draw_map, map_figure
from pipeline.formats.shared.palette import COLOURS
from pipeline.formats.shared.result import RankedRoute, RunResult
from pipeline.formats.shared.text import clearance, distance, fuel

# Characters of a reason, and least number in a line; mean width of a letter as a share of its size,
# with an allowance for the box's edges.
_MAX_REASON, _MIN_LETTERS, _LETTER_SHARE = 300, 20, 0.65


@dataclass(frozen=True)
class Variant:
    """A run with other options, or why it has no route."""

    title: str
    result: RunResult | None
    failure: str = ""


def variants_figure(
    result: RunResult,
    season: str,
    variants: Sequence[Variant],
    *,
    with_padding: bool,
    width_pt: float | None = None,
) -> Figure:
    """Draw a season's routes in each variant on a map of its own, with the soft no-go zone.

    A variant without a route says what rejected it: in short in its title, and on its map.
    """
    handles = map_layers.land_handles(result)
    if any(_ranked(one, season) for one in variants):
        handles += [map_layers.soft_handle()] if with_padding else []
        handles += [
            map_layers.line_handle("best", 2.2, "best route"),
            map_layers.line_handle("other", 0.8, "other classes"),
        ]
    figure, maps = map_figure(
        result,
        handles,
        titles=[(one.title, _figures(one, season)) for one in variants],
        columns=len(variants),
        width_pt=width_pt,
    )
    for one, (axes, sea) in zip(variants, maps, strict=True):
        ranked = _ranked(one, season)
        layers = [
            *map_layers.chart_layers(axes, one.result or result),
            *map_layers.route_layers(ranked),
        ]
        if with_padding and ranked:
            layers.append(map_layers.soft_layer(axes, ranked[0].route.soft_no_go))
        draw_map(axes, sea, result, layers, [r.route.path for r in ranked])
        if not ranked:
            _write_reason(axes, _reason(one, season))
    return figure


def _ranked(variant: Variant, season: str) -> tuple[RankedRoute, ...]:
    """A variant's routes, best first."""
    return variant.result.season_routes(season) if variant.result else ()


def _reason(variant: Variant, season: str) -> str:
    """Why a variant has no route, without the remedy."""
    reason = variant.failure
    if variant.result is not None:
        failures = (one.failure for one in variant.result.plans if one.season == season)
        reason = next(failures, "") or "no route was found"
    # The figure shows one season only.
    return re.sub(r"^seasons? '[^:]*': ", "", reason).partition(". ")[0].rstrip(" :")


def _write_reason(axes: Axes, reason: str) -> None:
    """Write why there is no route into the middle of a map."""
    width_in = axes.get_position().width * axes.figure.bbox.width / axes.figure.dpi
    letters = max(_MIN_LETTERS, int(width_in * POINTS_PER_INCH / (_LETTER_SHARE * SMALL_PT)))
    lines = textwrap.wrap(drawable(reason, _MAX_REASON), letters)
    axes.text(
        0.5,
        0.5,
        "\n".join(lines),
        transform=axes.transAxes,
        ha="center",
        va="center",
        fontsize=SMALL_PT,
        color=COLOURS["ink"],
        parse_math=False,
        zorder=10,
        bbox={"facecolor": COLOURS["halo"], "edgecolor": COLOURS["frame"], "boxstyle": "round"},
    )


def _figures(variant: Variant, season: str) -> str:
    """A variant's fuel, length and clearance, or why it has no route."""
    ranked = _ranked(variant, season)
    if not ranked:
        return drawable(f"no route: {_reason(variant, season).partition(': ')[0]}")
    best = ranked[0].metrics
    return (
        f"fuel {fuel(best.fuel)}, {distance(best.length_m)}, clear by {clearance(best.clearance_m)}"
    )
