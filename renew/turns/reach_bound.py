"""How far a hard-over turn can carry the vessel, by where it begins: an upper bound."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from renew._types import FloatArray
from renew.inputs.vessel import Vessel
from renew.kernels.current_table import CurrentTable, weakest_and_strongest

MAX_DEVIATIONS = 2.0
"""Standard deviations by which the currents that turns are flown in differ at most from the field:
95 % of a normal spread, for which the default risk of 5 % answers."""


@dataclass(frozen=True, slots=True)
class TurnReach:
    """Furthest reach (ny, nx) in metres of turns from near the nodes x (nx,) and y (ny,)."""

    x: FloatArray
    y: FloatArray
    furthest: FloatArray

    @classmethod
    def of(cls, table: CurrentTable, vessel: Vessel) -> TurnReach:
        """Bounds from the strongest current that a turn can meet, at any time.

        A turn is 2 v/ω wide in still water, and is carried by the drift of one period. Speeds
        between 0 and m have a standard deviation of at most m / 2, so that a perturbed current is
        slower than (1 + deviations / 2) m.
        """
        from scipy.ndimage import maximum_filter

        drift = (1 + MAX_DEVIATIONS / 2) * vessel.turn_period
        wide = 2 * vessel.turning_radius
        _, speed = weakest_and_strongest(table)
        # Distance within which a turn meets its strongest current; one node more for safety.
        sight = wide + drift * float(speed.max())
        size = [
            2 * min(int(np.ceil(sight / np.diff(axis).min())) + 1, len(axis)) + 1
            for axis in (table.y, table.x)
        ]
        return cls(table.x, table.y, wide + drift * maximum_filter(speed, size, mode="nearest"))

    def __call__(self, points: FloatArray) -> FloatArray:
        """Bound (n,) in metres for turns that begin at points (n, 2)."""
        column = np.clip(np.searchsorted(self.x, points[:, 0]), 0, len(self.x) - 1)
        row = np.clip(np.searchsorted(self.y, points[:, 1]), 0, len(self.y) - 1)
        return np.asarray(self.furthest[row, column])
