"""Keep as much padding as there is room for, where no way keeps all of it.

A harbour or a fairway may be narrower than a turning circle. Nobody turns hard over there: a pilot
slows down, or has a tug. So padding yields, but only where it must: beside the sections of a
channel that it shuts. There, each piece of shore keeps a share of its distance from the line
through the middles of these sections. All other padding stays, and grows as ever until turns are
free. Where a corner can't be rounded at the vessel's speed, a stretch around it is steered as by a
vessel that turns faster.

Turns along the result are then flown against the chart, with ever smaller turning circles, and
each stretch on which a full one meets land is listed. The guarantee stays what it is: a stretch
has it, or is listed.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import shapely
from shapely.ops import substring

from renew._types import FloatArray, IntArray
from renew.classes.dual_graph import Channel
from renew.classes.triangulation import Triangulation
from renew.errors import InfeasibleError
from renew.kernels.capsules import Capsules
from renew.paths.corridor import SLACK, Corridor
from renew.paths.sections import free_intervals, sections_of
from renew.planner.hindrances import distances_from
from renew.planner.problem import NEEDED, Problem
from renew.results import Shortfall
from renew.steering.steer_in_corridor import steer_in_corridor
from renew.turns.padding_model import PaddedEdges
from renew.turns.verification import free_shares
from renew.voyage.fuel import speeds_along
from renew.voyage.voyage import Voyage

# Steps in which padding yields, and of the turning circle for which there is room.
_STEP = 0.05
# Share of its distance from the middle of narrow water that a shore keeps: the rest is the room in
# which a path may bend.
_SHARE = 0.9
# Spacing of sections at first, in v/ω, and the largest angle between two, rad.
_SPACING = 0.25
_ANGLE = math.radians(9)
# Places on a section that are tried as its middle, as shares of its length.
_PLACES = np.linspace(0.0, 1.0, 17)[1:-1]
# Largest length of a piece of shore, as a share of its distance from the middle.
_PIECE = 0.5
# Largest number of times that pieces are halved.
_HALVINGS = 12


def with_room(corridor: Corridor, triangulation: Triangulation, least: float) -> Corridor:
    """Return a corridor whose padding leaves a way through its channel, in pieces.

    Padding of up to `least` m never yields.
    """
    padded = list[PaddedEdges]()
    for part, _ in corridor.parts(corridor.rough_path):
        pieces = _with_room(part.padded, part.channel, part.voyage, triangulation, least)
        first = sum(len(one.edge) for one in padded)
        # The pieces of each part are edges of their own.
        padded.append(replace(pieces, edge=first + np.arange(len(pieces.edge))))
    return replace(corridor.with_padding(padded), is_fitted=True)


def _with_room(
    padded: PaddedEdges,
    channel: Channel,
    voyage: Voyage,
    triangulation: Triangulation,
    least: float,
) -> PaddedEdges:
    """Return padding that leaves a way through a channel without via points."""
    slack = SLACK * voyage.vessel.turning_radius
    middles = _middles(padded, channel, voyage, triangulation)
    if not len(middles):
        return padded
    tree, reach = shapely.STRtree(middles), float(padded.padding.max()) / _SHARE
    pieces, found = padded, list[tuple[PaddedEdges, FloatArray]]()
    for left in reversed(range(_HALVINGS + 1)):
        apart = distances_from(pieces, tree, reach)
        length = np.linalg.norm(pieces.end - pieces.start, axis=1)
        is_long = (length > np.maximum(_PIECE * apart, 2 * slack)) & (left > 0)
        found.append((pieces.select(~is_long), apart[~is_long]))
        if not is_long.any():
            break
        long = pieces.select(is_long)
        middle = (long.start + long.end) / 2
        pieces = PaddedEdges.stacked([replace(long, end=middle), replace(long, start=middle)])
    pieces = PaddedEdges.stacked([short for short, _ in found])
    apart = np.concatenate([distance for _, distance in found])
    # Paths keep off padding by the slack. Where there is less room, padding is below 0 by a part of
    # it, which counts as none.
    room = np.maximum(apart - 3 * slack, apart / 2 - slack)
    most = np.minimum(pieces.most, np.maximum(np.minimum(_SHARE * apart, room), least))
    padding = np.minimum(pieces.padding, most)
    return replace(pieces, padding=padding, turns=np.minimum(pieces.turns, padding), most=most)


def _middles(
    padded: PaddedEdges, channel: Channel, voyage: Voyage, triangulation: Triangulation
) -> list[shapely.Geometry]:
    """Return the lines through the middles of the sections that padding shuts, and shut ends."""
    radius = voyage.vessel.turning_radius
    shut = Capsules(padded.start, padded.end, padded.padding + SLACK * radius)
    # What is shut is no further from land than padding is wide; a sliver of it may be open.
    reach = 2 * float(shut.radius.max(initial=0.0))
    spacing, found = _SPACING * radius, (np.empty((0, 2)), np.empty(0), np.empty(0, dtype=int))
    for _ in range(2):
        sections = sections_of(channel, voyage.start, voyage.goal, spacing, _ANGLE)
        number = np.flatnonzero(free_intervals(sections, shut).blocked)
        blocked = sections.select(number)
        points = blocked.points(np.broadcast_to(_PLACES, (len(number), len(_PLACES))))
        room = triangulation.room_at(points, reach)
        row, best = np.arange(len(number)), room.argmax(axis=1) if len(number) else number
        found = points[row, best], room[row, best], number
        finest = float(found[1].min(initial=spacing))
        if finest >= spacing:
            break
        spacing = finest
    points, _, number = found
    last = len(sections.left) - 1
    ends = [
        (end, at)
        for end, at in ((voyage.start, -1), (voyage.goal, last + 1))
        if len(padded.around(end).edge)
    ]
    places = [(number[k], points[k]) for k in range(len(number))] + [(at, end) for end, at in ends]
    places.sort(key=lambda place: place[0])
    lines: list[shapely.Geometry] = [shapely.Point(point) for _, point in places]
    lines += [
        shapely.LineString([one, other])
        for (at, one), (after, other) in itertools.pairwise(places)
        if after == at + 1
    ]
    return lines


class Tight(NamedTuple):
    """A stretch of a path, from `begin` to `end` m, steered by a vessel that turns faster."""

    begin: float
    end: float
    factor: float


# Half the length of such a stretch at first, in v/ω.
_REACH = 2.0
# The vessel's turn rate is multiplied by this factor, and again, up to a largest one.
_FASTER = 2.0
_FASTEST = 64.0
# Largest number of attempts.
_ATTEMPTS = 60


def steered_tightly(
    path: FloatArray, corridor: Corridor, triangulation: Triangulation
) -> tuple[FloatArray, FloatArray, tuple[Tight, ...]]:
    """Return a path (n, 2), its trajectory (m, 4), and where it is steered as by a nimbler vessel.

    Raises InfeasibleError where it can't be steered though there is room.
    """
    radius, line = corridor.voyage.vessel.turning_radius, shapely.LineString(path)
    tight, first = list[Tight](), None
    for _ in range(_ATTEMPTS):
        try:
            return _steered_in_pieces(line, corridor, tight)
        except InfeasibleError as error:
            first = first or error
            if not error.places or len(corridor.voyage.via):
                break
            place = error.places[0]
        if not triangulation.room_at(np.asarray(place), NEEDED * radius) < math.inf:
            break
        at = float(shapely.line_locate_point(line, shapely.Point(place)))
        begin, end, factor = at - _REACH * radius, at + _REACH * radius, _FASTER
        for one in [one for one in tight if begin <= one.end and one.begin <= end]:
            is_in = one.begin <= at <= one.end
            begin, end = min(begin, one.begin), max(end, one.end)
            factor = max(factor, one.factor * (_FASTER if is_in else 1.0))
            tight.remove(one)
        if factor > _FASTEST:
            break
        tight.append(Tight(max(begin, 0.0), min(end, line.length), factor))
        tight.sort()
    raise first or InfeasibleError("no attempt was made")


def _steered_in_pieces(
    line: shapely.LineString, corridor: Corridor, tight: Sequence[Tight]
) -> tuple[FloatArray, FloatArray, tuple[Tight, ...]]:
    """Steer a path in pieces, the tight ones as by a vessel that turns faster."""
    voyage, vessel = corridor.voyage, corridor.voyage.vessel
    cuts = [0.0, *(end for one in tight for end in one[:2]), line.length]
    factors = [1.0, *(factor for one in tight for factor in (one.factor, 1.0))]
    paths, tracks, steered, passed = list[FloatArray](), list[FloatArray](), list[Tight](), 0.0
    now = voyage.departure
    for (begin, end), factor in zip(itertools.pairwise(cuts), factors, strict=True):
        if end <= begin:
            continue
        piece = shapely.get_coordinates(substring(line, begin, end))
        own = replace(
            voyage,
            start=piece[0],
            goal=piece[-1],
            departure=now,
            vessel=replace(vessel, turn_rate=factor * vessel.turn_rate),
        )
        drawn, track = steer_in_corridor(piece, replace(corridor, voyage=own))
        now, length = float(track[-1, 0]), shapely.LineString(drawn).length
        if factor > 1:
            steered.append(Tight(passed, passed + length, factor))
        passed += length
        first = 1 if paths else 0
        paths.append(drawn[first:])
        tracks.append(track[first:])
    return np.concatenate(paths), np.concatenate(tracks), tuple(steered)


class Room(NamedTuple):
    """Stations `along` a path (n,), m, at `points` (n, 2), and the `share` of a turn free at each.

    A full turn needs `needed` (n,) metres.
    """

    along: FloatArray
    points: FloatArray
    share: FloatArray
    needed: FloatArray


def room_to_turn(path: FloatArray, problem: Problem, speeds: FloatArray) -> Room:
    """Return the room for hard-over turns along a path (n, 2) sailed at speeds (n - 1,), m/s.

    A turn at a lower speed than the vessel's needs less.
    """
    voyage, edges = problem.voyage, problem.triangulation.constrained_edges
    along, share = free_shares(path, voyage.in_members, edges, problem.reach, speeds)
    # GEOS walks along the whole path for each of the 100,000 points of a long one.
    passed = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1)))
    points = np.column_stack([np.interp(along, passed, axis) for axis in path.T])
    slower = speeds_along(points, path, speeds) / voyage.vessel.speed
    return Room(along, points, share, problem.reach(points) * slower)


def shortfalls(
    path: FloatArray, tight: Sequence[Tight], problem: Problem, speeds: FloatArray
) -> tuple[Shortfall, ...]:
    """Return the stretches of a path (n, 2) without room for a hard-over turn, or tight ones.

    Legs are sailed at speeds (n - 1,) m/s.
    """
    along, _, share, needed = room_to_turn(path, problem, speeds)
    for one in tight:
        inside = (along >= one.begin) & (along <= one.end)
        whole_steps = math.floor(1 / one.factor / _STEP) * _STEP
        share[inside] = np.minimum(share[inside], whole_steps)
    found, short = list[Shortfall](), np.flatnonzero(share < 1)
    apart = along[short[1:]] - along[short[:-1]] > NEEDED * problem.voyage.vessel.turning_radius
    for run in np.split(short, 1 + np.flatnonzero(apart)) if len(short) else ():
        begin, end = along[max(run[0] - 1, 0)], along[min(run[-1] + 1, len(along) - 1)]
        most = float(needed[run].max())
        found.append(Shortfall(float(begin), float(end), most, float(share[run].min()) * most))
    return tuple(found)


def growable(
    padded: PaddedEdges, short: tuple[IntArray, FloatArray] | None
) -> tuple[IntArray, FloatArray] | None:
    """Return of edges and the padding that they lack, m, those whose padding may grow, if any."""
    if short is None or not padded.yields:
        return short
    order = np.argsort(padded.edge, kind="stable")
    row = order[np.searchsorted(padded.edge, short[0], sorter=order)]
    grow = padded.padding[row] < padded.most[row]
    return (short[0][grow], short[1][grow]) if grow.any() else None
