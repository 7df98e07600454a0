"""Make a corridor's path steerable inside the corridor."""

import contextlib
import math
from collections.abc import Iterator

import numpy as np
import shapely

from renew._compiled import for_kernels
from renew._types import BoolArray, FloatArray, IntArray
from renew.errors import InfeasibleError, Length, TooSharpError
from renew.kernels.capsules import Capsules, legs_are_clear, segment_distance
from renew.paths.corridor import Corridor
from renew.steering.trajectory import (
    corner_radius,
    course_changes,
    crowding,
    round_corners,
    sharp_corners,
    steer,
)
from renew.voyage.voyage import Voyage

# Size of a corner's disc at first, in multiples of the radius that can be steered at the corner:
# above 1, because the current changes along the arc.
_ROUNDING = 1.06
# The same for a disc around several corners.
_TOGETHER = 1.2
# Discs grow where the vessel can't turn: by what the arc lacks, times this factor.
_MARGIN = 1.01
# Largest growth of a disc per round.
_MOST_AT_ONCE = 1.13
# Largest size of a disc, in multiples of the radius that can be steered at its corner.
_LARGEST = 1.5
# Number of times that discs may grow.
_MAX_GROWTHS = 6
# A disc counts as large enough if the needed one is at most this many times as large.
_GROWTH = 1.01
# Tolerances, as shares of v/ω, for simplifying a path: where sections meet, close points leave a
# sharp corner no room. The last tolerances are used only if the path can't be steered otherwise.
_TOLERANCES = (0.01, 0.03, 0.1, 0.3, 0.6, 1.0)
# The whole path is simplified with at most this number of the tolerances, the smallest first.
_MAX_SIMPLIFIED = 4
# Where single places are to be simplified more, the whole path begins with this number of them.
_FIRST_SIMPLIFIED = 3
# Distance, in v/ω, around an unsteerable place within which a path is simplified more.
_AROUND = 4.0
# Largest number of attempts, each with the path around one more place simplified more.
_MAX_REPETITIONS = 12
# Largest distance, in v/ω, at which a path and its track may pass a via point.
_MISS = 0.02
# Turns a point into a complex number, so that points can be searched as values.
_AS_COMPLEX = np.array([1.0, 1.0j])
# Other ways to steer a path are tried if the trajectory needs more than this many times its fuel.
_CHEAP = 1.005
# The path is also simplified in places if it still needs more than this many times the fuel.
_DEAR = 1.01


def steer_in_corridor(path: FloatArray, corridor: Corridor) -> tuple[FloatArray, FloatArray]:
    """Return a path (n, 2) with corners wide enough to steer, and its trajectory (m, 4).

    A corner is rounded on the outside if its inner arc would cut into V or has no room. A corner at
    a via point is also rounded outside, and the vessel passes the point on the arc. The result
    stays in the channel and out of V. Raises InfeasibleError, with the reason, if that is
    impossible.
    """
    voyage = corridor.voyage
    enough = _CHEAP * voyage.fuel(path)
    least, best = math.inf, None
    first: InfeasibleError | None = None
    for variant, together in _tries(path, corridor):
        try:
            drawn, trajectory = _steered(variant, corridor, together=together)
        except InfeasibleError as error:
            first = first or error
            continue
        fuel = voyage.fuel(drawn)
        if best is None or fuel < least:
            least, best = fuel, (drawn, trajectory)
        if fuel <= enough:
            break
    if best is None:
        raise first or InfeasibleError("no tolerance to try")
    if least > _DEAR * voyage.fuel(path):
        with contextlib.suppress(InfeasibleError):
            other = steer_simplified_in_places(path, corridor)
            best = min(best, other, key=lambda one: voyage.fuel(one[0]))
    return best


