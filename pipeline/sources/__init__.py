"""Where land and currents come from: two small interfaces, and the one place that chooses.

A new source is an adapter beside these, a spec in `pipeline.catalogue`, a line below, and an
entry in `catalog/sources`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, assert_never

from pipeline import catalogue
from pipeline.errors import RequestError

if TYPE_CHECKING:
    from pathlib import Path

    from shapely.geometry import Polygon

    from pipeline.model import CurrentGrid, Land
    from pipeline.scenario import Season


class LandSource(Protocol):
    """Land polygons for a region."""

    @property
    def identity(self) -> tuple[str, ...]:
        """What its land depends on beside the region: releases, hashes."""
        ...

    def land(self, region: Polygon) -> Land:
        """Land near a region (lon/lat degrees)."""
        ...


class CurrentSource(Protocol):
    """Surface currents for a region and a season."""

    @property
    def uses_network(self) -> bool:
        """Whether it asks another machine, which `--offline` forbids."""
        ...

    def identity(self, season: Season) -> tuple[str, ...]:
        """What its figures depend on beside the region: dataset, release, month, hashes."""
        ...

    def unavailable(self) -> str:
        """Say why it can't be asked now, with the remedy; empty when it can."""
        ...

    def uncovered(self, region: Polygon, season: Season) -> str:
        """Say what of the region or the season it lacks, with the remedy; empty when nothing."""
        ...

    def current(self, region: Polygon, season: Season, land: Land, folder: Path) -> CurrentGrid:
        """Fetch the current; `land` to judge gaps by, `folder` for files that it keeps.

        Raises
        ------
        StageError
            It could not be had, or what came was not sound.
        """
        ...


def land_source(name: str) -> LandSource:
    """Return the land source of a catalogue entry."""
    spec = catalogue.source(name)
    if spec.adapter == "osm-land":
        from pipeline.sources.osm_adapter import OsmLand

        return OsmLand()
    raise RequestError([f"source {name!r} gives currents, not land; use 'osm-land'"])


def current_source(name: str) -> CurrentSource:
    """Return the current source of a catalogue entry."""
    spec = catalogue.source(name)
    if spec.adapter == "embedded-table":
        from pipeline.sources.embedded import EmbeddedTable

        return EmbeddedTable(spec)
    if spec.adapter == "copernicus":
        from pipeline.sources.copernicus import Copernicus

        return Copernicus(spec)
    if spec.adapter == "osm-land":
        raise RequestError([f"source {name!r} gives land, not currents"])
    assert_never(spec)
