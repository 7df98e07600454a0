"""Where land and currents come from: two small interfaces, and the one place that chooses.

A new source is an adapter beside these, a spec in `pipeline.catalogue`, a line below, and an
entry in `catalog/sources`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Protocol, assert_never

from pipeline import catalogue
from pipeline.errors import RequestError

if TYPE_CHECKING:
    from shapely.geometry import Polygon

    from pipeline.model import CurrentGrid, Land
    from pipeline.places import ChartSource, ChartSpec
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


def land_source(chart: ChartSpec, draught_m: float | None) -> LandSource:
    """Return a scenario's sources of land as one; the draught is for charts that have depths."""
    from pipeline.sources.stack import Stack

    return Stack(tuple(_one_land(asked, chart, draught_m) for asked in chart.source))


def _one_land(asked: ChartSource, chart: ChartSpec, draught_m: float | None) -> LandSource:
    """Return one source of land: by its name in the catalogue, or by what lies at its path."""
    entry = catalogue.source(asked.name) if asked.name else None
    if entry is not None and entry.adapter == "osm-land":
        from pipeline.sources.osm_adapter import OsmLand

        return OsmLand()
    if not asked.path:
        fault = (
            f"chart.source {asked.name!r} is a kind of chart, not one: give its files with "
            f'--charts PATH, or as {{ name = "{asked.name}", path = "…" }}'
        )
        raise RequestError([fault])
    place = Path(asked.path)
    is_s57 = place.suffix == ".000" or (place.is_dir() and place.suffix != ".gdb")
    if entry is not None and is_s57 != (entry.adapter == "s57"):
        raise RequestError(
            [f"chart.source: {place} does not hold what {asked.name!r} is; leave the name out"]
        )
    if is_s57:
        if draught_m is None:
            fault = (
                "vessel.draught_m is missing, and the chart has depths: give the metres that the "
                "vessel reaches below the water line"
            )
            raise RequestError([fault])
        from pipeline.sources.s57_adapter import S57Chart

        return S57Chart(place, draught_m + chart.under_keel_clearance_m)
    from pipeline.sources.vector import VectorFile

    return VectorFile(place, asked, entry if isinstance(entry, catalogue.VectorSpec) else None)


def current_source(named: str | tuple[str, ...]) -> CurrentSource:
    """Return the current source of a catalogue entry, or of files that belong together."""
    if not isinstance(named, str):
        from pipeline.sources.cf import CfFiles

        return CfFiles(named)
    spec = catalogue.source(named)
    if spec.adapter == "embedded-table":
        from pipeline.sources.embedded import EmbeddedTable

        return EmbeddedTable(spec)
    if spec.adapter == "copernicus":
        from pipeline.sources.copernicus import Copernicus

        return Copernicus(spec)
    if isinstance(spec, catalogue.ChartEntry):
        raise RequestError([f"source {named!r} gives land, not currents"])
    assert_never(spec)
