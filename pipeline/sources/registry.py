"""The one place that chooses an adapter for a source; embedded tables and still water are here.

So is the choice of files of wind and waves, as far as the vessel has a limit for them.

A new source needs an adapter in this package, a spec in `pipeline.scenario.catalogue`, a branch
below, and an entry in `catalog/sources`.
"""

import csv
import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import assert_never

import numpy as np
from shapely.geometry import Polygon

from pipeline._types import FloatArray, IndexArray
from pipeline.errors import Faults, RequestError, StageError, refuse_any
from pipeline.geo.projection import Bounds, cell_bounds, common_bounds, sides_beyond
from pipeline.machine.paths import require_readable
from pipeline.model import Credit, CurrentGrid, Land, Note
from pipeline.model.inputs import NO_TIDE, CurrentSource, DepthRule, Issue, LandSource, TideRange
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import EmbeddedTableSpec, StillSpec
from pipeline.scenario.model import Scenario
from pipeline.scenario.region import ChartSource, ChartSpec
from pipeline.scenario.season import Currents, MembersSpec, Season, StreamConstants, period
from pipeline.scenario.strict import near_miss
from pipeline.sources.current_field import Field, LandMask, water_without_data


def charted_land(scenario: Scenario) -> LandSource:
    """Return all of a scenario's land sources as one, with the tide where it has one."""
    vessel, tide = scenario.vessel, NO_TIDE
    if scenario.tide is not None:
        from pipeline.sources.tide_stations import tide_range

        tide = tide_range(scenario.tide)
    draught_m = None if vessel.draught_m is None else vessel.draught_m + vessel.squat_m
    return land_source(scenario.chart, draught_m, tide)


def land_source(chart: ChartSpec, draught_m: float | None, tide: TideRange = NO_TIDE) -> LandSource:
    """Return all of a chart's sources as one; a chart with depths needs the draught, with squat."""
    from pipeline.sources.combined_charts import Overlay
    from pipeline.sources.land.vector import VectorFile

    sources = tuple(_single_source(source, chart, draught_m, tide) for source in chart.source)
    if not all(isinstance(source, VectorFile) for source in sources):
        sources = tuple(
            replace(source, is_addition=True) if isinstance(source, VectorFile) else source
            for source in sources
        )
    overlay = Overlay(sources, _refused_m(sources))
    if not chart.depths:
        return overlay
    from pipeline.sources.combined_charts import DepthFile, SoundedChart

    rule = _depth_rule(chart, draught_m, tide)
    file = DepthFile.open(Path(chart.depths), chart.depths_positive)
    if file.datum and chart.datum not in {"", file.datum}:
        raise RequestError(
            f"chart.datum = {chart.datum!r} (--datum), but {file.name} states {file.datum}; give it"
        )
    return SoundedChart(overlay, file, rule, chart.datum or file.datum)


def _refused_m(sources: Sequence[LandSource]) -> float | None:
    """Return how far inside the world's land a route is refused, m; None where it needs no check.

    S-57 cells say themselves what they cover.
    """
    from pipeline.sources.land.osm import ACCURACY_M, OsmLand
    from pipeline.sources.land.vector import VectorFile

    files = [source for source in sources if isinstance(source, VectorFile)]
    if not files or any(isinstance(source, OsmLand) for source in sources):
        return None
    return math.inf if all(source.source.complete for source in files) else ACCURACY_M


def _single_source(
    source: ChartSource, chart: ChartSpec, draught_m: float | None, tide: TideRange
) -> LandSource:
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
    if entry is not None and source.is_s57 != (entry.adapter == "s57"):
        found = "S-57 cells" if source.is_s57 else "a vector file"
        raise RequestError(
            f"chart.source: {path} is {found}, not {source.name!r}; leave the name out"
        )
    if source.is_s57:
        from pipeline.sources.land.s57 import S57Chart, find_cells

        find_cells(path)  # a folder without cells is refused before a missing draught
        return S57Chart(path, _depth_rule(chart, draught_m, tide))
    from pipeline.sources.land.vector import VectorFile

    return VectorFile(path, source, entry if isinstance(entry, catalogue.VectorSpec) else None)


def _depth_rule(chart: ChartSpec, draught_m: float | None, tide: TideRange) -> DepthRule:
    """Return which depths are deep enough for a draught with the under-keel clearance."""
    if draught_m is None:
        raise RequestError(
            f"vessel.draught_m is missing, and the chart has depths: {catalogue.DRAUGHT}"
        )
    return DepthRule(draught_m + chart.under_keel_clearance_m, tide)


