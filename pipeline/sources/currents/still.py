"""Still water: the current of a voyage that is planned without any."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from shapely.geometry import Polygon

from pipeline.model import Credit, CurrentGrid, Land
from pipeline.model.notes import Note
from pipeline.scenario.catalogue import StillSpec
from pipeline.scenario.season import Season
from pipeline.sources.interfaces import CurrentSource, Issue
from pipeline.sources.quality.coverage import Bounds

_CREDIT = "planned without currents, as in still water"
# Nodes along each side of the region: enough to interpolate, and to show on a map that there is
# nothing.
_NODES = 5


@dataclass(frozen=True)
class StillWater(CurrentSource):
    """A current of zero everywhere and at all times."""

    spec: StillSpec

    def identity(self, season: Season) -> tuple[str, ...]:
        """Its name, as it is always the same."""
        del season
        return (self.spec.name,)

    def uncovered_reason(self, region: Polygon, season: Season) -> str:
        """Covers everything."""
        del region, season
        return ""

    def covered_bounds(self, region: Polygon, season: Season) -> Bounds | None:
        """Return all of the region's bounds."""
        del season
        west, south, east, north = region.bounds
        return west, south, east, north

    def issue(self, season: Season) -> Issue:
        """Never changes."""
        del season
        return Issue(None, None, None, self.spec.name)

    def current(self, region: Polygon, season: Season, land: Land, folder: Path) -> CurrentGrid:
        """Return zeros on a coarse grid over the region."""
        del land, folder
        west, south, east, north = region.bounds
        zeros = np.zeros((1, _NODES, _NODES))
        return CurrentGrid(
            season=season.name,
            lon=np.linspace(west, east, _NODES),
            lat=np.linspace(south, north, _NODES),
            u=zeros,
            v=zeros.copy(),
            valid=season.valid or "any time",
            credit=Credit(self.spec.title, "current", _CREDIT, licence=""),
            notes=(Note.of("still-water"),),
        )
