"""Marks on maps besides routes: a graticule or a grid in metres, a scale bar, current arrows."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon

from pipeline._types import BoolArray, FloatArray
from pipeline.findings.result import RunCase, RunResult
from pipeline.geo.projection import Projection
from pipeline.model import Water

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
    """A meridian or parallel: its label, its pieces (n, 2) inside the chart, the label's place.

    `foot` is the lowest point of a meridian, or the leftmost point of a parallel.
    """

    is_meridian: bool
    label: str
    parts: tuple[FloatArray, ...]
    foot: tuple[float, float]


def graticule(
    projection: Projection, extent: Polygon, *, in_metres: bool = False
) -> tuple[GridLine, ...]:
    """Return meridians and parallels at a round step, at least three across the longer side.

    With `in_metres`, lines at round numbers of metres along x and y.
    """
    xmin, ymin, xmax, ymax = extent.bounds
    if in_metres:
        step = nice_step(max(xmax - xmin, ymax - ymin) / (2 * _MIN_LINES), down=False)
        bounds = (xmin, ymin, xmax, ymax)
        return _lines(extent, bounds, step, lambda xy: xy, lambda value, *_: f"{value:g} m")
    # A region's edge at a whole degree is a meridian. The chart's edge is a straight line beside
    # it, so that the meridian may lie a little outside the chart.
    tolerance = _EDGE_TOLERANCE * math.hypot(xmax - xmin, ymax - ymin)
    near = extent.buffer(tolerance, join_style="mitre")
    outline = projection.geometry_to_lonlat(shapely.segmentize(extent, extent.length / 256))
    west, south, east, north = outline.bounds
    most = max(east - west, north - south) / _MIN_LINES
    step = next((one for one in _STEPS_DEG if one <= most), _STEPS_DEG[-1])
    return _lines(near, (west, south, east, north), step, projection.to_plane, _degrees)


def scale_bar_m(
    projection: Projection, bounds: tuple[float, float, float, float]
) -> tuple[float, float]:
    """Return the length of a scale bar in true metres, a round number, and in metres of the plane.

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
    """Return lines of constant x, then of constant y, at multiples of `step` within `bounds`."""
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


# Number of arrows along the chart's longer side.
_COUNT_ACROSS = 22
_MAX_CLASSES = 5
# The classes of speed reach at least to this current, m/s: a weaker one hardly matters.
_MIN_STRONGEST = 0.05
# Length of the strongest class's arrows, as a share of their spacing.
_LENGTH_SHARE = 1.05
# Length of an arrow of speed 0, as a share of the strongest's.
_SHORTEST = 0.35
# An arrow of length 1 along x, centred.
_ARROW = np.array(
    [
        *[(-0.5, -0.045), (0.12, -0.045), (0.08, -0.17), (0.5, 0.0)],
        *[(0.08, 0.17), (0.12, 0.045), (-0.5, 0.045)],
    ]
)


def speed_limits(result: RunResult) -> tuple[float, ...]:
    """Return the upper limits of the classes of current speed, m/s, the same on all maps of a run.

    They are of equal, round width, up to the strongest current drawn in any case.
    """
    strongest = max(float(np.hypot(*arrows(case)[1].T).max(initial=0.0)) for case in result.cases)
    step = nice_step(max(strongest, _MIN_STRONGEST) / _MAX_CLASSES)
    count = max(1, math.ceil(strongest / step - 1e-9))
    return tuple(round(step * (i + 1), 10) for i in range(count))


def speed_labels(limits: tuple[float, ...]) -> tuple[str, ...]:
    """Label each class of current speed in a legend, in m/s."""
    lower = (0.0, *limits[:-1])
    return tuple(f"{low:g}–{high:g}" for low, high in zip(lower, limits, strict=True))


def arrows(case: RunCase) -> tuple[FloatArray, FloatArray]:
    """Return places (n, 2) on water, in a staggered lattice, and the planner's current there, m/s.

    Places of still water, which has no direction to show, are left out.
    """
    water = case.run.water
    xmin, ymin, xmax, ymax = water.chart.bounds
    spacing = _spacing(case)
    x, y = np.meshgrid(
        np.arange(xmin + spacing / 2, xmax, spacing), np.arange(ymin + spacing / 2, ymax, spacing)
    )
    x[1::2] += spacing / 2
    places = np.stack([x.ravel(), y.ravel()], axis=-1)
    places = places[on_water(water, places)]
    if case.planned is None or not len(places):
        return np.empty((0, 2)), np.empty((0, 2))
    velocity = np.asarray(case.planned.current(places), dtype=float)
    moves = velocity.any(axis=1)
    return places[moves], velocity[moves]


def arrow_outlines(case: RunCase, limits: tuple[float, ...]) -> list[shapely.Geometry]:
    """Outline a case's arrows of each class of speed, given by upper limits; the weakest first."""
    places, velocity = arrows(case)
    count = len(limits)
    classes = np.minimum(np.searchsorted(limits, np.hypot(*velocity.T)), count - 1)
    shares = _SHORTEST + (1 - _SHORTEST) * np.arange(1, count + 1) / count
    lengths = _LENGTH_SHARE * shares * _spacing(case)
    return [
        _outline(places[classes == i], velocity[classes == i], length)
        for i, length in enumerate(lengths)
    ]


def _spacing(case: RunCase) -> float:
    """Return the distance between arrows, metres of the plane."""
    xmin, ymin, xmax, ymax = case.run.water.chart.bounds
    return max(xmax - xmin, ymax - ymin) / _COUNT_ACROSS


def on_water(water: Water, positions: FloatArray) -> BoolArray:
    """Whether positions (n, 2) in the plane lie inside the chart and not on land."""
    chart, land = water.chart, np.array(water.land, dtype=object)
    inside = np.asarray(shapely.contains_xy(chart.extent, positions))
    # The points are the tree: shapely prepares the query, which helps where the coast is long.
    on_land = shapely.STRtree(shapely.points(positions)).query(land, predicate="intersects")[1]
    inside[on_land] = False
    return inside


def _outline(positions: FloatArray, velocity: FloatArray, length: float) -> shapely.Geometry:
    """Outline arrows of one length, centred on their positions and pointing along the current."""
    if not len(positions):
        return shapely.MultiPolygon()
    angle = np.arctan2(velocity[:, 1], velocity[:, 0])
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], axis=1)
    corners = positions[:, None] + length * np.einsum("nij,kj->nki", turn, _ARROW)
    return shapely.multipolygons(shapely.polygons(corners))