def current_source(
    named: Currents, members: MembersSpec | None = None, variables: tuple[str, str] | None = None
) -> CurrentSource:
    """Return the source of currents that a catalogue entry names, or that files make together.

    If `members` says that the files hold members, the source gives their mean, and each of them.
    `variables` are those of the files that are the current; by default they are found.
    """
    if not isinstance(named, str):
        from pipeline.sources.cf.adapter import CfFiles, CfMembers, TidalStreams

        if isinstance(named, StreamConstants):
            return TidalStreams.of(named, variables)
        if members is not None and members.along:
            return CfMembers(named, members, variables)
        return CfFiles(named, pair=variables)
    spec = catalogue.source(named)
    if spec.adapter == "embedded-table":
        return EmbeddedTable(spec)
    if spec.adapter == "copernicus":
        from pipeline.sources.copernicus.adapter import Copernicus

        return Copernicus(spec)
    if spec.adapter == "still":
        return StillWater(spec)
    if isinstance(spec, catalogue.ChartEntry):
        raise RequestError(f"source {named!r} gives land, not currents")
    assert_never(spec)


def weather_files(scenario: Scenario) -> Iterator[tuple[str, CurrentSource]]:
    """Yield the files of wind and waves that are needed, each by the name of its limit."""
    from pipeline.sources.cf.adapter import CfFiles
    from pipeline.sources.quantities import GUST, PERIOD, WAVES, WIND

    spec, limits = scenario.limits, scenario.weather_limits
    if spec is None:
        return
    rows = (
        ("wave_m", spec.waves, WAVES),
        ("period_s", spec.waves, PERIOD),
        ("wind_m_s", spec.wind, WIND),
        ("gust_m_s", spec.wind, GUST),
        ("leeway", spec.wind, WIND),
    )
    for name, paths, quantity in rows:
        if getattr(limits, name) is not None and paths:
            yield name, CfFiles(paths, quantity=quantity)


def weather_grids(scenario: Scenario, season: Season) -> dict[str, CurrentGrid]:
    """Read a scenario's wind and waves, on the clock of a season, by the names of their limits.

    Raises RequestError if a file can't be read, or lacks the region or the departure; all faults
    are listed.
    """
    found, faults = dict[str, CurrentGrid](), Faults()
    region = Polygon() if scenario.region is None else scenario.region.shape
    for name, source in weather_files(scenario):
        read = partial(source.current, region, season, Land((), (), 0.0), Path())
        if reason := source.uncovered_reason(region, season):
            faults.lines.append(reason)
        elif (grid := faults.collect(read)) is not None:
            found[name] = grid
    refuse_any([f"limits: {fault}" for fault in dict.fromkeys(faults.lines)])
    return found


