"""The legs of a route as a navigator counts them: course, distance, time, speed over ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from pipeline.formats.result import RankedRoute, RunResult

    FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Legs:
    """A route's n vertices, each with the leg that leaves it; NaN for the goal's, which has none.

    `lonlat` (n, 2) degrees; `course_deg` (n,) true, at the leg's start; `length_m` (n,) geodesic;
    `time_s` (n,) since departure; `speed_m_s` (n,) mean speed over ground.
    """

    lonlat: FloatArray
    course_deg: FloatArray
    length_m: FloatArray
    time_s: FloatArray
    speed_m_s: FloatArray


def legs(ranked: RankedRoute, result: RunResult) -> Legs:
    """Legs of a route; their times add up to the route's duration."""
    import pyproj

    lonlat = result.scene.projection.to_lonlat(np.asarray(ranked.route.path, dtype=float))
    azimuth, _, length = pyproj.Geod(ellps="WGS84").inv(
        lonlat[:-1, 0], lonlat[:-1, 1], lonlat[1:, 0], lonlat[1:, 1]
    )
    time = planned_times(ranked, result)
    return Legs(
        lonlat=lonlat,
        course_deg=np.append(np.asarray(azimuth) % 360, np.nan),
        length_m=np.append(length, np.nan),
        time_s=time,
        speed_m_s=np.append(mean_speed(np.asarray(length), time), np.nan),
    )


def planned_times(ranked: RankedRoute, result: RunResult) -> FloatArray:
    """Seconds since departure (n,) at which each vertex of a route's path is reached.

    At constant thrust fuel is spent evenly in time, so the duration is shared out among the legs
    by the time that the drift model gives each.
    """
    from renew.fuel import passage_times

    scene = result.scene
    passage = passage_times(
        np.asarray(ranked.route.path, dtype=float),
        scene.currents[ranked.season],
        scene.vessel,
        drift=result.scenario.planner.drift,
    )
    passage = passage * (ranked.metrics.duration_s / passage.sum())
    return np.concatenate([[0.0], np.cumsum(passage)])


def mean_speed(length_m: FloatArray, time_s: FloatArray) -> FloatArray:
    """Mean speed over ground (n - 1,) in m/s on legs between times (n,); NaN where none passes."""
    passage = np.diff(time_s)
    with np.errstate(divide="ignore", invalid="ignore"):
        speed: FloatArray = np.where(passage > 0, length_m / passage, np.nan)
    return speed
