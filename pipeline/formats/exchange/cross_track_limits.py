"""Cross-track limits to either side of the legs, and radii of the turns at the waypoints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.formats.exchange.safe_corridor import cross, edges_of

if TYPE_CHECKING:
    import numpy.typing as npt
    from shapely.geometry.base import BaseGeometry

    from pipeline.formats.exchange.safe_corridor import Obstacles, SafeCorridor
    from pipeline.formats.exchange.tracks import Tracks

    FloatArray = npt.NDArray[np.float64]
    IntArray = npt.NDArray[np.intp]
    ObjectArray = npt.NDArray[np.object_]

# Maximum length of a turn's tangent, as a share of the leg: the turn at its other end needs the
# other half.
_MAX_LEG_SHARE = 0.5
# Number of edges of an area whose parts inside it are found at once.
_AT_ONCE = 4
# Maximum number of times that a turning radius is halved before the turn is given up.
_MAX_HALVINGS = 12


def cross_track_limits(
    legs: Tracks, soft_no_go: BaseGeometry, obstacles: Obstacles, cap: float
) -> tuple[FloatArray, FloatArray]:
    """Cross-track limits of each leg to port and to starboard (k,), metres of the plane.

    A limit is the distance from the leg, its ends included, to the nearest point on that side of V,
    the hard no-go zone (which covers all land) or the chart's edge; at most `cap`. V is the water
    from which a hard-over turn in the season's current could touch land, so within the limits the
    vessel can still turn away everywhere. 0 where the leg itself lies in V, as it may at start or
    goal: nothing is promised there.
    """
    lines = legs.lines
    areas = np.concatenate([_side_areas(legs, cap), _side_areas(legs, -cap)])
    both = np.concatenate([lines, lines])
    limits = np.full(len(both), cap)
    soft = shapely.linestrings(_edges_near(edges_of([soft_no_go]), areas))
    for edges, tree in (obstacles.edges, (soft, shapely.STRtree(soft))):
        area, edge = tree.query(areas, predicate="intersects")
        _lower_to(limits, areas, both, area, edges[edge])
    limits[shapely.intersects(soft_no_go, both)] = 0.0
    return limits[: len(lines)], limits[len(lines) :]


def turning_radii(legs: Tracks, corridor: SafeCorridor, radius: float) -> FloatArray:
    """Radius of the turn at each waypoint between two legs (k - 1,), metres of the plane.

    `radius`, or the largest of its halves, quarters and so on with which the turn stays inside the
    corridor and takes up at most half of each leg; 0 where none does.
    """
    lines = legs.lines
    before, after = lines[:-1], lines[1:]
    corner = shapely.get_coordinates(shapely.get_point(after, 0))
    inwards = shapely.get_coordinates(shapely.get_point(before, -2)) - corner
    outwards = shapely.get_coordinates(shapely.get_point(after, 1)) - corner
    angle = np.abs(np.arctan2(cross(inwards, outwards), (inwards * outwards).sum(axis=1)))
    # Tangent of half the change of course; 0 where the course does not change.
    slope = np.tan((np.pi - angle) / 2)
    max_tangent = _MAX_LEG_SHARE * np.minimum(shapely.length(before), shapely.length(after))
    radii = np.zeros(len(corner))
    for halving in range(_MAX_HALVINGS):
        size = radius / 2**halving
        tangent = size * slope
        candidates = (radii == 0) & (tangent <= max_tangent)
        corners = [
            shapely.get_coordinates(
                shapely.line_interpolate_point(before[candidates], -tangent[candidates])
            ),
            corner[candidates],
            shapely.get_coordinates(
                shapely.line_interpolate_point(after[candidates], tangent[candidates])
            ),
        ]
        triangles = shapely.convex_hull(shapely.linestrings(np.stack(corners, axis=1)))
        radii[np.flatnonzero(candidates)[shapely.covers(corridor.free, triangles)]] = size
    return radii


def _side_areas(legs: Tracks, width: float) -> ObjectArray:
    """Area to port of each leg (k,), to starboard with a negative width.

    Bounded by the leg, which is extended by the width at both ends, and reaching at least the width
    away from it.
    """
    starts = np.flatnonzero(np.diff(legs.leg, prepend=-1))
    ends = np.append(starts[1:], len(legs.leg)) - 1
    chord = legs.xy[ends] - legs.xy[starts]
    ahead = chord / np.linalg.norm(chord, axis=1)[:, None]
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
    # A leg bends away from its chord: without this offset the far side would be too close.
    offset = np.abs(((legs.xy - legs.xy[starts][legs.leg]) * aside[legs.leg]).sum(axis=1))
    far = aside * (width + np.sign(width) * np.maximum.reduceat(offset, starts))[:, None]
    back = legs.xy[starts] - abs(width) * ahead
    front = legs.xy[ends] + abs(width) * ahead
    rings = [
        np.vstack(
            [
                back[i],
                legs.xy[starts[i] : ends[i] + 1],
                front[i],
                front[i] + far[i],
                back[i] + far[i],
            ]
        )
        for i in range(len(starts))
    ]
    of_leg = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    return np.asarray(shapely.polygons(shapely.linearrings(np.concatenate(rings), indices=of_leg)))


def _lower_to(
    limits: FloatArray, areas: ObjectArray, legs: ObjectArray, area: IntArray, edges: ObjectArray
) -> None:
    """Lower the limit of an area to its leg's distance from the parts inside it of some edges.

    Edge i (n,) meets the area with index `area[i]`. What of an edge lies inside takes long to find,
    and is no nearer than the edge: the nearest edges come first, a few of each area at once, until
    no other can be nearer.
    """
    whole = shapely.distance(edges, legs[area])
    order = np.lexsort((whole, area))
    area, edges, whole = area[order], edges[order], whole[order]
    rank = np.arange(len(area)) - np.searchsorted(area, area)
    for first in range(0, int(rank.max(initial=-1)) + 1, _AT_ONCE):
        tried = (rank >= first) & (rank < first + _AT_ONCE) & (whole < limits[area])
        if not tried.any():
            break
        parts = shapely.intersection(areas[area[tried]], edges[tried])
        np.minimum.at(limits, area[tried], shapely.distance(parts, legs[area[tried]]))


def _edges_near(edges: FloatArray, areas: ObjectArray) -> FloatArray:
    """Edges (n, 2, 2) whose bounding box meets an area's: faster than a tree of all edges."""
    low, high = edges.min(axis=1), edges.max(axis=1)
    west, south, east, north = shapely.bounds(areas).T[..., None]
    apart = (low[:, 0] > east) | (high[:, 0] < west) | (low[:, 1] > north) | (high[:, 1] < south)
    return np.asarray(edges[~apart.all(axis=0)])
