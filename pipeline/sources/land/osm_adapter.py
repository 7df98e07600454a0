"""OpenStreetMap land behind the LandSource interface."""

from dataclasses import dataclass
from importlib.metadata import version

from shapely.geometry import Polygon

from pipeline.model import Land


@dataclass(frozen=True)
class OsmLand:
    """The world's land from the package `roaring-landmask`; always available, no network."""

    @property
    def identity(self) -> tuple[str, ...]:
        """Release of the package: its data change with it."""
        return ("osm-land", version("roaring-landmask"))

    def land(self, region: Polygon) -> Land:
        """Return the land near a region (lon/lat degrees)."""
        from pipeline.sources.land import osm

        return osm.land(region)
