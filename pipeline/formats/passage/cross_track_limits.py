"""Cross-track limits to either side of the legs, and radii of the turns at the waypoints."""

from dataclasses import dataclass
from typing import Self

import numpy as np
import shapely

from pipeline._types import FloatArray, Geometries, IndexArray
from pipeline.formats.passage.safe_corridor import (
    IndexedEdges,
    Obstacles,
    SafeCorridor,
    cross,
)
from pipeline.formats.passage.tracks import Tracks
from pipeline.formats.shared.route_profile import edges_of

# Maximum length of a turn's tangent, as a share of the leg: the turn at its other end needs the
# other half.
_MAX_LEG_SHARE = 0.5
# Number of edges of each area that are clipped to the area in one call.
_AT_ONCE = 4
# Maximum number of times that a turning radius is halved before the turn is given up.
_MAX_HALVINGS = 12


def cross_track_limits(
    legs: Tracks, soft_no_go: shapely.Geometry, obstacles: Obstacles, cap: float
) -> tuple[FloatArray, FloatArray]:
    """Cross-track limits of each leg to port and to starboard (k,), metres of the plane.

    A limit is the distance from the leg, its ends included, to the nearest point on that side that
    belongs to V, to the hard no-go zone (which covers all land) or to the chart's edge; at most
    `cap`. V is the water from which a hard-over turn in the season's current could touch land, so
    within the limits the vessel stays out of V. A leg that lies in V, as it may at start or goal,
    has the limit 0: nothing is promised there.
    """
    count = len(legs.lines)
    sides = _Sides.of(legs, cap)
    limits = np.full(2 * count, cap)
    # Most of V is far from the legs, and to index all of its edges takes long.
    way, parts = shapely.multilinestrings(legs.lines), shapely.get_parts(soft_no_go)
    shapely.prepare(way)
    near = list(parts[shapely.dwithin(way, parts, cap)])
    soft = IndexedEdges(sides.edges_within(cap, edges_of(near)))
    for edges in (obstacles.edges, soft):
        _lower_to(limits, sides, edges)
    limits[np.tile(shapely.intersects(soft_no_go, legs.lines), 2)] = 0.0
    return limits[:count], limits[count:]


def turning_radii(legs: Tracks, corridor: SafeCorridor, radius: float) -> FloatArray:
    """Radius of the turn at each waypoint between two legs (k - 1,), metres of the plane.

    `radius` is halved until the turn stays inside the corridor and takes up at most half of each
    leg; 0 if no such turn is found.
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


@dataclass(frozen=True)
class _Sides:
    """Both sides of k legs: all port sides, then all starboard sides.

    `areas` (2k,) lie beside the legs `lines` (2k,); `chords` (2k, 2, 2) run from a leg's start to
    its end; `offsets` (2k,) are the legs' greatest distances from their chords.
    """

    areas: Geometries
    lines: Geometries
    chords: FloatArray
    offsets: FloatArray

    @classmethod
    def of(cls, legs: Tracks, width: float) -> Self:
        """Sides of legs, reaching at least a width away from them."""
        starts = np.flatnonzero(np.diff(legs.leg, prepend=-1))
        ends = np.append(starts[1:], len(legs.leg)) - 1
        chords = np.stack([legs.xy[starts], legs.xy[ends]], axis=1)
        aside = _aside(chords)
        apart = np.abs(((legs.xy - legs.xy[starts][legs.leg]) * aside[legs.leg]).sum(axis=1))
        offsets = np.maximum.reduceat(apart, starts)
        areas = [_side_areas(legs, starts, ends, side * (width + offsets)) for side in (1, -1)]
        return cls(
            np.concatenate(areas),
            np.tile(legs.lines, 2),
            np.tile(chords, (2, 1, 1)),
            np.tile(offsets, 2),
        )

    def edges_within(self, distance: float, edges: FloatArray) -> FloatArray:
        """Select the edges, of (n, 2, 2), that may be within a distance of a leg."""
        middle = edges.mean(axis=1)
        reach = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1) / 2 + distance
        near = np.zeros(len(edges), dtype=bool)
        legs = len(self.chords) // 2
        for (begin, end), offset in zip(self.chords[:legs], self.offsets[:legs], strict=True):
            way, chord = middle - begin, end - begin
            share = np.clip(way @ chord / (chord @ chord), 0.0, 1.0)
            apart = way - share[:, None] * chord
            near |= np.einsum("ij,ij->i", apart, apart) < (reach + offset) ** 2
        return edges[near]

    def least_distance(self, side: IndexArray, ends: FloatArray) -> FloatArray:
        """Lower bound of the distance (n,) of edges (n, 2, 2) from the legs of their sides."""
        half = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2
        begin, chord = self.chords[side, 0], self.chords[side, 1] - self.chords[side, 0]
        way = ends.mean(axis=1) - begin
        share = np.clip((way * chord).sum(axis=1) / (chord * chord).sum(axis=1), 0.0, 1.0)
        middle = np.linalg.norm(way - share[:, None] * chord, axis=1)
        return np.asarray(middle - half - self.offsets[side])


def _aside(chords: FloatArray) -> FloatArray:
    """Unit vectors (k, 2) to port of chords (k, 2, 2)."""
    along = chords[:, 1] - chords[:, 0]
    ahead = along / np.linalg.norm(along, axis=1)[:, None]
    return np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)


def _side_areas(
    legs: Tracks, starts: IndexArray, ends: IndexArray, reach: FloatArray
) -> Geometries:
    """Area beside each leg (k,), to port, or to starboard with a negative reach (k,).

    It lies between the leg, extended at both ends, and a parallel of its chord at that reach.
    """
    aside = _aside(np.stack([legs.xy[starts], legs.xy[ends]], axis=1))
    ahead = np.stack([aside[:, 1], -aside[:, 0]], axis=-1)
    far = aside * reach[:, None]
    width = np.abs(reach)[:, None]
    back = legs.xy[starts] - width * ahead
    front = legs.xy[ends] + width * ahead
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


def _lower_to(limits: FloatArray, sides: _Sides, edges: IndexedEdges) -> None:
    """Lower each side's limit to the distance of the leg from the edges inside the side's area.

    Clipping an edge to an area takes long, so the edges that may be nearest come first, a few of
    each area at once, until no other edge can be nearer.
    """
    area, edge = edges.tree.query(sides.areas, predicate="intersects")
    least = sides.least_distance(area, edges.ends[edge])
    order = np.lexsort((least, area))
    while len(order := order[least[order] < limits[area[order]]]):
        of = area[order]
        first = np.arange(len(of)) - np.searchsorted(of, of) < _AT_ONCE
        of, tried = of[first], edge[order[first]]
        parts = shapely.intersection(sides.areas[of], edges.lines[tried])
        np.minimum.at(limits, of, shapely.distance(parts, sides.lines[of]))
        order = order[~first]