def steer_simplified_in_places(
    path: FloatArray, corridor: Corridor
) -> tuple[FloatArray, FloatArray]:
    """Return path and trajectory of a path that is simplified more where it can't be steered.

    Among small eddies some curves of a least-fuel path follow each other too closely to be steered.
    The rest of the path can be steered, and would lose fuel if it were simplified as much.
    """
    path, stays = _tolerances_that_keep(path, corridor)
    reach = _AROUND * corridor.voyage.vessel.turning_radius
    wanted = np.full(len(path), _FIRST_SIMPLIFIED)
    first: InfeasibleError | None = None
    for _ in range(_MAX_REPETITIONS):
        try:
            return _steered(path[stays >= wanted], corridor)
        except InfeasibleError as error:
            first = first or error
            if not error.places:
                break
            near = np.linalg.norm(path - error.places[0], axis=1) <= reach
        kept = near & (stays >= wanted) & (stays <= len(_TOLERANCES))
        if not kept.any():
            break
        wanted[near] = stays[kept].min() + 1
        if not corridor.legs_clear(path[stays >= wanted]).all():
            # A path simplified so much touches V.
            break
    raise first or InfeasibleError("no tolerance to try")


def _tries(path: FloatArray, corridor: Corridor) -> Iterator[tuple[FloatArray, bool]]:
    """Yield variants of a path (n, 2), and whether a disc is placed for all corners it rounds.

    Usually the path itself can be steered, so it is simplified only on demand.
    """
    variants: list[FloatArray] = []
    for variant in _simplified(path, corridor):
        variants.append(variant)
        yield variant, False
    for variant in variants:
        yield variant, True


def _simplified(path: FloatArray, corridor: Corridor) -> Iterator[FloatArray]:
    """Yield a path (n, 2) simplified by growing tolerances, without repetitions."""
    yield path
    path, stays = _tolerances_that_keep(path, corridor)
    count = len(path)
    for tolerances in range(1, _MAX_SIMPLIFIED + 1):
        simplified = path[stays >= tolerances]
        if len(simplified) < count:
            yield simplified
            count = len(simplified)


def _tolerances_that_keep(path: FloatArray, corridor: Corridor) -> tuple[FloatArray, IntArray]:
    """Return a path (n, 2) with its via points, and how many tolerances keep each point (n,).

    Its ends and via points always stay. A point that the Douglas-Peucker algorithm keeps at one
    tolerance is kept at all smaller ones.
    """
    radius = corridor.voyage.vessel.turning_radius
    stays: list[IntArray] = []
    pieces = corridor.voyage.cut(path)
    for piece in pieces:
        line, count = shapely.LineString(piece), np.zeros(len(piece), dtype=np.int64)
        for tolerance in _TOLERANCES:
            left = shapely.get_coordinates(
                line.simplify(tolerance * radius, preserve_topology=False)
            )
            count += np.isin(piece @ _AS_COMPLEX, left @ _AS_COMPLEX)
        count[[0, -1]] = len(_TOLERANCES) + 1
        stays.append(count[1:] if stays else count)
    whole = np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])])
    return whole, np.concatenate(stays)


