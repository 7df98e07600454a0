"""Current arrows: positions, classes of speed, and outlines."""

import math
from dataclasses import dataclass

import numpy as np
import shapely

from pipeline._types import BoolArray, FloatArray, IndexArray
from pipeline.formats.figures.graticule import nice_step
from pipeline.formats.shared.result import RunResult

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


@dataclass(frozen=True)
class SpeedScale:
    """Classes of current speed, by their upper limits in m/s; the same on all maps of a run."""

    limits: tuple[float, ...]

    def classify(self, speed: FloatArray) -> IndexArray:
        """Index of the class of each speed (n,); speeds above the last limit are in the last."""
        return np.minimum(np.searchsorted(self.limits, speed), len(self.limits) - 1)

    @property
    def labels(self) -> tuple[str, ...]:
        """Label of each class in a legend, in m/s."""
        lower = (0.0, *self.limits[:-1])
        return tuple(f"{low:g}–{high:g}" for low, high in zip(lower, self.limits, strict=True))


@dataclass(frozen=True)
class Arrows:
    """A season's arrows: positions (n, 2) in the plane, on water, and the current (n, 2), m/s."""

    positions: FloatArray
    velocity: FloatArray
    spacing: float

    @property
    def speed(self) -> FloatArray:
        """Speed of each (n,), m/s."""
        return np.hypot(self.velocity[:, 0], self.velocity[:, 1])

    def outlines(self, scale: SpeedScale) -> list[shapely.Geometry]:
        """Outline the arrows of each class of speed, the weakest class first."""
        classes = scale.classify(self.speed)
        count = len(scale.limits)
        shares = _SHORTEST + (1 - _SHORTEST) * np.arange(1, count + 1) / count
        return [
            _outline(
                self.positions[classes == i], self.velocity[classes == i], share * self.spacing
            )
            for i, share in enumerate(_LENGTH_SHARE * shares)
        ]


def speed_scale(result: RunResult) -> SpeedScale:
    """Classes of equal, round width up to the strongest current drawn in any season."""
    strongest = max(float(arrows(result, e.season).speed.max(initial=0.0)) for e in result.plans)
    step = nice_step(max(strongest, _MIN_STRONGEST) / _MAX_CLASSES)
    count = max(1, math.ceil(strongest / step - 1e-9))
    return SpeedScale(tuple(round(step * (i + 1), 10) for i in range(count)))


def has_arrows(result: RunResult) -> bool:
    """Whether any season has arrows: still water has none."""
    return any(len(arrows(result, entry.season).speed) for entry in result.plans)


def arrows(result: RunResult, season: str) -> Arrows:
    """Arrows of the planner's own current, on a regular, staggered lattice over the water."""
    xmin, ymin, xmax, ymax = result.scene.chart.bounds
    spacing = max(xmax - xmin, ymax - ymin) / _COUNT_ACROSS
    x, y = np.meshgrid(
        np.arange(xmin + spacing / 2, xmax, spacing), np.arange(ymin + spacing / 2, ymax, spacing)
    )
    x[1::2] += spacing / 2
    positions = np.stack([x.ravel(), y.ravel()], axis=-1)
    positions = positions[on_water(result, positions)]
    if season not in result.scene.currents or not len(positions):
        return Arrows(np.empty((0, 2)), np.empty((0, 2)), spacing)
    velocity = np.asarray(result.scene.currents[season](positions), dtype=float)
    # Still water has no direction to show.
    moves = velocity.any(axis=1)
    return Arrows(positions[moves], velocity[moves], spacing)


def on_water(result: RunResult, positions: FloatArray) -> BoolArray:
    """Whether positions (n, 2) in the plane lie inside the chart and not on land."""
    chart, land = result.scene.chart, np.array(result.scene.land, dtype=object)
    water = np.asarray(shapely.contains_xy(chart.extent, positions))
    # The land is the query, not the tree: shapely prepares queries, and a coast may be long.
    on_land = shapely.STRtree(shapely.points(positions)).query(land, predicate="intersects")[1]
    water[on_land] = False
    return water


def _outline(positions: FloatArray, velocity: FloatArray, length: float) -> shapely.Geometry:
    """Outline arrows of one length, centred on their positions and pointing along the current."""
    if not len(positions):
        return shapely.MultiPolygon()
    angle = np.arctan2(velocity[:, 1], velocity[:, 0])
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], axis=1)
    corners = positions[:, None] + length * np.einsum("nij,kj->nki", turn, _ARROW)
    return shapely.multipolygons(shapely.polygons(corners))
