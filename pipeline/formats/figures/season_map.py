"""Maps of cases, and their layers: land, no-go zones, hazards, currents and routes.

`case_svg` is for a page, which sets the colours, light or dark; `overview_figure` is for files.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from markupsafe import Markup
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch

from pipeline._types import ArrayLike, Geometries
from pipeline.findings.haven_rows import haven_rows, stretch_line
from pipeline.findings.result import RankedRoute, RunCase, RunResult
from pipeline.findings.text import distance, fuel
from pipeline.formats.appearance import COLOURS, STATES, season_colour
from pipeline.formats.figures.chart_map import (
    draw_island_labels,
    draw_map,
    in_season_colour,
    map_figure,
    page_svg,
    patch,
    point,
    stroke,
)
from pipeline.formats.figures.map_marks import arrow_outlines, speed_labels, speed_limits

# Size, points, below which details of the coast are dropped: they can't be seen, and would make up
# most of a file.
DETAIL_PT = 0.25
SOFT_ALPHA = 0.38
# Opacity of a restricted area or traffic scheme, which must not hide what lies below.
ZONE_ALPHA = 0.06
# Dashes of its edge.
ZONE_DASHES = (0, (4, 2))


def chart_layers(axes: Axes, result: RunResult) -> list[Artist]:
    """Return the hard no-go zone and, over it, the original land, shoals and hazards.

    Details too small to see are dropped. In a planar scenario the no-go zone is the land itself.
    """
    detail = DETAIL_PT * point(axes)
    no_go = () if result.scenario.is_planar else result.water.chart.no_go
    zones = visible(np.array(no_go, dtype=object), detail)
    land = visible(np.array(result.water.land, dtype=object), detail)
    to_plane = result.water.projection.geometry_to_plane
    shoals = to_plane(np.array(result.no_go_water("shoal"), dtype=object))
    hazards = to_plane(np.array(result.no_go_water("hazard"), dtype=object))
    return [
        *([patch(zones, facecolor=COLOURS["nogo"], edgecolor="none", zorder=3.5)] if no_go else []),
        patch(
            land, facecolor=COLOURS["land"], edgecolor=COLOURS["coast"], linewidth=0.35, zorder=4
        ),
        patch(visible(shoals, detail), facecolor=COLOURS["shoal"], edgecolor="none", zorder=4),
        # The smallest are visible only by their edges.
        patch(
            hazards,
            facecolor=COLOURS["hazard"],
            edgecolor=COLOURS["hazard"],
            linewidth=0.8,
            zorder=4.2,
        ),
    ]


def soft_layer(axes: Axes, area: shapely.Geometry) -> Artist:
    """Return a soft no-go zone, translucent."""
    visible = shapely.simplify(area, DETAIL_PT * point(axes))
    return patch(visible, facecolor=COLOURS["soft"], edgecolor="none", alpha=SOFT_ALPHA, zorder=3)


def route_layers(routes: Sequence[RankedRoute]) -> list[Artist]:
    """Return a case's routes: the best thick on a halo, over all others, which are thin."""
    best = [one.route.path for one in routes if one.rank == 1]
    others = [one.route.path for one in reversed(routes) if one.rank > 1]
    return [
        *(stroke(path, COLOURS["other"], 0.7, 5) for path in others),
        *(layer for path in best for layer in haloed(path, COLOURS["best"])),
    ]


def haloed(path: ArrayLike, colour: str) -> list[Artist]:
    """Return a route as a line on a wider halo."""
    return [stroke(path, COLOURS["halo"], 4.0, 6), stroke(path, colour, 2.2, 7)]


def haven_layers(case: RunCase) -> list[Artist]:
    """Return ways to havens, what they cover of the best route, and the havens; empty if none."""
    coverage = case.coverage
    if coverage is None:
        return []
    own, halo = COLOURS["haven"], COLOURS["halo"]
    rows = [row for row in haven_rows(case) if row.kind in STATES]
    lines = [(stretch_line(case, row).coords, STATES[row.kind]) for row in rows]
    return [
        *(stroke(way.route.path, own, 0.8, 5.5) for way in coverage.diversions),
        *(stroke(line, state, 1.4, 7.2) for line, state in lines),
        *(
            Line2D(*haven.place[:, None], marker="o", color=halo, mec=own, mew=1.5, zorder=7.7)
            for haven in coverage.havens
        ),
    ]


def zone_layers(result: RunResult) -> list[Artist]:
    """Return restricted areas and traffic schemes, outlined, over the land."""
    return [
        patch(
            area,
            facecolor=(COLOURS[zone.kind], ZONE_ALPHA),
            edgecolor=COLOURS[zone.kind],
            linewidth=0.9,
            linestyle=ZONE_DASHES,
            zorder=4.5,
        )
        for zone, area in result.open_zones
    ]


