"""Fit the padding beside a path to the path's own hard-over turns.

The padding of a channel (paper) is one number for each edge: for the mean and spread of the current
in whole triangles, and for headings between midpoints of edges. Where a path is known, the turns of
its own legs tell how far it must stay off each piece of an edge. So edges are cut into pieces, and
each piece near the path gets the padding that the turns from the nearest stations need: more where
a turn touches land, less where all have room. The path is then refined, and the cheapest path whose
turns are all clear is kept. Turns alone judge it: in the field, and at the corners of its spread.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely

from renew._types import FloatArray
from renew.classes.dual_graph import Channel
from renew.errors import InfeasibleError
from renew.inputs.options import PlanOptions
from renew.paths.corridor import Corridor
from renew.paths.least_fuel_path import length_of, refined_path
from renew.planner.free_ways import FreeWays
from renew.planner.one_class import ClassPath, ClassPlanner
from renew.planner.problem import channel_along
from renew.steering.steer_in_corridor import steer_as_drawn
from renew.steering.trajectory import course_changes
from renew.turns.padding_model import PaddedEdges
from renew.turns.verification import needed_padding
from renew.voyage.voyage import Voyage

# Length of the pieces into which edges are cut, in v/ω, and the largest number of them, where that
# is tiny beside the water.
_PIECE = 1.0
_MOST_PIECES = 2**14
# Largest number of rounds in which padding is fitted.
_ROUNDS = 4
# Share of the fuel below which a round's saving is not worth another round.
_WORTHWHILE = 1e-3
# First step towards the needed padding, as a share: where padding gets narrower, the path comes
# closer, and needs less still. And the least share.
_STEP = 1.5
_LEAST_STEP = 0.2
# Share of the distance of an edge from a path that its padding takes at most.
_OFF = 0.95
# Margins of free turns with which a path is refined, in v/ω, until it is clear.
_MARGINS = (0.07, 0.12, 0.2)
# Number of rows of padding that an edge may have.
_ROWS = 2**20


def fitted(planner: ClassPlanner, found: ClassPath) -> ClassPath:
    """Return a path of the same class that needs no more fuel, close to a path that is clear."""
    corridor = in_pieces(found.corridor)
    # An end lies in V where padding is too wide for it. Once its turns are clear, it need not.
    ends = shapely.MultiPoint([corridor.voyage.start, corridor.voyage.goal])
    freed = corridor.with_padding(
        [_off(edges, ends, _least(edges, planner.options)) for edges in corridor.paddings]
    )
    needed, is_clear = _needs(planner, freed, found.path)
    if is_clear:
        return _fit(planner, freed, found, needed)
    return _fit(planner, corridor, found, _needs(planner, corridor, found.path)[0])


def fitted_along(planner: ClassPlanner, path: FloatArray, ways: FreeWays) -> ClassPath:
    """Return the best path near a path (n, 2) of free turns, whatever the padding beside it.

    Raises InfeasibleError if turns on it touch land.
    """
    channel = channel_along(path, planner.problem)
    if channel is None:
        raise InfeasibleError("the way leads through the same triangle twice")
    corridor = in_pieces(planner.corridor(channel))
    for margin in _MARGINS:
        refined = ways.refined(path, margin)
        if refined is None:
            break
        path = refined
        beside = _beside(corridor, path, planner.options)
        found = planner.near(beside, path)
        if _needs(planner, beside, found.path)[1]:
            return fitted(planner, found)
    raise InfeasibleError("turns on its path touch land, whatever its padding")


def as_drawn(planner: ClassPlanner, path: FloatArray, channel: Channel) -> ClassPath | None:
    """Return a path (n, 2) of a channel sailed at the planner's departure; None if it is unsafe."""
    corridor, fits = planner.corridor(channel), planner.fits_padding
    if fits:
        corridor = _beside(in_pieces(corridor), path, planner.options)
    else:
        corridor = planner.growth.fitted(corridor, path)
    try:
        trajectory = steer_as_drawn(path, corridor)
        planner.check_water(path, trajectory)
    except InfeasibleError:
        return None
    if fits:
        is_clear = _needs(planner, corridor, path)[1]
    else:
        is_clear = planner.growth.shortfall(corridor, path) is None
    if not is_clear:
        return None
    fuel = planner.problem.voyage.fuel(path)
    return ClassPath(corridor, path, trajectory, fuel, fuel)


def _beside(corridor: Corridor, path: FloatArray, options: PlanOptions) -> Corridor:
    """Return a corridor in pieces whose padding stays off a path (n, 2), but for the clearance."""
    return corridor.with_padding(
        [
            _off(part.padded, shapely.LineString(piece), _least(part.padded, options))
            for part, piece in corridor.parts(path)
        ]
    )


def _off(edges: PaddedEdges, place: shapely.Geometry, least: FloatArray) -> PaddedEdges:
    """Return edges with padding that stays off a place, unless a least one (e,), m, reaches it."""
    pieces = shapely.linestrings(np.stack([edges.start, edges.end], axis=1))
    return _padded(edges, np.minimum(edges.turns, _OFF * shapely.distance(pieces, place)), least)


