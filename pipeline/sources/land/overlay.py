"""Several charts as one: what any of them forbids is no-go."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from pipeline.geo.known_cells import DepthCover
from pipeline.model import Land, Zone
from pipeline.sources.interfaces import LandSource
from pipeline.sources.land.polygons import extract_polygons


@dataclass(frozen=True)
class Overlay:
    """One or more sources of land as one."""

    sources: tuple[LandSource, ...]

    @property
    def identity(self) -> tuple[str, ...]:
        """The identities of all sources, in their order."""
        return tuple(part for source in self.sources for part in (*source.identity, ""))

    def land(self, region: Polygon) -> Land:
        """Return the land of all sources near a region (lon/lat degrees)."""
        return overlay([source.land(region) for source in self.sources])


def overlay(lands: Sequence[Land]) -> Land:
    """Combine charts: no-go is what any of them forbids, and what none of them covers.

    The accuracy of the coast is that of the least accurate chart.
    """
    zones = [zone for land in lands for zone in land.zones if zone.kind != "uncharted"]
    blank = reduce(shapely.intersection, (_uncharted(land) for land in lands))
    uncharted = extract_polygons(np.array([blank], dtype=object))
    if len(uncharted):
        zones.append(Zone("uncharted", "", "no chart covers it", shapely.union_all(uncharted)))
    return Land(
        polygons=(*(polygon for land in lands for polygon in land.polygons), *uncharted.tolist()),
        credits=tuple(dict.fromkeys(credit for land in lands for credit in land.credits)),
        accuracy_m=max(land.accuracy_m for land in lands),
        notes=tuple(dict.fromkeys(note for land in lands for note in land.notes)),
        zones=tuple(zones),
        second_shore=tuple(polygon for land in lands for polygon in land.second_shore),
        places=tuple(place for land in lands for place in land.places),
        depths=_depths(lands),
        depth_areas=tuple(area for land in lands for area in land.depth_areas),
    )


def _depths(lands: Sequence[Land]) -> DepthCover | None:
    """Where any of the charts has depths; None where none of them has any."""
    found = [land.depths for land in lands if land.depths is not None]
    return DepthCover(tuple(area for one in found for area in one.areas)) if found else None


def _uncharted(land: Land) -> BaseGeometry:
    """The area that a chart does not cover."""
    return shapely.union_all([zone.area for zone in land.zones if zone.kind == "uncharted"])
