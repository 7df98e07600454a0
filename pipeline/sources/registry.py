"""The one place that chooses an adapter for a source.

A new source is an adapter in `land` or `currents`, a spec in `pipeline.scenario.catalogue`, a line
below, and an entry in `catalog/sources`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, assert_never

from pipeline.errors import RequestError
from pipeline.scenario import catalogue

if TYPE_CHECKING:
    from pipeline.scenario.region import ChartSource, ChartSpec
    from pipeline.sources.interfaces import CurrentSource, LandSource


def land_source(chart: ChartSpec, draught_m: float | None) -> LandSource:
    """Return a scenario's sources of land as one; the draught is for charts that have depths."""
    from pipeline.sources.land.overlay import Stack

    return Stack(tuple(_one_land(asked, chart, draught_m) for asked in chart.source))


def _one_land(asked: ChartSource, chart: ChartSpec, draught_m: float | None) -> LandSource:
    """Return one source of land: by its name in the catalogue, or by what lies at its path."""
    entry = catalogue.source(asked.name) if asked.name else None
    if entry is not None and entry.adapter == "osm-land":
        from pipeline.sources.land.osm_adapter import OsmLand

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
        from pipeline.sources.land.s57_adapter import S57Chart

        return S57Chart(place, draught_m + chart.under_keel_clearance_m)
    from pipeline.sources.land.vector import VectorFile

    return VectorFile(place, asked, entry if isinstance(entry, catalogue.VectorSpec) else None)


def current_source(named: str | tuple[str, ...]) -> CurrentSource:
    """Return the current source of a catalogue entry, or of files that belong together."""
    if not isinstance(named, str):
        from pipeline.sources.currents.cf.adapter import CfFiles

        return CfFiles(named)
    spec = catalogue.source(named)
    if spec.adapter == "embedded-table":
        from pipeline.sources.currents.embedded import EmbeddedTable

        return EmbeddedTable(spec)
    if spec.adapter == "copernicus":
        from pipeline.sources.currents.copernicus.adapter import Copernicus

        return Copernicus(spec)
    if isinstance(spec, catalogue.ChartEntry):
        raise RequestError([f"source {named!r} gives land, not currents"])
    assert_never(spec)