@dataclass(frozen=True)
class EmbeddedTable(CurrentSource):
    """A CSV table (season, lon, lat, u, v); the points of each season lie on one regular grid.

    Missing points are NaN: land, or water without data.
    """

    spec: EmbeddedTableSpec

    @cached_property
    def _bytes(self) -> bytes:
        return (catalogue.root() / "currents" / self.spec.table).read_bytes()

    def identity(self, case: Season) -> tuple[str, ...]:
        """Return the hash of the table, and which part of it stands for the case."""
        digest = hashlib.sha256(self._bytes).hexdigest()
        part = self.spec.season_for(case) or case.name
        return (self.spec.name, digest, part, self.spec.model_dump_json())

    def uncovered_reason(self, region: Polygon, case: Season) -> str:
        """Say how far the region reaches beyond the table's cells."""
        part = self.spec.season_for(case)
        if case.is_changing:
            return (
                f"{self.spec.name} has one field for a season, and season {case.name!r} has "
                "time_method = 'changing'; give a file with time steps (--currents, or 'currents')"
            )
        if part is None:
            months = "; ".join(
                f"{name} is of the months {', '.join(map(str, season.months))}"
                for name, season in self.spec.seasons.items()
                if season.months
            )
            nearest = near_miss(case.name, self.spec.seasons)
            hint = f"{nearest}{'' if nearest.endswith('?') else ';'} {months or 'it has no months'}"
            return f"{self.spec.name} has no season {case.name!r}: {hint}"
        lacking = sides_beyond(region.bounds, self._bounds(part))
        if not lacking:
            return ""
        return (
            f"{self.spec.name} has no data {' nor '.join(lacking)}; name another source "
            "(--currents, or 'currents'), or in a scenario a smaller region"
        )

    def covered_bounds(self, region: Polygon, case: Season) -> Bounds | None:
        """Return the part that the table's cells cover."""
        part = self.spec.season_for(case)
        return None if part is None else common_bounds(region.bounds, self._bounds(part))

    def issue(self, case: Season) -> Issue:
        """Return the table's hash, and the last day of the part that stands for the case."""
        part = self.spec.season_for(case)
        digest = hashlib.sha256(self._bytes).hexdigest()
        if part is None:
            return Issue(None, None, None, digest)
        last = period(self.spec.seasons[part].valid.rpartition("/")[2]).begin
        return Issue(None, last, last, digest)

    def current(self, region: Polygon, case: Season, land: Land, folder: Path) -> CurrentGrid:
        """Return the whole grid of the part that stands for the case, as it is small."""
        del folder
        part = self.spec.season_for(case)
        if part is None:
            raise StageError(self.uncovered_reason(region, case))
        entry = self.spec.seasons[part]
        lon, lat, u, v = self._grid(part)
        credit = Credit(self.spec.title, "current", entry.credit, entry.licence, entry.url)
        mask = LandMask.of(land.polygons, region.bounds)
        notes = water_without_data(Field(lon, lat, u, v), mask, region)
        return CurrentGrid(case.name, lon, lat, u[None], v[None], entry.valid, credit, notes)

    def _bounds(self, part: str) -> Bounds:
        """Return the outer edges of the cells of a part of the table."""
        lon, lat, _, _ = self._grid(part)
        return cell_bounds(lon, lat, (float(lon[1] - lon[0]), float(lat[1] - lat[0])))

    def _grid(self, part: str) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return axes lon (nx,) and lat (ny,), and u, v (ny, nx) with NaN where there is no row."""
        lines = self._bytes.decode("utf-8").splitlines()
        rows = csv.DictReader(line for line in lines if not line.startswith("#"))
        points = np.array(
            [
                [float(row[key]) for key in ("lon", "lat", "u", "v")]
                for row in rows
                if row["season"] == part
            ]
        )
        lon, column = _axis(points[:, 0])
        lat, row = _axis(points[:, 1])
        u = np.full((lat.size, lon.size), np.nan)
        v = u.copy()
        u[row, column], v[row, column] = points[:, 2], points[:, 3]
        return lon, lat, u, v


def _axis(values: FloatArray) -> tuple[FloatArray, IndexArray]:
    """Return the regular axis through all values, and each value's index on it."""
    distinct = np.unique(values)
    # A grid line without data leaves a wider gap, so the least gap is the step.
    step = float(np.diff(distinct).min())
    steps = np.rint((distinct - distinct[0]) / step).astype(np.intp)
    # The mean step, as the rounding to four decimals would add up over a long axis.
    step = float((distinct[-1] - distinct[0]) / steps[-1])
    axis = distinct[0] + step * np.arange(steps[-1] + 1)
    return axis, np.rint((values - distinct[0]) / step).astype(np.intp)


_CREDIT = "planned without currents, as in still water"
# Nodes along each side of the region: enough to interpolate, and to show still water on a map.
_NODES = 5


@dataclass(frozen=True)
class StillWater(CurrentSource):
    """A current of zero everywhere and at all times."""

    spec: StillSpec

    def identity(self, case: Season) -> tuple[str, ...]:
        """Return its name, as it never changes."""
        del case
        return (self.spec.name,)

    def covered_bounds(self, region: Polygon, case: Season) -> Bounds | None:
        """Return all of the region's bounds."""
        del case
        west, south, east, north = region.bounds
        return west, south, east, north

    def issue(self, case: Season) -> Issue:
        """Return an issue that never changes."""
        del case
        return Issue(None, None, None, self.spec.name)

    def current(self, region: Polygon, case: Season, land: Land, folder: Path) -> CurrentGrid:
        """Return zeros on a coarse grid over the region."""
        del land, folder
        west, south, east, north = region.bounds
        zeros = np.zeros((1, _NODES, _NODES))
        return CurrentGrid(
            case=case.name,
            lon=np.linspace(west, east, _NODES),
            lat=np.linspace(south, north, _NODES),
            u=zeros,
            v=zeros.copy(),
            valid=case.valid or "any time",
            credit=Credit(self.spec.title, "current", _CREDIT, licence=""),
            notes=(Note.of("still-water"),),
        )
