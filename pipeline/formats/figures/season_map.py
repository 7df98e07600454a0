"""Maps of seasons: currents, land, the best route's soft no-go zone, and all routes.

`season_svg` is for a page, which sets the colours, light or dark; `overview_figure` is for files.
"""

from collections.abc import Sequence

from markupsafe import Markup
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch

from pipeline.formats.figures import map_layers
from pipeline.formats.figures.arrows import arrows, speed_scale
from pipeline.formats.figures.artists import draw_island_labels, in_season_colour, page_svg, patch
from pipeline.formats.figures.chart_map import draw_map, map_figure
from pipeline.formats.shared.palette import COLOURS, season_colour
from pipeline.formats.shared.result import RunResult
from pipeline.formats.shared.text import distance, fuel


def season_svg(result: RunResult, season: str, *, identity: str, label: str) -> Markup:
    """Draw a season as an `<svg>` element for a page; see `page_svg`."""
    figure, [(axes, sea)] = map_figure(result)
    draw_season(axes, sea, result, season)
    return page_svg(figure, identity=identity, label=label)


def overview_figure(
    result: RunResult, seasons: Sequence[str] = (), width_pt: float | None = None
) -> Figure:
    """Draw seasons side by side, each under its title; all seasons if none are given."""
    chosen = seasons or [entry.season for entry in result.plans]
    figure, maps = map_figure(
        result,
        _handles(result, chosen),
        titles=[_titles(result, season) for season in chosen],
        columns=len(chosen),
        width_pt=width_pt,
    )
    for season, (axes, sea) in zip(chosen, maps, strict=True):
        draw_season(axes, sea, result, season)
        in_season_colour(axes, season_colour(result.season_index(season)))
    return figure


def _titles(result: RunResult, season: str) -> tuple[str, str]:
    """Return a season's title, and a line on the way, length and fuel of its best route.

    If the current is not the scenario's first choice, the title names the period of the current.
    """
    title = result.season_title(season)
    if result.is_stand_in(season) and (period := result.period_text(season)):
        title = f"{title}: current of {period}"
    ranked = result.season_routes(season)
    if not ranked:
        return title, "no route"
    best = ranked[0].metrics
    way = f"{best.main_passage}, " if best.way else ""
    return title, f"{way}{distance(best.length_m)}, fuel {fuel(best.fuel)}"


def draw_season(axes: Axes, sea: PathPatch, result: RunResult, season: str) -> None:
    """Draw currents, zones, land, routes (if it has any) and frame on a map of `map_figure`."""
    routes = result.season_routes(season)
    layers = [*_area_layers(axes, result, season), *map_layers.route_layers(routes)]
    draw_island_labels(axes, result)
    axes.plot(
        *result.scene.projection.to_plane(result.crossings(season, 1)).T,
        "o", markersize=7.0, markerfacecolor="none", markeredgecolor=COLOURS["shut"], zorder=7.6,
    )  # fmt: skip
    draw_map(axes, sea, result, layers, [ranked.route.path for ranked in routes])


def _area_layers(axes: Axes, result: RunResult, season: str) -> list[Artist]:
    """Currents, over them the best route's soft no-go zone, and land on top."""
    outlines = arrows(result, season).outlines(speed_scale(result))
    return [
        *(
            patch(outline, facecolor=COLOURS[f"speed{i}"], edgecolor="none", zorder=2)
            for i, outline in enumerate(outlines)
            if not outline.is_empty
        ),
        *(
            map_layers.soft_layer(axes, best.route.soft_no_go)
            for best in result.season_routes(season)[:1]
        ),
        *map_layers.chart_layers(axes, result),
        *map_layers.zone_layers(result),
    ]


def _handles(result: RunResult, seasons: Sequence[str]) -> list[Artist]:
    """Legend of lines, areas and speeds."""
    bests = [
        Line2D(
            [],
            [],
            color=season_colour(result.season_index(season)),
            linewidth=2.2,
            label=f"best route, {season}" if len(seasons) > 1 else "best route",
        )
        for season in seasons
    ]
    handles: list[Artist] = [
        *bests,
        map_layers.line_handle("other", 0.8, "other classes"),
        *map_layers.land_handles(result),
        map_layers.soft_handle("soft no-go"),
        *map_layers.zone_handles(result),
    ]
    labels = speed_scale(result).labels
    handles += [
        Line2D(
            [],
            [],
            color=COLOURS[f"speed{i}"],
            marker=">",
            markersize=5,
            label=text if i + 1 < len(labels) else f"{text} m/s",
        )
        for i, text in enumerate(labels)
    ]
    return handles
