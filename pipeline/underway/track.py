"""Where a vessel is beside its planned waypoints: distance from its leg, and when it was due there.

Legs are loxodromes, straight lines in Mercator's projection of the ellipsoid (Snyder, Map
Projections: A Working Manual, USGS 1987, eqs. 7-7 and 4-25), or geodesics, cut into pieces that
are taken as straight there. A distance is measured in the projection and divided by the scale at
the vessel. At 45 degrees the error is some 0.1 % for each 10 km of distance.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, get_args

import numpy as np
import pyproj

from pipeline._types import BoolArray, FloatArray, IntArray
from pipeline.formats.passage.tracks import Curve, in_pieces

_GEOD = pyproj.Geod(ellps="WGS84")
_ECCENTRICITY = math.sqrt(_GEOD.es)
# Longest piece of a leg, m: along it the scale hardly changes, so times are linear in the
# projection; and a geodesic at 85 degrees is within 90 m of it, at 75 degrees within 30 m.
_PIECE_M = 10_000.0
RECEIVER_M = 10.0
"""The error of a receiver, m."""
# Mercator's northing is finite up to here, degrees.
_MOST_LAT = 89.9


class Place(NamedTuple):
    """The nearest place of a track.

    `off_m` is the distance from it, positive to starboard; `limit_m` the cross-track limit on that
    side; `due_s` the time after departure when the vessel is due there; `leg` the index of the
    waypoint that the leg leaves; `ahead_m` the distance from the vessel to the goal.
    """

    off_m: float
    limit_m: float
    due_s: float
    leg: int
    ahead_m: float

    @property
    def is_within(self) -> bool:
        """Whether the vessel is within the leg's cross-track limit."""
        return abs(self.off_m) <= self.limit_m


@dataclass(frozen=True, eq=False)
class Track:
    """A route's waypoints, as m pieces of legs in Mercator's projection.

    `begin` and `step` (m, 2), metres of the projection; `limit_m` (2, m), to port and starboard,
    true metres; `due_s` (m,) begin of a piece after departure, and `lasts_s` (m,) its duration;
    `leg` (m,); `middle_deg`: positions are taken within 180 degrees of this longitude; `most_m_s`:
    highest speed over ground.
    """

    begin: FloatArray
    step: FloatArray
    limit_m: FloatArray
    due_s: FloatArray
    lasts_s: FloatArray
    leg: IntArray
    middle_deg: float
    most_m_s: float

    @classmethod
    def of(cls, waypoints: Sequence[dict[str, Any]]) -> "Track":
        """Return the track of GeoJSON features, in order.

        Raises
        ------
        KeyError, TypeError, ValueError
            They are no waypoints.
        """
        about = [one["properties"] for one in waypoints]
        lonlat = np.array([one["geometry"]["coordinates"] for one in waypoints], dtype=float)
        lonlat[:, 0] = np.unwrap(lonlat[:, 0], period=360)
        times = np.array([one["time_s"] for one in about], dtype=float)
        limits = [[one[side] for one in about[:-1]] for side in ("port_m", "starboard_m")]
        curve = about[0]["geometry_type"]
        if curve not in get_args(Curve):
            raise ValueError(f"geometry_type = {curve!r}")
        ends, leg = in_pieces(lonlat[:-1], lonlat[1:], curve, _PIECE_M)
        is_piece = np.diff(leg) == 0
        lengths = np.asarray(_GEOD.inv(*ends[:-1].T, *ends[1:].T)[2])[is_piece]
        leg = leg[:-1][is_piece]
        of_leg = np.maximum(np.bincount(leg, lengths), np.finfo(float).tiny)
        lasts = lengths / of_leg[leg] * np.diff(times)[leg]
        planar = _mercator(ends)
        return cls(
            begin=planar[:-1][is_piece],
            step=np.diff(planar, axis=0)[is_piece],
            limit_m=np.array(limits, dtype=float)[:, leg],
            due_s=times[0] + np.cumsum(lasts) - lasts,
            lasts_s=lasts,
            leg=leg,
            middle_deg=float(lonlat[:, 0].mean()),
            most_m_s=max(float(one["speed_over_ground_m_s"]) for one in about[:-1]),
        )

    def nearest(self, lon: float, lat: float, expected_s: float | None) -> Place:
        """Return the place nearest to a position in degrees.

        A track may pass a position several times. Only passages within whose limits it lies count,
        if there are any. The one with the due time nearest to `expected_s` (after departure) is
        taken. If `expected_s` is None, the nearest one is taken, or the first of several that are
        within a receiver's error.
        """
        east = self.middle_deg + (lon - self.middle_deg + 180) % 360 - 180
        at = _mercator(np.array([[east, lat]]))[0]
        apart = at - self.begin
        squared = np.einsum("ij,ij->i", self.step, self.step)
        share = np.einsum("ij,ij->i", apart, self.step) / np.where(squared > 0, squared, 1.0)
        share = np.clip(share, 0.0, 1.0)
        apart -= share[:, None] * self.step
        scale = _scale(lat)
        off = np.hypot(apart[:, 0], apart[:, 1]) / scale
        across = self.step[:, 0] * apart[:, 1] - self.step[:, 1] * apart[:, 0]
        starboard = (across <= 0).astype(np.int64)
        limit = self.limit_m[starboard, np.arange(len(off))]
        due = self.due_s + share * self.lasts_s
        late = np.maximum(off, RECEIVER_M) if expected_s is None else np.abs(due - expected_s)
        best = _passage(off, off <= limit, late)
        goal = self.begin[-1] + self.step[-1]
        return Place(
            off_m=float(off[best] * (1 if starboard[best] else -1)),
            limit_m=float(limit[best]),
            due_s=float(due[best]),
            leg=int(self.leg[best]),
            ahead_m=math.dist(at, goal) / scale,
        )

    def distance_m(self, one: tuple[float, float], other: tuple[float, float]) -> float:
        """Return the distance between two positions (degrees)."""
        return float(_GEOD.inv(*one, *other)[2])


def _passage(off: FloatArray, is_within: BoolArray, late: FloatArray) -> int:
    """Return the nearest piece of the passage that is the least late.

    A passage is a run of pieces within their limits. Without one, the nearest of all is returned.
    """
    within = np.flatnonzero(is_within)
    if len(within) == 0:
        return int(off.argmin())
    runs = np.split(within, np.flatnonzero(np.diff(within) > 1) + 1)
    nearest = [int(run[off[run].argmin()]) for run in runs]
    return min(nearest, key=lambda at: float(late[at]))


def _mercator(lonlat: FloatArray) -> FloatArray:
    """Return points (n, 2) in Mercator's projection, m."""
    sine = np.sin(np.radians(np.clip(lonlat[:, 1], -_MOST_LAT, _MOST_LAT)))
    north = np.arctanh(sine) - _ECCENTRICITY * np.arctanh(_ECCENTRICITY * sine)
    planar: FloatArray = _GEOD.a * np.stack([np.radians(lonlat[:, 0]), north], axis=-1)
    return planar


def _scale(lat: float) -> float:
    """Return the projection's scale at a latitude, degrees."""
    angle = math.radians(max(-_MOST_LAT, min(lat, _MOST_LAT)))
    return math.sqrt(1 - _GEOD.es * math.sin(angle) ** 2) / math.cos(angle)
