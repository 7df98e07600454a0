"""Layers that maps share, and their legends: land, no-go, hazards, zones of the chart."""

from collections.abc import Sequence

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pipeline._types import ArrayLike, Geometries
from pipeline.formats.figures.artists import patch, point, stroke
from pipeline.formats.shared.palette import COLOURS
from pipeline.formats.shared.result import RankedRoute, RunResult

# Size, points, below which details of the coast are dropped: they can't be seen, and would make up
# most of a file.
DETAIL_PT = 0.25
SOFT_ALPHA = 0.38
ZONE_ALPHA, ZONE_DASHES = 0.06, (0, (4, 2))


def chart_layers(
    axes: Axes, result: RunResult, within: shapely.Geometry | None = None
) -> list[Artist]:
    """Hard no-go zone, over it the original land, shoals and hazards; in detail that can be seen.

    Clipped to an area if one is given. A planar scenario has no no-go zone beside its land.
    """
    detail = DETAIL_PT * point(axes)
    no_go = () if result.scenario.is_planar else result.scene.chart.no_go
    zones = visible(_clipped(no_go, within), detail)
    land = visible(_clipped(result.scene.land, within), detail)
    to_plane = result.scene.projection.geometry_to_plane
    shoals = to_plane(np.array(result.shoals, dtype=object))
    hazards = to_plane(np.array(result.hazards, dtype=object))
    return [
        *([patch(zones, facecolor=COLOURS["nogo"], edgecolor="none", zorder=3.5)] if no_go else []),
        patch(
            land, facecolor=COLOURS["land"], edgecolor=COLOURS["coast"], linewidth=0.35, zorder=4
        ),
        patch(
            visible(_clipped(shoals, within), detail),
            facecolor=COLOURS["shoal"],
            edgecolor="none",
            zorder=4,
        ),
        # The smallest are seen by their edges.
        patch(
            _clipped(hazards, within),
            facecolor=COLOURS["hazard"],
            edgecolor=COLOURS["hazard"],
            linewidth=0.8,
            zorder=4.2,
        ),
    ]


def soft_layer(axes: Axes, area: shapely.Geometry) -> Artist:
    """A soft no-go zone, translucent."""
    visible = shapely.simplify(area, DETAIL_PT * point(axes))
    return patch(visible, facecolor=COLOURS["soft"], edgecolor="none", alpha=SOFT_ALPHA, zorder=3)


def route_layers(routes: Sequence[RankedRoute]) -> list[Artist]:
    """A season's routes: the best thick on a halo, over all others, which are thin."""
    best = [one.route.path for one in routes if one.rank == 1]
    others = [one.route.path for one in reversed(routes) if one.rank > 1]
    return [
        *(stroke(path, COLOURS["other"], 0.7, 5) for path in others),
        *(layer for path in best for layer in haloed(path, COLOURS["best"])),
    ]


def haloed(
    path: ArrayLike, colour: str, widths_pt: tuple[float, float] = (4.0, 2.2), zorder: float = 7
) -> list[Artist]:
    """A route as a line on a wider halo."""
    halo, width = widths_pt
    return [stroke(path, COLOURS["halo"], halo, 6), stroke(path, colour, width, zorder)]


def zone_layers(result: RunResult) -> list[Artist]:
    """Restricted areas and traffic schemes, outlined, over the land."""
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
    """Legend of the areas that `zone_layers` draws; empty if there are none."""
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
    """Legend of land, of the hard no-go zone, and of shoals and hazards where there are any."""
    added = [Patch(facecolor=COLOURS["nogo"], label="hard no-go zone")]
    hazards = [Patch(facecolor=COLOURS["hazard"], label="hazards")]
    return [
        Patch(facecolor=COLOURS["land"], edgecolor=COLOURS["coast"], label=result.land_label),
        *([] if result.scenario.is_planar else added),
        *([Patch(facecolor=COLOURS["shoal"], label="too shallow")] if result.shoals else []),
        *(hazards if result.hazards else []),
    ]


def soft_handle(text: str = "soft no-go: the padding") -> Artist:
    """Legend of a soft no-go zone."""
    return Patch(facecolor=COLOURS["soft"], alpha=SOFT_ALPHA, label=text)


def line_handle(role: str, width_pt: float, text: str) -> Artist:
    """Legend of a line."""
    return Line2D([], [], color=COLOURS[role], linewidth=width_pt, label=text)


def visible(areas: Geometries, detail: float) -> Geometries:
    """Simplify areas (n,) by a detail, and drop those smaller than it."""
    west, south, east, north = shapely.bounds(areas).T
    return np.asarray(
        shapely.simplify(areas[np.maximum(east - west, north - south) >= detail], detail)
    )


def _clipped(
    areas: Sequence[shapely.Geometry] | Geometries, within: shapely.Geometry | None
) -> Geometries:
    """Clip areas to another area, if one is given."""
    areas = np.array(areas, dtype=object)
    if within is None:
        return areas
    near = areas[shapely.intersects(areas, within)]
    return np.asarray(shapely.intersection(near, within))
