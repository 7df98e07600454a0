"""Find what hinders a class: narrows, and hours in which the current blocks its way.

If all of a section across the channel lies within the clearance, the land around it keeps a share
of its distance from the middle of the passage instead. The padding for turns is never reduced.

Water is shut while its current is nearly as strong as the vessel is fast, or stronger, in any
direction. If water is shut only temporarily, a vessel that waits for it to open may arrive first.
In the search no vessel waits, so the search gives the best path *without waiting*.

The hours of a class are given at each place on its way, from the vessel's earliest arrival there to
its latest departure. A planned route has its own times. A rejected class has only a rough path. On
this path the vessel is assumed to wait wherever it meets shut water until the water opens. So the
hours of a rejected class are the hours when the vessel would reach the place that blocks the class.
"""

import math
from collections.abc import Iterable, Iterator
from typing import TypeAlias, TypeVar

import numpy as np
import shapely

from renew._types import BoolArray, FloatArray
from renew.classes.dual_graph import Channel
from renew.classes.triangulation import Triangulation, overpowering_below
from renew.errors import InfeasibleError, Text, UnreachableError
from renew.kernels.current_table import metre_at, overpowered_spells, velocities, velocity
from renew.kernels.viterbi import TOO_STRONG, slowness
from renew.paths.sections import sections_of
from renew.results import OverpoweredHours
from renew.turns.padding_model import PaddedEdges
from renew.voyage.voyage import Voyage, shares

# Spacing of sections, and length of pieces of shore with reduced clearance, in clearances.
_SPACING = 0.25
# Largest angle between two sections, rad.
_ANGLE = np.radians(15)
# Places on a section that are tried as its middle, as shares of its length: first each of a few
# alone, as most sections have room there, then many at once.
_FIRST_PLACES = ((0.5,), (0.25,), (0.75,))
_PLACES = tuple(np.linspace(0.0, 1.0, 17)[1:-1])


def with_clearance(
    padded: PaddedEdges,
    clearance: float,
    share: float,
    channel: Channel,
    voyage: Voyage,
    triangulation: Triangulation,
) -> PaddedEdges:
    """Return padding of at least the clearance (m), reduced in narrows.

    `padded` are edges within the clearance of a channel without via points; their padding is for
    turns. The shore of a narrow keeps the `share` of its distance from the middle; with 1 the
    clearance is never reduced.
    """
    whole = padded.at_least(np.full(len(padded.edge), clearance))
    # A passage with less room than turns need is shut, whatever the clearance.
    least = float(padded.padding.min(initial=clearance))
    if share == 1.0 or least == clearance:
        return whole
    middles = _middles_of_narrows(clearance, least, channel, voyage, triangulation)
    if not len(middles):
        return whole
    tree, reach = shapely.STRtree(shapely.points(middles)), clearance / share
    yields = np.isfinite(distances_from(padded, tree, reach))
    pieces = padded.select(yields).cut(_SPACING * clearance)
    apart = np.minimum(distances_from(pieces, tree, reach), reach)
    kept = pieces.at_least(share * apart)
    # A piece with no more padding than its edge adds nothing, and at a start or goal it would shut
    # the way out of the padding.
    kept = kept.select(kept.padding > pieces.padding)
    # The whole edges come first: their padding, which is for turns, may grow later.
    first = padded.at_least(np.where(yields, 0.0, clearance))
    return PaddedEdges.stacked([first, kept])


def _middles_of_narrows(
    clearance: float, least: float, channel: Channel, voyage: Voyage, triangulation: Triangulation
) -> FloatArray:
    """Return the middles (n, 2) of the sections and ends of a voyage with less room than clearance.

    In narrows, sections are no further apart than the least room there, or than `least` m. So no
    narrow is missed between two sections.
    """
    spacing = _SPACING * clearance
    middles, room = _narrow_sections(clearance, channel, voyage, triangulation, spacing)
    finer = max(least, float(room.min(initial=np.inf)))
    if 0.0 < finer < spacing:
        middles, _ = _narrow_sections(clearance, channel, voyage, triangulation, finer)
    ends = np.stack([voyage.start, voyage.goal])
    return np.concatenate([middles, ends[triangulation.room_at(ends, clearance) < clearance]])


