"""How much room the legs leave: cross-track limits on either side, and turns at the waypoints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.formats.exchange.safe_corridor import cross, edges_of

if TYPE_CHECKING:
    import numpy.typing as npt
    from shapely.geometry.base import BaseGeometry

    from pipeline.formats.exchange.safe_corridor import Lane, Shores
    from pipeline.formats.exchange.tracks import Tracks

    FloatArray = npt.NDArray[np.float64]
    ObjectArray = npt.NDArray[np.object_]

# A turn takes up no more than this share of a leg: its neighbour may take as much.
_SHARE_OF_LEG = 0.5
_MOST_HALVINGS = 12


def rooms(
    legs: Tracks, soft_no_go: BaseGeometry, shores: Shores, cap: float
) -> tuple[FloatArray, FloatArray]:
    """Room of each leg to port and to starboard (k,), in metres of the plane, at most `cap`.

    On its side a leg can be left by so much before V, the planner's hard no-go zone (which covers
    all land) or the edge of the chart is met, round its ends as well. V is what a hard-over turn
    in the season's current needs to stay off land: so anywhere in this corridor the vessel can
    still turn away. 0 where the leg lies in V itself, as it may at a start or a goal: nothing is
    promised there.
    """
    lines = legs.lines
    zones = np.concatenate([_beside(legs, cap), _beside(legs, -cap)])
    both = np.concatenate([lines, lines])
    room = np.full(len(both), cap)
    soft = shapely.linestrings(_near(edges_of([soft_no_go]), zones))
    for edges, tree in (shores.edges, (soft, shapely.STRtree(soft))):
        zone, edge = tree.query(zones, predicate="intersects")
        met = shapely.intersection(zones[zone], edges[edge])
        np.minimum.at(room, zone, shapely.distance(met, both[zone]))
    room[shapely.intersects(soft_no_go, both)] = 0.0
    return room[: len(lines)], room[len(lines) :]


def turning_radii(legs: Tracks, lane: Lane, radius: float) -> FloatArray:
    """Radius of the turn at each waypoint between two legs (k - 1,), in metres of the plane.

    `radius`, or the largest of its halves, quarters and so on with which the turn cuts the corner
    inside the lane and leaves each leg at least its half; 0 where none does.
    """
    lines = legs.lines
    before, after = lines[:-1], lines[1:]
    corner = shapely.get_coordinates(shapely.get_point(after, 0))
    inwards = shapely.get_coordinates(shapely.get_point(before, -2)) - corner
    outwards = shapely.get_coordinates(shapely.get_point(after, 1)) - corner
    angle = np.abs(np.arctan2(cross(inwards, outwards), (inwards * outwards).sum(axis=1)))
    # Half the change of course; where it is none, any turn is a straight line.
    slope = np.tan((np.pi - angle) / 2)
    longest = _SHARE_OF_LEG * np.minimum(shapely.length(before), shapely.length(after))
    found = np.zeros(len(corner))
    for halving in range(_MOST_HALVINGS):
        size = radius / 2**halving
        tangent = size * slope
        open_ = (found == 0) & (tangent <= longest)
        ends = [
            shapely.get_coordinates(shapely.line_interpolate_point(before[open_], -tangent[open_])),
            corner[open_],
            shapely.get_coordinates(shapely.line_interpolate_point(after[open_], tangent[open_])),
        ]
        triangles = shapely.convex_hull(shapely.linestrings(np.stack(ends, axis=1)))
        found[np.flatnonzero(open_)[shapely.covers(lane.free, triangles)]] = size
    return found


def _beside(legs: Tracks, width: float) -> ObjectArray:
    """The water to port of each leg (k,), or with a negative width to starboard.

    Bounded by the leg, drawn out by the width at both ends, and so far from it.
    """
    starts = np.flatnonzero(np.diff(legs.leg, prepend=-1))
    ends = np.append(starts[1:], len(legs.leg)) - 1
    chord = legs.xy[ends] - legs.xy[starts]
    ahead = chord / np.linalg.norm(chord, axis=1)[:, None]
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
    # Beyond the bend of the leg, so that the far side is nowhere too near.
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


def _near(edges: FloatArray, zones: ObjectArray) -> FloatArray:
    """Those of the edges (n, 2, 2) whose box meets a zone's: quicker than a tree of them all."""
    low, high = edges.min(axis=1), edges.max(axis=1)
    west, south, east, north = shapely.bounds(zones).T[..., None]
    apart = (low[:, 0] > east) | (high[:, 0] < west) | (low[:, 1] > north) | (high[:, 1] < south)
    return np.asarray(edges[~apart.all(axis=0)])
