"""The one place that chooses an adapter for a source.

A new source is an adapter in this package, a spec in `pipeline.scenario.catalogue`, a
branch below, and an entry in `catalog/sources`.
"""

from pathlib import Path
from typing import TYPE_CHECKING, assert_never

from pipeline.errors import RequestError
from pipeline.machine.paths import require_readable
from pipeline.scenario import catalogue
from pipeline.scenario.region import ChartSource, ChartSpec

if TYPE_CHECKING:
    from pipeline.model.inputs import CurrentSource, LandSource


def land_source(chart: ChartSpec, draught_m: float | None) -> "LandSource":
    """Return all of a scenario's land sources as one; charts with depths need the draught."""
    from pipeline.sources.combined_charts import Overlay

    overlay = Overlay(tuple(_single_source(source, chart, draught_m) for source in chart.source))
    if not chart.depths:
        return overlay
    from pipeline.sources.combined_charts import SoundedChart
    from pipeline.sources.depth_file import DepthFile

    safety_depth_m = _safety_depth_m(chart, draught_m)
    return SoundedChart(overlay, DepthFile.open(Path(chart.depths)), safety_depth_m)


def _single_source(source: ChartSource, chart: ChartSpec, draught_m: float | None) -> "LandSource":
    """Return one land source, by its name in the catalogue or by the file at its path."""
    entry = catalogue.source(source.name) if source.name else None
    if entry is not None and entry.adapter == "osm-land":
        from pipeline.sources.land.osm import OsmLand

        return OsmLand()
    if not source.path:
        raise RequestError(
            f"chart.source {source.name!r} is a kind of chart and needs files: give them with "
            f'--charts PATH, or as {{ name = "{source.name}", path = "…" }}; `renew show` prints '
            "the scenario's description, which may name them"
        )
    path = Path(source.path)
    require_readable([path], "chart.source")
    is_s57 = path.suffix == ".000" or (path.is_dir() and path.suffix != ".gdb")
    if entry is not None and is_s57 != (entry.adapter == "s57"):
        found = "S-57 cells" if is_s57 else "a vector file"
        raise RequestError(
            f"chart.source: {path} is {found}, not {source.name!r}; leave the name out"
        )
    if is_s57:
        from pipeline.sources.land.s57 import S57Chart, find_cells

        find_cells(path)  # refused before a missing draught is
        return S57Chart(path, _safety_depth_m(chart, draught_m))
    from pipeline.sources.land.vector import VectorFile

    return VectorFile(path, source, entry if isinstance(entry, catalogue.VectorSpec) else None)


def _safety_depth_m(chart: ChartSpec, draught_m: float | None) -> float:
    """Return draught and under-keel clearance."""
    if draught_m is None:
        raise RequestError(
            "vessel.draught_m is missing, and the chart has depths: give the vessel's draught in "
            "metres"
        )
    return draught_m + chart.under_keel_clearance_m


def current_source(named: str | tuple[str, ...]) -> "CurrentSource":
    """Return the source of currents that a catalogue entry names, or that files make together."""
    if not isinstance(named, str):
        from pipeline.sources.cf.adapter import CfFiles

        return CfFiles(named)
    spec = catalogue.source(named)
    if spec.adapter == "embedded-table":
        from pipeline.sources.embedded import EmbeddedTable

        return EmbeddedTable(spec)
    if spec.adapter == "copernicus":
        from pipeline.sources.copernicus.adapter import Copernicus

        return Copernicus(spec)
    if spec.adapter == "still":
        from pipeline.sources.embedded import StillWater

        return StillWater(spec)
    if isinstance(spec, catalogue.ChartEntry):
        raise RequestError(f"source {named!r} gives land, not currents")
    assert_never(spec)