def _narrow_sections(
    clearance: float, channel: Channel, voyage: Voyage, triangulation: Triangulation, spacing: float
) -> tuple[FloatArray, FloatArray]:
    """Return each narrow section's point furthest from land (n, 2), and how far off it is (n,), m.

    A section is narrow if none of its places keeps the clearance.
    """
    sections = sections_of(channel, voyage.start, voyage.goal, spacing, _ANGLE)
    for places in (*_FIRST_PLACES, _PLACES):
        points = sections.points(np.broadcast_to(places, (len(sections.left), len(places))))
        room = triangulation.room_at(points, clearance)
        narrow = room.max(axis=1, initial=0.0) < clearance
        sections, points, room = sections.select(narrow), points[narrow], room[narrow]
    row = np.arange(len(room))
    best = room.argmax(axis=1)
    return points[row, best], room[row, best]


def distances_from(edges: PaddedEdges, tree: shapely.STRtree, reach: float) -> FloatArray:
    """Return the distances (e,), m, of edges from the nearest point of a tree; inf beyond reach."""
    lines = shapely.linestrings(np.stack([edges.start, edges.end], axis=1))
    found, distance = tree.query_nearest(
        lines, max_distance=reach, return_distance=True, all_matches=False
    )
    apart = np.full(len(edges.edge), np.inf)
    apart[found[0]] = distance
    return apart


# Minimum number of pieces into which a path is cut.
_PIECES = 400
# Number of places named in a reason.
_MAX_NAMED = 3

_Error = TypeVar("_Error", bound=InfeasibleError)


_Spell: TypeAlias = tuple[int, float, float]
"""Index of a point on a path, and the begin and end (s) of a time when the current shuts it."""


def hours_along(
    path: FloatArray, times: FloatArray, voyage: Voyage
) -> tuple[OverpoweredHours, ...]:
    """Return the hours when water is shut on a path (n, 2) passed at times (n,), s."""
    points, is_shut = _points_on(path, voyage)
    early, late = voyage.early_and_late(np.interp(shares(points), shares(path), times))
    spells = (
        spell
        for at in np.flatnonzero(is_shut).tolist()
        for spell in _spells(voyage, points, at, early[at], late[at])
    )
    return _longest_of_stretches(points, spells)


def hours_of(channel: Channel, voyage: Voyage) -> tuple[OverpoweredHours, ...]:
    """Return the hours when water is shut on the rough path of a class."""
    points, is_shut = _points_on(channel.rough_path(voyage.start, voyage.goal), voyage)
    if not is_shut.any():
        return ()
    return _longest_of_stretches(points, _spells_met_waiting(points, is_shut, voyage))


def with_hours(error: _Error, hours: tuple[OverpoweredHours, ...]) -> _Error:
    """Return the reason against a class, with the hours when its way is shut, if any."""
    if not hours:
        return error
    shut = Text.joined(", ", [Text("{0}{1}", (one.place, one.text)) for one in hours[:_MAX_NAMED]])
    left = len(hours) - _MAX_NAMED
    more = f" and at {left} more place{'s' * (left > 1)}" if left > 0 else ""
    longer = type(error)(f"{{0}}. The current shuts its way at {{1}}{more}", error.text, shut)
    longer.strait, longer.blocked = error.strait, error.blocked
    return longer