def _steered(
    path: FloatArray, corridor: Corridor, *, together: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Round a path's sharp corners and steer it; if `together`, a disc serves all its corners."""
    rounding = np.full(len(path), _TOGETHER if together else _ROUNDING)
    first: TooSharpError | None = None
    while first is None or rounding.max() < _LARGEST:
        try:
            rounded, drawn_for = _with_rounded_corners(path, corridor, rounding, together=together)
            return rounded, steer_as_drawn(rounded, corridor)
        except TooSharpError as error:
            first = first or error
            lacking = error.excess > 1
            growth = np.ones(len(path))
            wanted = np.minimum(_MARGIN * error.excess, _MOST_AT_ONCE)
            np.maximum.at(growth, drawn_for[lacking], wanted[lacking])
            rounding *= growth
        except InfeasibleError as error:
            # Larger discs need even more room.
            raise first or error from None
    raise first


def steer_as_drawn(
    path: FloatArray, corridor: Corridor, speeds: FloatArray | None = None
) -> FloatArray:
    """Return the trajectory (m, 4) along a path (n, 2) whose corners are wide enough.

    Legs are sailed at the vessel's speed, or at speeds (n - 1,) through water, m/s. Raises
    InfeasibleError if corners are too narrow, or path or track leaves the corridor.
    """
    voyage = corridor.voyage
    for part, piece in corridor.parts(path):
        clear = part.legs_clear(piece)
        if not clear.all():
            raise InfeasibleError(
                "the corridor is too narrow near {0} to round its corners in", piece[clear.argmin()]
            )
    trajectory = steer(path, voyage.current, voyage.vessel, voyage.departure, speeds, voyage.chart)
    track = for_kernels(trajectory[:, 1:3])
    edges = corridor.padded
    land = Capsules(edges.start, edges.end, np.full(len(edges.edge), -1.0))
    clear = legs_are_clear(track[:-1], track[1:], land)
    if not clear.all():
        raise InfeasibleError(
            "the corridor is too narrow to turn in: the track would touch a no-go zone near {0}",
            track[clear.argmin()],
        )
    missed = np.maximum(voyage.missed(path), voyage.missed(track))
    if (missed > _MISS * voyage.vessel.turning_radius).any():
        raise InfeasibleError(
            "there is no room to turn at the via point {0}: it would be passed {1} off; move it",
            voyage.via[missed.argmax()],
            Length(float(missed.max())),
        )
    return trajectory


def _with_rounded_corners(
    path: FloatArray, corridor: Corridor, rounding: FloatArray, *, together: bool
) -> tuple[FloatArray, IntArray]:
    """Return a path (m, 2) with sharp corners drawn around discs as large as their arcs need.

    Current and course change along an arc: in a following current the vessel's arc is wider than
    before and behind it.
    """
    whole = np.arange(len(path))
    if len(path) < 3:
        return path, whole
    radius = rounding[1:-1] * _corner_radius(path, corridor.voyage)
    rounded, at, leant_on = path, whole, np.zeros(len(radius), dtype=bool)
    for _ in range(_MAX_GROWTHS):
        sharp = sharp_corners(path, radius, corridor.hard_capsules)
        sharp |= _missing_via(path, corridor, radius)
        sharp |= leant_on
        if not sharp.any():
            return path, whole
        kept = 1 + np.flatnonzero(~crowding(path, sharp, radius))
        corners = np.concatenate([[0], kept, [len(path) - 1]])
        rounded, drawn_for = round_corners(
            path[corners], sharp[kept - 1], radius[kept - 1], together=together
        )
        at = corners[drawn_for]
        if len(rounded) < 3:
            break
        needed = np.zeros(len(path))
        np.maximum.at(needed, at[1:-1], _corner_radius(rounded, corridor.voyage))
        needed *= rounding
        short = sharp & (needed[1:-1] > _GROWTH * radius)
        if short.any():
            radius = np.where(short, needed[1:-1], radius)
            continue
        cut_off = _cut_off(path, corridor, rounded, at)
        if not cut_off.any():
            break
        leant_on |= cut_off
    return rounded, at


def _corner_radius(path: FloatArray, voyage: Voyage) -> FloatArray:
    """Return the smallest radii (n - 2,), m, at a path's inner corners when the vessel passes them.

    The current is read from its table if that is fine, because discs are drawn a little larger
    anyway.
    """
    times = voyage.reading_times(path)[1:-1]
    return corner_radius(path, voyage.waters.quick_current, voyage.vessel, times)


def _missing_via(path: FloatArray, corridor: Corridor, radius: FloatArray) -> BoolArray:
    """Return which inner corners (n - 2,) are via points that an arc within a radius misses."""
    corners, via = path[1:-1], corridor.voyage.via
    if not len(via):
        return np.zeros(len(corners), dtype=bool)
    is_via = (corners[:, None] == via).all(axis=2).any(axis=1)
    turns, _ = course_changes(path)
    missed = radius * (1 / np.cos(turns / 2) - 1)
    return np.asarray(is_via & (missed > _MISS / 2 * corridor.voyage.vessel.turning_radius))


def _cut_off(
    path: FloatArray, corridor: Corridor, rounded: FloatArray, drawn_for: IntArray
) -> BoolArray:
    """Return which omitted corners (n - 2,) must stay because the rounded path cuts into V.

    For each leg that cuts into V, it is the omitted corner furthest from the leg. Points (m,) of
    the rounded path (m, 2) are drawn for points of the path (n, 2).
    """
    cut_off = np.zeros(len(path), dtype=bool)
    for leg in np.flatnonzero(~corridor.legs_clear(rounded)):
        omitted = np.arange(drawn_for[leg] + 1, drawn_for[leg + 1])
        if len(omitted):
            away = segment_distance(path[omitted], rounded[leg], rounded[leg + 1])
            cut_off[omitted[away.argmax()]] = True
    return cut_off[1:-1]
