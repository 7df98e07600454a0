"""The height of the tide that a vessel can rely on, and the hours in which it is too low.

A prediction knows neither wind nor pressure, and a tide runs early or late. So a vessel relies on
the least predicted height within a `lag` of its time, less a `surge`.
"""

from dataclasses import dataclass

import numpy as np

from renew._types import FloatArray
from renew.inputs.tide import Tide

# Time step (s) of the heights from which the hours are computed. With a tide of 6 m twice a day,
# linear interpolation between two steps is off by 0.2 mm.
_STEP = 120.0
# Time (s) before and after a voyage that is searched too, so that messages name complete periods.
_AROUND = 86_400.0


@dataclass(frozen=True, eq=False)
class ReliedOnTide:
    """A tide that may be lower than predicted by `surge` (m), and early or late by `lag` (s)."""

    tide: Tide
    surge: float
    lag: float

    @property
    def least(self) -> float:
        """A height (m over chart datum) below which it never falls."""
        return self.tide.lowest - self.surge

    @property
    def most(self) -> float:
        """A height (m over chart datum) above which it never rises."""
        return self.tide.highest - self.surge

    def heights(self, times: FloatArray) -> FloatArray:
        """Heights (...,), m over chart datum, at times (...,), s."""
        count = 2 * int(np.ceil(self.lag / _STEP)) + 1
        around = np.asarray(times)[..., None] + np.linspace(-self.lag, self.lag, count)
        predicted = self.tide.heights(around.ravel()).reshape(around.shape)
        return np.asarray(predicted.min(axis=-1) - self.surge)

    def too_low(self, need: float, begin: float, end: float) -> FloatArray:
        """Hours (n, 2), s, that overlap `begin` to `end` (s), in which it is below a need (m).

        Hours that begin or end more than a day outside `begin` to `end` are infinite there.
        """
        times, excess = self._excess(need, begin, end)
        hours = _joined(_spells(times, -excess) + np.array([-self.lag, self.lag]))
        return hours[(hours[:, 0] < end) & (hours[:, 1] > begin)]

    def high_enough(self, need: float, begin: float, end: float) -> FloatArray:
        """Hours (n, 2), s, from `begin` to `end` (s), in which it is at least the need (m)."""
        low = np.clip(self.too_low(need, begin, end), begin, end)
        hours = np.column_stack([np.append(begin, low[:, 1]), np.append(low[:, 0], end)])
        return hours[hours[:, 0] < hours[:, 1]]

    def highest(self, begin: float, end: float) -> float:
        """Its greatest height (m over chart datum) from `begin` to `end` (s)."""
        return float(self.heights(np.arange(begin, end + _STEP, _STEP)).max())

    def _excess(self, need: float, begin: float, end: float) -> tuple[FloatArray, FloatArray]:
        """Times (n,), s, and by how much the predicted height less the surge exceeds a need, m."""
        # Times are whole multiples of the step, so that the hours do not depend on `begin`.
        first, last = np.floor((begin - _AROUND) / _STEP), np.ceil((end + _AROUND) / _STEP)
        times = _STEP * np.arange(first, last + 1)
        return times, self.tide.heights(times) - self.surge - need


def _spells(times: FloatArray, excess: FloatArray) -> FloatArray:
    """Hours (n, 2), s, in which a function, linear between (n,) `times`, is above 0."""
    above = excess > 0
    change = np.flatnonzero(above[1:] != above[:-1])
    before, after = excess[change], excess[change + 1]
    cross = times[change] + before / (before - after) * (times[change + 1] - times[change])
    first = [-np.inf] if above[0] else []
    last = [np.inf] if above[-1] else []
    return np.concatenate([first, cross, last]).reshape(-1, 2)


def _joined(hours: FloatArray) -> FloatArray:
    """Hours (n, 2), s, in ascending order, with overlapping ones joined."""
    if not len(hours):
        return hours
    apart = hours[1:, 0] > hours[:-1, 1]
    begins = hours[np.append(True, apart), 0]
    return np.column_stack([begins, hours[np.append(apart, True), 1]])
