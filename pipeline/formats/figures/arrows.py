"""Current arrows: where they stand, their classes of speed, and their outlines."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.formats.figures.graticule import nice_step

if TYPE_CHECKING:
    import numpy.typing as npt
    from shapely.geometry.base import BaseGeometry

    from pipeline.formats.shared.result import RunResult

    FloatArray = npt.NDArray[np.float64]

_ACROSS = 22
_MOST_CLASSES = 5
# Arrows of the strongest class are _FILL of their spacing long; those of speed 0 would be
# _SHORTEST of that.
_FILL, _SHORTEST = 1.05, 0.35
# An arrow of length 1 along x, centred.
_ARROW = np.array(
    [
        *[(-0.5, -0.045), (0.12, -0.045), (0.08, -0.17), (0.5, 0.0)],
        *[(0.08, 0.17), (0.12, 0.045), (-0.5, 0.045)],
    ]
)


@dataclass(frozen=True)
class Arrows:
    """A season's arrows: places (n, 2) in the plane, on water, and the current (n, 2) m/s."""

    places: FloatArray
    velocity: FloatArray
    spacing: float

    @property
    def speed(self) -> FloatArray:
        """Speed of each (n,), m/s."""
        return np.hypot(self.velocity[:, 0], self.velocity[:, 1])

    def outlines(self, scale: SpeedScale) -> list[BaseGeometry]:
        """Outline the arrows of each class of speed, the weakest class first."""
        classes = scale.classify(self.speed)
        count = len(scale.limits)
        shares = _SHORTEST + (1 - _SHORTEST) * np.arange(1, count + 1) / count
        return [
            _outline(self.places[classes == i], self.velocity[classes == i], share * self.spacing)
            for i, share in enumerate(_FILL * shares)
        ]


@dataclass(frozen=True)
class SpeedScale:
    """The classes of current speed that all maps of a run share: their upper limits in m/s."""

    limits: tuple[float, ...]

    def classify(self, speed: FloatArray) -> npt.NDArray[np.intp]:
        """Class of each speed (n,), 0 to the last; what is above the last limit is in the last."""
        return np.minimum(np.searchsorted(self.limits, speed), len(self.limits) - 1)

    @property
    def labels(self) -> tuple[str, ...]:
        """How a legend names each class, in m/s."""
        lower = (0.0, *self.limits[:-1])
        return tuple(f"{low:g}–{high:g}" for low, high in zip(lower, self.limits, strict=True))


def speed_scale(result: RunResult) -> SpeedScale:
    """Classes of even, round width up to the strongest current drawn in any season."""
    strongest = max(float(arrows(result, e.season).speed.max(initial=0.0)) for e in result.plans)
    step = nice_step(max(strongest, 1e-3) / _MOST_CLASSES)
    count = max(1, math.ceil(strongest / step - 1e-9))
    return SpeedScale(tuple(round(step * (i + 1), 10) for i in range(count)))


def arrows(result: RunResult, season: str) -> Arrows:
    """Put arrows of the planner's own current on an even, staggered lattice over the water."""
    chart, land = result.scene.chart, np.array(result.scene.land, dtype=object)
    xmin, ymin, xmax, ymax = chart.bounds
    spacing = max(xmax - xmin, ymax - ymin) / _ACROSS
    x, y = np.meshgrid(
        np.arange(xmin + spacing / 2, xmax, spacing), np.arange(ymin + spacing / 2, ymax, spacing)
    )
    x[1::2] += spacing / 2
    places = np.stack([x.ravel(), y.ravel()], axis=-1)
    keep = shapely.contains_xy(chart.extent, places)
    if season not in result.scene.currents:
        keep[:] = False
    keep[shapely.STRtree(land).query(shapely.points(places), predicate="intersects")[0]] = False
    places = places[keep]
    velocity = result.scene.currents[season](places) if len(places) else np.empty((0, 2))
    velocity = np.asarray(velocity, dtype=float)
    # Water that stands still has no direction to show.
    moves = velocity.any(axis=1)
    return Arrows(places[moves], velocity[moves], spacing)


def _outline(places: FloatArray, velocity: FloatArray, length: float) -> BaseGeometry:
    """Outline arrows of one length, centred on their places and pointing along the current."""
    if not len(places):
        return shapely.MultiPolygon()
    angle = np.arctan2(velocity[:, 1], velocity[:, 0])
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], axis=1)
    corners = places[:, None] + length * np.einsum("nij,kj->nki", turn, _ARROW)
    return shapely.multipolygons(shapely.polygons(corners))