def overpowered_error(channel: Channel, voyage: Voyage) -> UnreachableError:
    """Return the error for a voyage all of whose ways overpowered water shuts; a channel is one."""
    line = shapely.LineString(channel.rough_path(voyage.start, voyage.goal))
    points, table = shapely.get_coordinates(line.segmentize(line.length / _PIECES)), voyage.table
    speeds = [
        np.linalg.norm(velocities(table, points, np.full(len(points), time)), axis=1)
        for time in table.times
    ]
    weakest = np.min(speeds, axis=0)
    at, most = int(weakest.argmax()), float(weakest.max())
    digits = 10.0 ** (2 - math.floor(math.log10(most)))
    enough = math.ceil(digits * overpowering_below(most, table.error)) / digits
    least = "" if table.is_steady else "no less than "
    return UnreachableError(
        f"the current shuts all ways from {{0}} to {{1}}: on the shortest it runs at {least}"
        f"{most:.3g} m/s at {{2}}, and the vessel makes {voyage.vessel.speed:.3g} m/s through "
        f"water. Take a vessel of {enough:.3g} m/s, or move one of the two",
        voyage.start,
        voyage.goal,
        points[at],
    )


def _points_on(path: FloatArray, voyage: Voyage) -> tuple[FloatArray, BoolArray]:
    """Add points to a path; return all (n, 2), and whether the current ever shuts each (n,)."""
    table, count = voyage.table, len(voyage.table.times)
    if table.is_steady or table.strongest < _level(voyage):
        return path, np.zeros(len(path), dtype=bool)
    line = shapely.LineString(path)
    points = shapely.get_coordinates(line.segmentize(line.length / _PIECES))
    times = np.tile(table.times, len(points))
    current = velocities(table, np.repeat(points, count, axis=0), times)
    # Between two slices the current is no stronger than in the stronger one.
    strongest = np.linalg.norm(current, axis=1).reshape(-1, count).max(axis=1)
    return points, strongest >= _level(voyage)


def _spells_met_waiting(points: FloatArray, is_shut: BoolArray, voyage: Voyage) -> Iterator[_Spell]:
    """Yield the spells that the vessel meets if it waits until shut water opens."""
    now = voyage.departure
    legs = np.diff(points, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    for at in range(len(points)):
        (early, *_), _ = voyage.early_and_late(np.array([now]))
        if is_shut[at]:
            for _, _, end in _spells(voyage, points, at, now, now):
                now = max(now, end)
            if math.isinf(now):
                # The vessel does not reach points beyond this one.
                late = now
            else:
                _, (late, *_) = voyage.early_and_late(np.array([now]))
            yield from _spells(voyage, points, at, early, late)
        if math.isinf(now) or at == len(legs):
            return
        (x, y), (tx, ty) = points[at], legs[at] / lengths[at]
        u, v = velocity(voyage.table, x, y, now)
        metres = lengths[at] * metre_at(voyage.table, x, y)
        now += metres * slowness(u, v, tx, ty, voyage.polar)


def _longest_of_stretches(
    points: FloatArray, spells: Iterable[_Spell]
) -> tuple[OverpoweredHours, ...]:
    """Return the longest spell of each stretch: successive points shut in overlapping hours."""
    stretches: list[tuple[_Spell, _Spell]] = []  # the longest and the last spell of each
    for spell in spells:
        at, begin, end = spell
        for k, (longest, (last, last_begin, last_end)) in enumerate(stretches):
            if at - last <= 1 and begin <= last_end and end >= last_begin:
                stretches[k] = max(longest, spell, key=lambda one: one[2] - one[1]), spell
                break
        else:
            stretches.append((spell, spell))
    return tuple(OverpoweredHours(points[at], begin, end) for (at, begin, end), _ in stretches)


def _spells(voyage: Voyage, points: FloatArray, at: int, begin: float, end: float) -> list[_Spell]:
    """Return the spells that shut a point and overlap the time from `begin` to `end` (s)."""
    spells = overpowered_spells(voyage.table, points[at], _level(voyage), begin, end)
    return [(at, float(first), float(last)) for first, last in spells]


def _level(voyage: Voyage) -> float:
    """Return the speed of the current (m/s) from which the search treats water as shut."""
    return math.sqrt(TOO_STRONG) * voyage.vessel.speed
