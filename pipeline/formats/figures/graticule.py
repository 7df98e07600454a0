"""Meridians and parallels, or a grid in metres, and the scale bar of a map in the plane."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon

from pipeline._types import FloatArray
from pipeline.geo.projection import Projection

# Steps between lines, degrees: round numbers of degrees, minutes and seconds of arc.
_STEPS_DEG = (
    *(30.0, 20.0, 10.0, 5.0, 2.0, 1.0),
    *(minutes / 60 for minutes in (30, 20, 10, 5, 2, 1)),
    *(seconds / 3600 for seconds in (30, 20, 10, 5, 2, 1)),
)
# Minimum number of lines across the extent's longer side.
_MIN_LINES = 3.0
# Number of points along a line.
_SAMPLES = 65
# Maximum distance between a straight edge of the chart and the meridian that it stands for, as a
# share of the chart's diagonal.
_EDGE_TOLERANCE = 2.5e-3
# Relative rounding error that is allowed for, so that lines on the extent's edge are drawn.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class GridLine:
    """A meridian or parallel in the chart or on its edge: label, pieces (n, 2), place of the label.

    `foot` is the lowest point of a meridian, or the leftmost point of a parallel.
    """

    is_meridian: bool
    label: str
    parts: tuple[FloatArray, ...]
    foot: tuple[float, float]


def graticule(
    projection: Projection, extent: Polygon, *, in_metres: bool = False
) -> tuple[GridLine, ...]:
    """Meridians and parallels at a round step, at least three across the extent's longer side.

    With `in_metres`, lines at round numbers of metres along x and y.
    """
    xmin, ymin, xmax, ymax = extent.bounds
    if in_metres:
        step = nice_step(max(xmax - xmin, ymax - ymin) / (2 * _MIN_LINES), down=False)
        bounds = (xmin, ymin, xmax, ymax)
        return _lines(extent, bounds, step, lambda xy: xy, lambda value, *_: f"{value:g} m")
    # The edge of a region that begins at a whole degree is a meridian; the chart's edge is the
    # straight line beside it.
    tolerance = _EDGE_TOLERANCE * math.hypot(xmax - xmin, ymax - ymin)
    near = extent.buffer(tolerance, join_style="mitre")
    outline = projection.geometry_to_lonlat(shapely.segmentize(extent, extent.length / 256))
    west, south, east, north = outline.bounds
    widest = max(east - west, north - south)
    step = next((s for s in _STEPS_DEG if widest / s >= _MIN_LINES), _STEPS_DEG[-1])
    return _lines(near, (west, south, east, north), step, projection.to_plane, _degrees)


def scale_bar_m(
    projection: Projection, bounds: tuple[float, float, float, float]
) -> tuple[float, float]:
    """Length of a scale bar in true metres, a round number, and in metres of the plane.

    At most three tenths of the map's width; true in the middle of the map.
    """
    xmin, ymin, xmax, ymax = bounds
    middle = projection.to_lonlat(np.array([(xmin + xmax) / 2, (ymin + ymax) / 2]))
    true_m = projection.scale / float(projection.point_scale(middle))
    length_m = nice_step(0.3 * (xmax - xmin) * true_m, down=True)
    return length_m, length_m / true_m


def nice_step(near: float, *, down: bool = False) -> float:
    """Round a positive number up (or down) to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(near))
    steps = [factor * power for factor in (1.0, 2.0, 5.0, 10.0)]
    slack = _ROUNDING * near
    if down:
        return max(step for step in steps if step <= near + slack)
    return min(step for step in steps if step >= near - slack)


def _lines(
    extent: Polygon,
    bounds: tuple[float, float, float, float],
    step: float,
    to_plane: Callable[[FloatArray], FloatArray],
    label_of: Callable[[float, bool, float], str],
) -> tuple[GridLine, ...]:
    """Lines of constant first, then second coordinate, at multiples of `step` within `bounds`."""
    lines = []
    for axis in (0, 1):
        low, high = bounds[axis], bounds[axis + 2]
        across = np.linspace(bounds[1 - axis], bounds[3 - axis], _SAMPLES)
        first, last = math.ceil(low / step - _ROUNDING), math.floor(high / step + _ROUNDING)
        for value in step * np.arange(first, last + 1):
            points = np.empty((_SAMPLES, 2))
            points[:, axis], points[:, 1 - axis] = value, across
            parts = _clip(to_plane(points), extent)
            if parts:
                every = np.concatenate(parts)
                x, y = every[np.argmin(every[:, 1 - axis])]
                label = label_of(float(value), axis == 0, step)
                lines.append(GridLine(axis == 0, label, parts, (float(x), float(y))))
    return tuple(lines)


def _clip(line: FloatArray, extent: Polygon) -> tuple[FloatArray, ...]:
    """Clip a line (n, 2) to the extent."""
    inside = shapely.get_parts(shapely.intersection(shapely.LineString(line), extent))
    return tuple(
        shapely.get_coordinates(part)
        for part in inside
        if isinstance(part, shapely.LineString) and not part.is_empty
    )


def _degrees(value: float, is_meridian: bool, step: float) -> str:  # noqa: FBT001 - a callback
    """Format a longitude or latitude with the step's precision: 118°E, 10°30′N, 0°."""
    value = (value + 180) % 360 - 180 if is_meridian else value
    seconds = round(abs(value) * 3600)
    degrees, rest = divmod(seconds, 3600)
    text = f"{degrees}°"
    if step < 1 - _ROUNDING:
        text += f"{rest // 60:02d}′"
    if step < 1 / 60 - _ROUNDING:
        text += f"{rest % 60:02d}″"
    if seconds == 0 or (is_meridian and degrees == 180):
        return text
    return text + ("EW" if is_meridian else "NS")[0 if value > 0 else 1]
