"""The two interfaces that every source of land or currents implements."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from pathlib import Path

    from shapely.geometry import Polygon

    from pipeline.model import CurrentGrid, Land
    from pipeline.scenario.model import Season


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

    def asks_network(self, region: Polygon, season: Season, folder: Path) -> bool:
        """Whether it would ask another machine, for all that it has kept in the folder."""
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
        RequestError
            What the user gave is not sound.
        """
        ...
