"""A lower bound on the fuel of every route: what no plan can beat.

Proof. Along any route the ground speed is at most v + |c| (both drift models: c·T <= |c|, and
c·T + √(v² - |c⊥|²) <= |c| + v), so at most v + C with C the strongest current on the chart. Any
route from start to goal is at least as long as the straight line. Hence

    F = α vᵏ ∫ ds / g >= α vᵏ |goal - start| / (v + C).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from renew._types import FloatArray
    from renew.chart import Chart
    from renew.current import CurrentField
    from renew.vessel import Vessel


def fuel_lower_bound(
    chart: Chart, current: CurrentField, vessel: Vessel, start: FloatArray, goal: FloatArray
) -> float:
    """Fuel below which no route from start to goal can stay, over all homotopy classes."""
    fastest = vessel.speed + current.max_speed(chart.bounds)
    return vessel.fuel_rate * math.dist(start, goal) / fastest
