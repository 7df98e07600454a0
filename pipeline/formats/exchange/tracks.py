"""Legs as a plotter draws and sails them: loxodromes, or geodesics in high latitudes.

A loxodrome keeps its course; it is a straight line in Mercator's projection of the ellipsoid. From
a straight line of the planner's plane it departs by some s²/8R·tan(latitude): 12 m on 60 km at 10
degrees, 20 km on 1,000 km at 45 degrees.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Literal

import numpy as np
import pyproj
import shapely

if TYPE_CHECKING:
    import numpy.typing as npt

    from pipeline.geo.projection import Projection

    FloatArray = npt.NDArray[np.float64]
    IntArray = npt.NDArray[np.int64]

Curve = Literal["Loxodrome", "Orthodrome"]
"""What RTZ calls a leg's geometry: of constant course, or the shortest way."""

# IEC 61174 warns that systems draw loxodromes differently above this latitude (degrees).
_HIGH_LATITUDE_DEG = 70.0
_GEOD = pyproj.Geod(ellps="WGS84")
# Beside tan(latitude): by so much the plane itself may bend lines, in earth radii.
_BEND_OF_THE_PLANE = 0.2
_FEWEST_M = 1.0


def curve_for(lonlat: FloatArray) -> Curve:
    """Choose what legs between points (n, 2), in degrees, are to be."""
    high = np.abs(lonlat[:, 1]).max() > _HIGH_LATITUDE_DEG
    return "Orthodrome" if high else "Loxodrome"


@dataclass(frozen=True)
class Tracks:
    """Legs between lon/lat points in degrees, k of them, as points along each.

    `lonlat` (m, 2) and `xy` (m, 2), in the planner's metres; `leg` (m,) says whose point it is, in
    order. Longitudes are continuous across 180 degrees.
    """

    lonlat: FloatArray
    xy: FloatArray
    leg: IntArray

    @property
    def lines(self) -> npt.NDArray[np.object_]:
        """One LineString a leg, in the plane."""
        return np.asarray(shapely.linestrings(self.xy, indices=self.leg))

    @property
    def chain(self) -> tuple[FloatArray, IntArray]:
        """Legs that follow each other as one line (n, 2) of the plane; indices (k + 1,) of ends."""
        begins = np.flatnonzero(np.diff(self.leg, prepend=-1))
        doubled = begins[1:]
        ends = np.append(begins - np.arange(len(begins)), len(self.leg) - len(begins))
        return np.delete(self.xy, doubled, axis=0), ends

    @property
    def length_m(self) -> FloatArray:
        """True length of each leg (k,)."""
        steps = _GEOD.inv(
            self.lonlat[:-1, 0], self.lonlat[:-1, 1], self.lonlat[1:, 0], self.lonlat[1:, 1]
        )[2]
        inside = self.leg[:-1] == self.leg[1:]
        total = np.zeros(int(self.leg[-1]) + 1)
        np.add.at(total, self.leg[:-1][inside], np.asarray(steps)[inside])
        return total


def tracks(
    begin: FloatArray, end: FloatArray, curve: Curve, projection: Projection, error_m: float
) -> Tracks:
    """Draw legs from points (k, 2) to points (k, 2), in degrees.

    The polylines in the plane are nowhere further than `error_m` true metres from the legs.
    """
    distance = np.asarray(_GEOD.inv(begin[:, 0], begin[:, 1], end[:, 0], end[:, 1])[2])
    pieces = np.maximum(1, np.ceil(distance / _step_m(begin, end, error_m))).astype(np.int64)
    leg = np.repeat(np.arange(len(begin)), pieces + 1)
    share = (np.arange(len(leg)) - (np.cumsum(pieces + 1) - pieces - 1)[leg]) / pieces[leg]
    between = _on_loxodrome if curve == "Loxodrome" else _on_geodesic
    lonlat = between(begin[leg], end[leg], share)
    return Tracks(lonlat, projection.to_plane(lonlat), leg)


def initial_course_deg(begin: FloatArray, end: FloatArray, curve: Curve) -> FloatArray:
    """True course (k,) in degrees on which legs begin; a loxodrome keeps it."""
    if curve == "Orthodrome":
        azimuth = np.asarray(_GEOD.inv(begin[:, 0], begin[:, 1], end[:, 0], end[:, 1])[0])
        return azimuth % 360
    north = (_northing(end[:, 1]) - _northing(begin[:, 1])) / _GEOD.a
    course: FloatArray = np.degrees(np.arctan2(np.radians(end[:, 0] - begin[:, 0]), north)) % 360
    return course


def _step_m(begin: FloatArray, end: FloatArray, error_m: float) -> FloatArray:
    """Length (k,) of a chord that is nowhere further than `error_m` from its leg."""
    latitude = np.minimum(np.maximum(np.abs(begin[:, 1]), np.abs(end[:, 1])), 89.0)
    bend = (np.tan(np.radians(latitude)) + _BEND_OF_THE_PLANE) / _GEOD.a
    step: FloatArray = np.maximum(np.sqrt(8 * error_m / bend), _FEWEST_M)
    return step


def _on_loxodrome(begin: FloatArray, end: FloatArray, share: FloatArray) -> FloatArray:
    """Points (m, 2) that divide loxodromes, each from its own begin to its own end."""
    low, high = _northing(begin[:, 1]), _northing(end[:, 1])
    latitude = _mercator().transform(
        np.zeros(len(share)), low + share * (high - low), direction="INVERSE"
    )[1]
    longitude = begin[:, 0] + share * (end[:, 0] - begin[:, 0])
    return _with_ends(np.stack([longitude, latitude], axis=-1), begin, end, share)


def _on_geodesic(begin: FloatArray, end: FloatArray, share: FloatArray) -> FloatArray:
    """Points (m, 2) that divide geodesics, each from its own begin to its own end."""
    azimuth, _, distance = _GEOD.inv(begin[:, 0], begin[:, 1], end[:, 0], end[:, 1])
    longitude, latitude, _ = _GEOD.fwd(begin[:, 0], begin[:, 1], azimuth, share * distance)
    longitude = longitude - 360 * np.round((longitude - begin[:, 0]) / 360)
    return _with_ends(np.stack([longitude, latitude], axis=-1), begin, end, share)


def _with_ends(
    points: FloatArray, begin: FloatArray, end: FloatArray, share: FloatArray
) -> FloatArray:
    """Put the legs' own ends in place of what rounding made of them."""
    first, last = (share <= 0)[:, None], (share >= 1)[:, None]
    return np.where(first, begin, np.where(last, end, points))


def _northing(latitude: FloatArray) -> FloatArray:
    """Mercator's northing in metres; finite short of the poles."""
    limited = np.clip(latitude, -90 + 1e-9, 90 - 1e-9)
    return np.asarray(_mercator().transform(np.zeros(len(limited)), limited)[1])


@lru_cache(maxsize=1)
def _mercator() -> pyproj.Transformer:
    """Lon/lat to Mercator's projection of the ellipsoid."""
    return pyproj.Transformer.from_crs("OGC:CRS84", "+proj=merc +datum=WGS84", always_xy=True)
