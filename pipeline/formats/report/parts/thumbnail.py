"""Small map on a season's card: land, the best route, and the route compared with it, dashed."""

from collections.abc import Sequence

import numpy as np
import shapely
from markupsafe import Markup, escape

from pipeline._types import FloatArray
from pipeline.formats.report.live_map.encode import coarser, within
from pipeline.formats.shared.result import RankedRoute, RunResult

# Longer side of the picture, in its units, and size of the smallest details, as a share of it.
_SIDE, _DETAIL = 100.0, 0.006
_MAX_VERTICES = 900
# Ratio of the sides beyond which a chart is cropped around its routes.
_MAX_RATIO = 1.6


def thumbnail(result: RunResult, shown: Sequence[RankedRoute], label: str) -> Markup:
    """An `<svg>` element in the page's colours; the first route is in the season's colour.

    `label` says what the picture shows, and is escaped here.
    """
    frame = _frame(result, shown)
    xmin, ymin, xmax, ymax = frame
    scale = _SIDE / max(xmax - xmin, ymax - ymin)

    def placed(points: FloatArray) -> FloatArray:
        return np.round((points - [xmin, ymax]) * [scale, -scale], 1)

    box = shapely.intersection(result.scene.chart.extent, shapely.box(*frame))
    land = within(np.array(result.scene.land, dtype=object), box)
    land = coarser(land, _DETAIL * max(xmax - xmin, ymax - ymin), _MAX_VERTICES)
    rings = shapely.get_rings(shapely.get_parts(land))
    coast = "".join(_line(placed(shapely.get_coordinates(ring)[:-1])) + "Z" for ring in rings)
    detail = _DETAIL * max(xmax - xmin, ymax - ymin) / 2
    routes = [
        _line(
            placed(
                shapely.get_coordinates(
                    shapely.simplify(shapely.LineString(one.route.path), detail)
                )
            )
        )
        for one in shown
    ]
    water = _line(placed(shapely.get_coordinates(box)[:-1])) + "Z"
    start, goal = placed(result.scene.start), placed(result.scene.goal)
    width, height = scale * (xmax - xmin), scale * (ymax - ymin)
    classes = ("way", "rival")
    return Markup(  # noqa: S704 - numbers, and the label escaped
        f'<svg class="thumbnail" viewBox="0 0 {width:.1f} {height:.1f}" role="img" '
        f'aria-label="{escape(label)}"><path class="sea" d="{water}"/><path class="shore" '
        f'd="{coast}"/>'
        + "".join(
            f'<path class="{name}" d="{route}"/>'
            for name, route in reversed([*zip(classes, routes, strict=False)])
        )
        + f'<circle cx="{start[0]:g}" cy="{start[1]:g}" r="3"/>'
        f'<path class="goal" d="M{goal[0]:g} {goal[1] - 4:g}l4 4-4 4-4-4Z"/></svg>'
    )


def _frame(result: RunResult, shown: Sequence[RankedRoute]) -> tuple[float, float, float, float]:
    """The chart's bounds; if one side is much longer, it is cropped to what the routes need."""
    xmin, ymin, xmax, ymax = result.scene.chart.bounds
    paths = shapely.MultiLineString([shapely.LineString(one.route.path) for one in shown])
    low, high = np.array([xmin, ymin]), np.array([xmax, ymax])
    if shown:
        bounds = np.array(paths.bounds)
        size = high - low
        most = np.minimum(size, _MAX_RATIO * size.min())
        middle = (bounds[:2] + bounds[2:]) / 2
        half = np.maximum(most, 1.2 * (bounds[2:] - bounds[:2])) / 2
        low, high = np.maximum(low, middle - half), np.minimum(high, middle + half)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _line(points: FloatArray) -> str:
    """Points (n, 2) as the data of a path."""
    return "M" + "L".join(f"{x:g} {y:g}" for x, y in points)
