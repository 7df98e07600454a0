"""Find the exact times when the current at a place, by its table, reaches a level.

Between two slices the velocity is linear in time, so its square is a parabola. The current is
weaker than the level in one interval between the two roots.
"""

import math

import numpy as np

from renew._types import FloatArray
from renew.kernels.current_table import CurrentTable, velocities


def overpowered_spells(
    table: CurrentTable, place: FloatArray, level: float, begin: float, end: float
) -> FloatArray:
    """Return the spells (n, 2), s, ascending, when the current at a place is `level` (m/s) or more.

    Only spells that overlap the time from `begin` to `end` are returned, each complete.
    A spell is infinite if the current is held before its first or after its last time.
    """
    times = table.times
    at = np.broadcast_to(place, (len(times), 2)).copy()
    # A periodic table's last slice equals its first, so the time just before the last is used.
    last = np.nextafter(times[-1], -math.inf) if math.isfinite(table.period) else times[-1]
    velocity = velocities(table, at, np.minimum(times, last))
    weak = _weaker(times, velocity, level)
    if math.isfinite(table.period) and len(weak):
        first, final = (math.floor((time - times[0]) / table.period) for time in (begin, end))
        begun = table.period * np.arange(first - 1, final + 2)
        weak = (weak[None] + begun[:, None, None]).reshape(-1, 2)
    elif len(weak):
        weak[weak == times[0]] = -math.inf
        weak[weak == times[-1]] = math.inf
    # The times between the weaker spells, and before and after them.
    edges = np.concatenate([[-math.inf], weak.ravel(), [math.inf]]).reshape(-1, 2)
    tolerance = 1e-9 * (times[-1] - times[0])
    strong = edges[edges[:, 1] > edges[:, 0] + tolerance]
    return np.asarray(strong[(strong[:, 0] <= end) & (strong[:, 1] >= begin)])


def _weaker(times: FloatArray, velocity: FloatArray, level: float) -> FloatArray:
    """Return the spells (n, 2), s, ascending, when velocities (nt, 2) are weaker; they may touch.

    Velocities are linear between times.
    """
    if len(times) == 1:
        weak = np.array([[-math.inf, math.inf]])
        return weak if np.linalg.norm(velocity[0]) < level else weak[:0]
    change = np.diff(velocity, axis=0)
    # |c + s d|² = level², for the share s of the time between two slices.
    square = (change**2).sum(axis=1)
    slope = (velocity[:-1] * change).sum(axis=1)
    excess = (velocity[:-1] ** 2).sum(axis=1) - level**2
    root = np.sqrt(np.maximum(slope**2 - square * excess, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.stack([-slope - root, -slope + root], axis=1) / square[:, None]
    always = np.where(excess < 0, 1.0, 0.0)
    shares[square == 0] = np.stack([0 * always, always], axis=1)[square == 0]
    shares = np.clip(shares, 0.0, 1.0)
    weak = shares[:, 1] > shares[:, 0]
    lasts = np.diff(times)[:, None]
    # At the share 1 the spell ends exactly where the next begins.
    found = np.where(shares == 1.0, times[1:, None], times[:-1, None] + shares * lasts)
    return np.asarray(found[weak])
