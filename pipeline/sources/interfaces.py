"""The two interfaces that every source of land or currents implements."""

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Protocol

from shapely.geometry import Polygon

from pipeline.geo.lonlat import Bounds
from pipeline.model import CurrentGrid, Land
from pipeline.scenario.season import Season


@dataclass(frozen=True, slots=True)
class Issue:
    """Which issue of its data a source has now.

    `reference` is the reference time of a forecast or analysis (aware, UTC), `last_step` its last
    time step, `first_step` the first that is of use; each None where the source does not say it.
    `digest` is a hash of the data, or of a version that stands for them.
    """

    reference: datetime | None
    first_step: datetime | None
    last_step: datetime | None
    digest: str


class LandSource(Protocol):
    """Land polygons for a region."""

    @property
    def identity(self) -> tuple[str, ...]:
        """Everything but the region that the land depends on: releases, file hashes."""
        ...

    def land(self, region: Polygon) -> Land:
        """Return the land near a region (lon/lat degrees)."""
        ...


class CurrentSource(Protocol):
    """Surface currents for a region and a season; as a rule on this machine, for anybody."""

    def needs_network(self, region: Polygon, season: Season, folder: Path) -> bool:
        """Whether `current` would download, given the files cached in the folder."""
        del region, season, folder
        return False

    def identity(self, season: Season) -> tuple[str, ...]:
        """Everything but the region that the current depends on: dataset, time, file hashes."""
        ...

    def unavailable_reason(self) -> str:
        """Say why the source can't be used now, with the remedy; empty when it can."""
        return ""

    def uncovered_reason(self, region: Polygon, season: Season) -> str:
        """Say for which part of the region or season there are no data, with the remedy, or ""."""
        ...

    def covered_bounds(self, region: Polygon, season: Season) -> Bounds | None:
        """Return the bounds of the part of a region's bounds for which there are data, or None.

        Where a source can't be read there is no such part; `uncovered_reason` says why.
        """
        ...

    def issue(self, season: Season) -> Issue:
        """Return which issue of the data there is now.

        Raises
        ------
        StageError
            The service does not say it.
        RequestError
            The user's own file is not there, or invalid.
        """
        ...

    def current(self, region: Polygon, season: Season, land: Land, folder: Path) -> CurrentGrid:
        """Return the current on the source's own grid.

        Parameters
        ----------
        region
            Lon/lat degrees.
        season
            The period, and how its field is made of time steps.
        land
            Land near the region, against which gaps in the data are checked.
        folder
            Where downloads are cached.

        Raises
        ------
        StageError
            The data could not be downloaded, or failed the acceptance check.
        RequestError
            The user's own file is invalid.
        """
        ...
