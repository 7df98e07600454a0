"""Depths of a chart: its areas, which of them are deep enough, and which with the tide only."""

from dataclasses import dataclass
from typing import Literal

from shapely.geometry.base import BaseGeometry


@dataclass(frozen=True, slots=True)
class DepthArea:
    """Water of a chart between two depths in metres at chart datum, NaN where not charted.

    A negative depth dries. `area` is in lon/lat degrees.
    """

    kind: Literal["natural", "dredged"]
    least_m: float
    greatest_m: float
    area: BaseGeometry


@dataclass(frozen=True, slots=True)
class TideRange:
    """The least and the greatest height (m over chart datum) of the tide that is relied on."""

    lowest_m: float
    highest_m: float


NO_TIDE = TideRange(0.0, 0.0)
"""Water without a tide, always at chart datum."""


@dataclass(frozen=True, slots=True)
class DepthRule:
    """Which charted depths (m) are deep enough for a vessel.

    `safety_depth_m` is draught, squat and under-keel clearance, `tide` the range of the tide.
    """

    safety_depth_m: float
    tide: TideRange = NO_TIDE

    @property
    def least_m(self) -> float:
        """Depth below which water is never deep enough."""
        return self.safety_depth_m - self.tide.highest_m

    def need_m(self, depth_m: float) -> float:
        """Return the height of tide that water of a charted depth needs."""
        return self.safety_depth_m - depth_m

    def is_tidal(self, depth_m: float) -> bool:
        """Whether water of a charted depth is deep enough for some hours only."""
        return self.least_m <= depth_m < self.safety_depth_m - self.tide.lowest_m


@dataclass(frozen=True, slots=True)
class TidalWater:
    """Water that is deep enough for some hours only, and the height of tide that it needs.

    The height is in metres over chart datum, `area` in lon/lat degrees. `name` says what the chart
    shows there.
    """

    name: str
    need_m: float
    area: BaseGeometry
