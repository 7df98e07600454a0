"""Legs as a plotter draws and sails them: loxodromes, or geodesics in high latitudes.

A loxodrome has a constant course; it is a straight line in Mercator's projection of the ellipsoid.
It departs from a straight line of the planner's plane by about s²/8R·tan(latitude): 12 m on 60 km
at 10 degrees, 20 km on 1,000 km at 45 degrees.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
import pyproj
import shapely

from pipeline._types import FloatArray, Geometries, IntArray
from pipeline.geo.projection import Projection

Curve = Literal["Loxodrome", "Orthodrome"]
"""A leg's geometry in RTZ's terms: constant course, or shortest distance."""

# Decimals of degrees in the files, a millimetre: legs are checked at the positions written.
DECIMALS = 8
# Latitude (degrees) above which legs are orthodromes: IEC 61174 warns that systems draw loxodromes
# differently there.
_HIGH_LATITUDE_DEG = 70.0
_GEOD = pyproj.Geod(ellps="WGS84")
# Largest curvature of straight lines of the plane, 1 / earth radius; a loxodrome's is
# tan(latitude).
_PLANE_CURVATURE = 0.2
# Minimum length of a chord, metres.
_MIN_STEP_M = 1.0


def curve_for(lonlat: FloatArray) -> Curve:
    """Choose the geometry of legs between points (n, 2), in degrees."""
    high = np.abs(lonlat[:, 1]).max() > _HIGH_LATITUDE_DEG
    return "Orthodrome" if high else "Loxodrome"


@dataclass(frozen=True)
class Tracks:
    """k legs, drawn as m points along them, in order.

    `lonlat` (m, 2) degrees, continuous across 180; `xy` (m, 2) planner's metres; `leg` (m,) index
    of each point's leg.
    """

    lonlat: FloatArray
    xy: FloatArray
    leg: IntArray

    @property
    def lines(self) -> Geometries:
        """One LineString a leg, in the plane."""
        return np.asarray(shapely.linestrings(self.xy, indices=self.leg))

    @property
    def chain(self) -> tuple[FloatArray, IntArray]:
        """Consecutive legs as one line (n, 2) of the plane; indices (k + 1,) of the legs' ends."""
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

    The polylines in the plane are within `error_m` true metres of the legs everywhere.
    """
    lonlat, leg = in_pieces(begin, end, curve, _step_m(begin, end, error_m))
    return Tracks(lonlat, projection.to_plane(lonlat), leg)


def in_pieces(
    begin: FloatArray, end: FloatArray, curve: Curve, most_m: FloatArray | float
) -> tuple[FloatArray, IntArray]:
    """Cut legs from points (k, 2) to points (k, 2), degrees, into pieces of at most `most_m` (k,).

    Return the ends of the pieces (m, 2), degrees, and the leg of each (m,).
    """
    distance = np.asarray(_GEOD.inv(begin[:, 0], begin[:, 1], end[:, 0], end[:, 1])[2])
    pieces = np.maximum(1, np.ceil(distance / most_m)).astype(np.int64)
    leg = np.repeat(np.arange(len(begin)), pieces + 1)
    share = (np.arange(len(leg)) - (np.cumsum(pieces + 1) - pieces - 1)[leg]) / pieces[leg]
    between = _on_loxodrome if curve == "Loxodrome" else _on_geodesic
    lonlat = between(begin, end, leg, share)
    # The computed ends are rounded: the legs' exact ends take their place.
    lonlat[share <= 0], lonlat[share >= 1] = begin, end
    return lonlat, leg


@dataclass(frozen=True)
class Drawing:
    """How legs are drawn: curve, and maximum error in true metres."""

    projection: Projection
    curve: Curve
    error_m: float

    def lonlat(self, xy: FloatArray) -> FloatArray:
        """Return degrees (n, 2) of planar points, as they will be written."""
        return np.round(self.projection.to_lonlat(xy), DECIMALS)

    def lines(self, begin: FloatArray, end: FloatArray) -> Geometries:
        """Return legs from degrees (k, 2) to degrees (k, 2), as lines of the plane."""
        return tracks(begin, end, self.curve, self.projection, self.error_m).lines


def initial_course_deg(begin: FloatArray, end: FloatArray, curve: Curve) -> FloatArray:
    """Return true course (k,) in degrees at the start of each leg; constant along a loxodrome."""
    if curve == "Orthodrome":
        azimuth = np.asarray(_GEOD.inv(begin[:, 0], begin[:, 1], end[:, 0], end[:, 1])[0])
        return azimuth % 360
    north = (_northing(end[:, 1]) - _northing(begin[:, 1])) / _GEOD.a
    course: FloatArray = np.degrees(np.arctan2(np.radians(end[:, 0] - begin[:, 0]), north)) % 360
    return course


def _step_m(begin: FloatArray, end: FloatArray, error_m: float) -> FloatArray:
    """Return the length (k,) of chords that are within `error_m` of their leg everywhere."""
    latitude = np.minimum(np.maximum(np.abs(begin[:, 1]), np.abs(end[:, 1])), 89.0)
    bend = (np.tan(np.radians(latitude)) + _PLANE_CURVATURE) / _GEOD.a
    step: FloatArray = np.maximum(np.sqrt(8 * error_m / bend), _MIN_STEP_M)
    return step


def _on_loxodrome(
    begin: FloatArray, end: FloatArray, leg: IntArray, share: FloatArray
) -> FloatArray:
    """Return points (m, 2) at shares of some of the loxodromes (k,) from `begin` to `end`."""
    low, high = _northing(begin[:, 1])[leg], _northing(end[:, 1])[leg]
    latitude = _mercator().transform(
        np.zeros(len(share)), low + share * (high - low), direction="INVERSE"
    )[1]
    longitude = begin[leg, 0] + share * (end[leg, 0] - begin[leg, 0])
    return np.stack([longitude, latitude], axis=-1)


def _on_geodesic(
    begin: FloatArray, end: FloatArray, leg: IntArray, share: FloatArray
) -> FloatArray:
    """Return points (m, 2) at shares of some of the geodesics (k,) from `begin` to `end`."""
    azimuth, _, distance = _GEOD.inv(begin[:, 0], begin[:, 1], end[:, 0], end[:, 1])
    first = begin[leg]
    longitude, latitude, _ = _GEOD.fwd(
        first[:, 0], first[:, 1], azimuth[leg], share * distance[leg]
    )
    longitude = longitude - 360 * np.round((longitude - first[:, 0]) / 360)
    return np.stack([longitude, latitude], axis=-1)


def _northing(latitude: FloatArray) -> FloatArray:
    """Return Mercator's northing in metres; latitudes are limited so that it stays finite."""
    limited = np.clip(latitude, -90 + 1e-9, 90 - 1e-9)
    return np.asarray(_mercator().transform(np.zeros(len(limited)), limited)[1])


@lru_cache(maxsize=1)
def _mercator() -> pyproj.Transformer:
    """Return the transformer from lon/lat to Mercator's projection of the ellipsoid."""
    return pyproj.Transformer.from_crs("OGC:CRS84", "+proj=merc +datum=WGS84", always_xy=True)
