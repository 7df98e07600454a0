"""The paper's own scenes, as far as they can be reconstructed, and the fuel published for them.

The single gyre is read off its figure. The ablation is reconstructed: one rectangle and a run of
80 m due north meet six published figures. The islands of the 4-gyre are not in the paper: these
were searched so that the shortest path has the published length (255.9 m).
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from shapely import Polygon, box

import renew
from renew.inputs.options import Padding
from tests.strategies import Scene, single_gyre

_FOUR_GYRE_ISLANDS = (
    ((80, 52), (75, 60), (61, 32), (86, 36)),
    ((136, 181), (131, 180), (126, 162), (155, 161)),
    ((132, 130), (131, 136), (129, 141), (91, 118), (119, 101)),
    ((51, 115), (45, 112), (55, 90), (66, 101)),
    ((112, 166), (112, 170), (105, 175), (92, 168), (108, 152)),
)


@dataclass(frozen=True)
class PublishedScene(Scene[renew.CurrentField]):
    """A scene, the options of its plan, and the fuel asked of the sampled method."""

    name: str = ""
    median: float = 0.0
    worst: float = 0.0
    options: dict[str, Any] = field(default_factory=dict)

    def plan(self, **options: Any) -> renew.Plan:
        """Plan it with its options."""
        return super().plan(**(self.options | options))


def _ablation(case: str, degrees: float, padding: Padding, fuel: float) -> PublishedScene:
    """One case of the ablation: a current of 0.8 m/s towards a direction, past one rectangle."""
    angle = math.radians(degrees)
    return PublishedScene(
        renew.Chart(box(0, 0, 100, 100), [box(45.37, 32.15, 54.63, 47.23)]),
        renew.UniformCurrent(0.8 * math.cos(angle), 0.8 * math.sin(angle)),
        np.array([50.0, 10.0]),
        np.array([50.0, 90.0]),
        name=f"ablation {case}",
        median=fuel,
        worst=fuel,
        options={"padding": padding},
    )


GYRE = PublishedScene(*single_gyre().parts, name="single gyre", median=97.0, worst=112.0)

FOUR_GYRE = PublishedScene(
    renew.Chart(box(0, 0, 200, 200), [Polygon(corners) for corners in _FOUR_GYRE_ISLANDS]),
    renew.GyreCurrent(0.8, 200, 200, 2, 2),
    np.array([10.0, 10.0]),
    np.array([190.0, 190.0]),
    name="4-gyre",
    median=202.25,
    worst=202.25,
)

ABLATION = (
    _ablation("a", 45, "adaptive", 56.76),
    _ablation("b", 45, "none", 52.86),
    _ablation("c", 45, 3.27, 54.39),
    _ablation("d", 270, "adaptive", 311.29),
)
