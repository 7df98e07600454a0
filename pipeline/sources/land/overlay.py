"""Several charts laid on top of each other: what one of them forbids is no-go."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.model import Land, Zone
from pipeline.sources.land.polygons import polygonal

if TYPE_CHECKING:
    from collections.abc import Sequence

    from shapely.geometry import Polygon
    from shapely.geometry.base import BaseGeometry

    from pipeline.sources.interfaces import LandSource


@dataclass(frozen=True)
class Stack:
    """Sources of land, one or more, as one."""

    sources: tuple[LandSource, ...]

    @property
    def identity(self) -> tuple[str, ...]:
        """What each of them depends on, in their order."""
        return tuple(part for source in self.sources for part in (*source.identity, ""))

    def land(self, region: Polygon) -> Land:
        """Land of all of them near a region (lon/lat degrees)."""
        return stacked([source.land(region) for source in self.sources])


def stacked(lands: Sequence[Land]) -> Land:
    """Lay charts on top of each other; what none of them covers is no-go as well.

    The coast is as uncertain as the worst of them says.
    """
    zones = [zone for land in lands for zone in land.zones if zone.kind != "uncharted"]
    blank = reduce(shapely.intersection, (_uncharted(land) for land in lands))
    uncharted = polygonal(np.array([blank], dtype=object))
    if len(uncharted):
        zones.append(Zone("uncharted", "", "no chart covers it", shapely.union_all(uncharted)))
    return Land(
        polygons=(*(polygon for land in lands for polygon in land.polygons), *uncharted.tolist()),
        credits=tuple(dict.fromkeys(credit for land in lands for credit in land.credits)),
        accuracy_m=max(land.accuracy_m for land in lands),
        notes=tuple(dict.fromkeys(note for land in lands for note in land.notes)),
        zones=tuple(zones),
    )


def _uncharted(land: Land) -> BaseGeometry:
    """What a chart does not reach over."""
    return shapely.union_all([zone.area for zone in land.zones if zone.kind == "uncharted"])
