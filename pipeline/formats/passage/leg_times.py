"""How long a vessel takes along the legs of a passage, at speeds that it can sail.

The planned path's times don't fit its legs. The legs are a little longer, and a projected drift
leaves out the speed that is lost by heading into a cross-current: to keep the planned times, the
vessel would have to be faster than it can be. Here it has its own speed through the water and heads
into the cross-current. Where speeds were chosen, they change by as little as keeps the planned
arrival, if the highest speed allows.
"""

import numpy as np

from pipeline._types import FloatArray
from pipeline.formats.shared.legs import Steps, at_speeds_sailed, sailed
from pipeline.formats.shared.result import RankedRoute, RunResult

# Difference from the planned arrival that counts as none, as a share of the time under way (a
# second in 11 days), and the number of rounds of Newton's method in which it is reached.
_IN_TIME, _ROUNDS = 1e-6, 6


def steps_along_legs(line: FloatArray, ranked: RankedRoute, result: RunResult) -> Steps:
    """Steps between points (n, 2) of the plane along a route's legs, as it can be sailed."""
    pieces, first, speeds = at_speeds_sailed(line, ranked)

    def at(speeds: FloatArray) -> Steps:
        return sailed(pieces, first, speeds, result.scene, ranked.season, "crab")

    choice = result.scene.speeds.get(ranked.season)
    if choice is None:
        return at(speeds)
    found = at(speeds)
    if not np.isfinite(found.true_s).all():
        # A speed chosen by the projected drift can be too low to head into the cross-current.
        speeds = np.full_like(speeds, choice.most)
        found = at(speeds)
    length = np.linalg.norm(np.diff(line, axis=0), axis=1)
    moved = length > 0
    for _ in range(_ROUNDS):
        late = found.true_s.sum() / ranked.metrics.duration_s
        if abs(late - 1) <= _IN_TIME:
            break
        # Relative change of the time, for a relative change of all speeds.
        slopes = (found.through_water_m_s * found.planner_s**2)[moved] / length[moved]
        change = late ** (found.planner_s.sum() / slopes.sum())
        speeds = np.clip(speeds * change, choice.least, choice.most)
        nearer = at(speeds)
        if not np.isfinite(nearer.true_s).all():
            break
        found = nearer
    return found
