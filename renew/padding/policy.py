"""How constrained edges are padded: what a plan was asked for, as one frozen object."""

from __future__ import annotations

from dataclasses import dataclass

from renew.inputs.arguments import Padding, RiskAt


@dataclass(frozen=True, slots=True)
class PaddingPolicy:
    """Adaptive padding at some `risk`, none, or a fixed width; never below `clearance`, m.

    `seed` is that of the draws by which adaptive padding is set; `risk_at` is where
    the risk holds: on the way through each triangle, or from every point of the route as well.
    """

    padding: Padding
    clearance: float
    risk: float
    seed: int
    risk_at: RiskAt = "route"

    @property
    def is_adaptive(self) -> bool:
        """Whether padding follows current, direction and vessel."""
        return self.padding == "adaptive"

    @property
    def min_width(self) -> float:
        """Width (m) that every padding has at least."""
        fixed = 0.0 if isinstance(self.padding, str) else float(self.padding)
        return max(fixed, self.clearance)

    def likely_width(self, turning_radius: float) -> float:
        """Width (m) that hardly any padding stays below: a turn is twice as wide as its radius."""
        return max(self.min_width, turning_radius if self.is_adaptive else 0.0)