def _fit(
    planner: ClassPlanner, corridor: Corridor, best: ClassPath, needed: Sequence[FloatArray]
) -> ClassPath:
    """Fit the padding of pieces to turns near a path that is clear; return the cheapest such.

    Each part's turns along this path need padding (e,), m.
    """
    step, voyage = _STEP, corridor.voyage
    least = [_held(edges, _least(edges, planner.options), voyage) for edges in corridor.paddings]
    most = [_most(edges, voyage) for edges in corridor.paddings]
    path = best.path
    if _most_saved(path, corridor, needed) < _WORTHWHILE:
        return best
    for _ in range(_ROUNDS):
        of_parts = zip(corridor.paddings, needed, zip(least, most, strict=True), strict=True)
        toward = corridor.with_padding([_toward(*of_part, step) for of_part in of_parts])
        try:
            near = planner.near(toward, refined_path(toward, path))
        except InfeasibleError:
            step /= 2
            if step < _LEAST_STEP:
                break
            continue
        corridor, path = toward, near.path
        needed, is_clear = _needs(planner, corridor, path)
        if not is_clear:
            step = min(step, 1.0)
            continue
        saved = 1 - near.fuel / best.fuel
        if saved > 0:
            best = near
        if saved < _WORTHWHILE:
            break
    return best


def in_pieces(corridor: Corridor) -> Corridor:
    """Return the corridor with its padded edges in pieces, each with padding of its own."""
    if corridor.is_fitted:
        return corridor
    length = sum(np.linalg.norm(one.end - one.start, axis=1).sum() for one in corridor.paddings)
    longest = max(_PIECE * corridor.voyage.vessel.turning_radius, length / _MOST_PIECES)
    parts = [_numbered(edges.cut(longest)) for edges in corridor.paddings]
    return replace(corridor.with_padding(parts), is_fitted=True)


def _numbered(pieces: PaddedEdges) -> PaddedEdges:
    """Return pieces of edges, each numbered as an edge of its own, alike on all parts of a way."""
    order = np.argsort(pieces.edge, kind="stable")
    first = np.flatnonzero(np.diff(pieces.edge[order], prepend=-1))
    count = np.diff(np.append(first, len(order)))
    of_edge = np.empty(len(order), dtype=np.int64)
    of_edge[order] = np.arange(len(order)) - np.repeat(first, count)
    return replace(pieces, edge=pieces.edge * _ROWS + of_edge)


def _least(edges: PaddedEdges, options: PlanOptions) -> FloatArray:
    """Return the least padding (e,), m, of edges: that of the clearance."""
    by_turns = edges.turns.clip(max=options.clearance)
    return np.where(edges.padding > edges.turns, edges.padding, by_turns)


def _held(edges: PaddedEdges, least: FloatArray, voyage: Voyage) -> FloatArray:
    """Return the least padding (e,), m, of edges, which is all of it around an end in V."""
    ends = shapely.MultiPoint([voyage.start, voyage.goal])
    pieces = shapely.linestrings(np.stack([edges.start, edges.end], axis=1))
    return np.where(shapely.distance(pieces, ends) < edges.padding, edges.padding, least)


def _most(edges: PaddedEdges, voyage: Voyage) -> FloatArray:
    """Return the most padding (e,), m, of edges, which takes in no end that lies clear of it."""
    ends = voyage.start, voyage.goal
    clear = shapely.MultiPoint([end for end in ends if not len(edges.around(end).edge)])
    pieces = shapely.linestrings(np.stack([edges.start, edges.end], axis=1))
    # The distance from no place at all is not a number.
    return np.asarray(np.nan_to_num(_OFF * shapely.distance(pieces, clear), nan=np.inf))


def _most_saved(path: FloatArray, corridor: Corridor, needed: Sequence[FloatArray]) -> float:
    """Return roughly the largest share of a path's fuel (n, 2) that narrower padding may save.

    An arc around a capsule gets shorter by its angle times what the radius loses.
    """
    both = zip(corridor.paddings, needed, strict=True)
    narrower = max(
        (edges.padding - need).max(initial=0.0, where=np.isfinite(need)) for edges, need in both
    )
    return float(np.abs(course_changes(path)[0]).sum() * narrower / length_of(path))


def _needs(
    planner: ClassPlanner, corridor: Corridor, path: FloatArray
) -> tuple[list[FloatArray], bool]:
    """Return the padding that turns along a path need on each part, and whether all are clear."""
    every = zip(*(one.parts(path) for one in corridor.voyage.in_members), strict=True)
    needed = [
        needed_padding(piece, [own for own, _ in voyages], part.padded, planner.problem.reach)
        for (part, piece), voyages in zip(corridor.parts(path), every, strict=True)
    ]
    return [padding for padding, _ in needed], all(is_clear for _, is_clear in needed)


def _toward(
    edges: PaddedEdges, needed: FloatArray, limits: tuple[FloatArray, FloatArray], step: float
) -> PaddedEdges:
    """Return edges with their padding nearer by a step to what is needed, where this is known.

    Padding (e,), m, stays between two limits.
    """
    least, most = limits
    known = np.isfinite(needed)
    lacking = np.where(known, needed, edges.padding) - edges.padding
    return _padded(edges, np.minimum(edges.padding + step * lacking, most), least)


def _padded(edges: PaddedEdges, turns: FloatArray, least: FloatArray) -> PaddedEdges:
    """Return edges with other padding for turns, and no less than a least one, (e,) metres each."""
    return replace(edges, padding=np.maximum(turns, least).clip(min=0.0), turns=turns)