def zone_handles(result: RunResult) -> list[Artist]:
    """Return the legend of the areas that `zone_layers` draws; empty if there are none."""
    kinds = {zone.kind for zone, _ in result.open_zones}
    return [
        Patch(
            facecolor=(COLOURS[kind], ZONE_ALPHA),
            edgecolor=COLOURS[kind],
            linestyle=ZONE_DASHES,
            label=text,
        )
        for kind, text in (
            ("restricted", "restricted"),
            ("traffic", "traffic scheme"),
            ("shut", "shut area"),
        )
        if kind in kinds
    ]


def land_handles(result: RunResult) -> list[Artist]:
    """Return the legend of land, hard no-go zone, and shoals and hazards if there are any."""
    shown = {"nogo": "hard no-go zone"} if not result.scenario.is_planar else {}
    shown |= {"shoal": "too shallow"} if result.no_go_water("shoal") else {}
    shown |= {"hazard": "hazards"} if result.no_go_water("hazard") else {}
    return [
        Patch(facecolor=COLOURS["land"], edgecolor=COLOURS["coast"], label=result.land_label),
        *(Patch(facecolor=COLOURS[role], label=name) for role, name in shown.items()),
    ]


def soft_handle(text: str = "soft no-go: the padding") -> Artist:
    """Return the legend of a soft no-go zone."""
    return Patch(facecolor=COLOURS["soft"], alpha=SOFT_ALPHA, label=text)


def line_handle(role: str, width_pt: float, text: str) -> Artist:
    """Return the legend of a line."""
    return Line2D([], [], color=COLOURS[role], linewidth=width_pt, label=text)


def visible(areas: Geometries, detail: float) -> Geometries:
    """Simplify areas (n,) by a detail, and drop those smaller than it."""
    west, south, east, north = shapely.bounds(areas).T
    return np.asarray(
        shapely.simplify(areas[np.maximum(east - west, north - south) >= detail], detail)
    )


def case_svg(case: RunCase, *, identity: str, label: str) -> Markup:
    """Draw a case as an `<svg>` element for a page; see `page_svg`."""
    figure, [(axes, sea)] = map_figure(case.run)
    draw_case(axes, sea, case)
    return page_svg(figure, identity=identity, label=label)


def overview_figure(cases: Sequence[RunCase]) -> Figure:
    """Draw cases of a run, at least one, side by side, each under its title."""
    figure, maps = map_figure(
        cases[0].run, _handles(cases), titles=[_titles(case) for case in cases], columns=len(cases)
    )
    for case, (axes, sea) in zip(cases, maps, strict=True):
        draw_case(axes, sea, case)
        in_season_colour(axes, season_colour(case.number))
    return figure


def _titles(case: RunCase) -> tuple[str, str]:
    """Return a case's title, and a line on the way, length and fuel of its best route.

    If the current is not the scenario's first choice, the title names the period of the current.
    """
    title = case.title
    if case.is_stand_in and (period := case.period_text):
        title = f"{title}: current of {period}"
    if not case.routes:
        return title, "no route"
    best = case.routes[0].metrics
    way = f"{best.main_passage}, " if best.way else ""
    return title, f"{way}{distance(best.length_m)}, fuel {fuel(best.fuel, best)}"


def draw_case(axes: Axes, sea: PathPatch, case: RunCase) -> None:
    """Draw currents, zones, land, routes (if it has any) and frame on a map of `map_figure`."""
    result, routes = case.run, case.routes
    layers = [*_area_layers(axes, case), *route_layers(routes), *haven_layers(case)]
    draw_island_labels(axes, result)
    for role, lines in case.marked(1).items():
        for line in lines:
            axes.plot(*line.T, "-", linewidth=2.0, color=COLOURS[role], zorder=7.5)
    axes.plot(
        *result.water.projection.to_plane(case.crossings(1)).T,
        "o", markersize=7.0, markerfacecolor="none", markeredgecolor=COLOURS["shut"], zorder=7.6,
    )  # fmt: skip
    draw_map(axes, sea, result, layers, [ranked.route.path for ranked in routes])


def _area_layers(axes: Axes, case: RunCase) -> list[Artist]:
    """Return currents, over them the best route's soft no-go zone, and land on top."""
    result, outlines = case.run, arrow_outlines(case, speed_limits(case.run))
    return [
        *(
            patch(outline, facecolor=COLOURS[f"speed{i}"], edgecolor="none", zorder=2)
            for i, outline in enumerate(outlines)
            if not outline.is_empty
        ),
        *(soft_layer(axes, best.route.soft_no_go) for best in case.routes[:1]),
        *chart_layers(axes, result),
        *zone_layers(result),
    ]


def _handles(cases: Sequence[RunCase]) -> list[Artist]:
    """Return the legend of lines, areas and speeds."""
    result = cases[0].run
    bests = [
        Line2D(
            [],
            [],
            color=season_colour(case.number),
            linewidth=2.2,
            label=f"best route, {case.name}" if len(cases) > 1 else "best route",
        )
        for case in cases
    ]
    handles: list[Artist] = [
        *bests,
        line_handle("other", 0.8, "other classes"),
        *land_handles(result),
        soft_handle("soft no-go"),
        *zone_handles(result),
    ]
    labels = speed_labels(speed_limits(result))
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
