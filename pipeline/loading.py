"""Load a scenario's file, and report all its faults at once.

pydantic finds the faults inside a table. Faults between tables are searched among the tables that
are valid by themselves, so that one bad key hides no other fault.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel, TypeAdapter, ValidationError

from pipeline.errors import RequestError
from pipeline.paths import NOT_THERE, resolved, shown, unreadable_reason, working_directory
from pipeline.scenario import catalogue
from pipeline.scenario.asked_currents import with_currents
from pipeline.scenario.catalogue import EXAMPLE
from pipeline.scenario.messages import model_faults
from pipeline.scenario.model import MAX_SEASONS, Scenario
from pipeline.scenario.region import ChartSpec, Plane, Region
from pipeline.scenario.season import Season
from pipeline.scenario.strict import Point, looks_like_path
from pipeline.scenario.vessel import VesselSpec

if TYPE_CHECKING:
    from shapely.geometry import Polygon

ModelT = TypeVar("ModelT", bound=BaseModel)
_POINT: TypeAdapter[Point] = TypeAdapter(Point)
# Room around start and goal that every region has, degrees (100 m).
_AROUND_DEG = 1e-3
_AS_PATH = "; write a folder or file as a path: './charts', './field.nc'"


def load_scenario(
    asked: str,
    *,
    charts: Path | None = None,
    currents: Sequence[str | Path] = (),
    on_note: Callable[[str], None] | None = None,
) -> Scenario:
    """Load a scenario by its name in the catalogue or its path.

    Parameters
    ----------
    asked
        The name, or the path. Relative paths in the file start at its own folder.
    charts
        A vector file or a folder of S-57 cells that replaces the scenario's chart.
    currents
        Files that belong together, and sources of the catalogue in order of preference: they
        replace every season's currents; seasons that embedded tables lack are left out.
    on_note
        Called with a note for each season left out.

    Raises
    ------
    RequestError
        Not found, not a scenario, or invalid: one line for each fault.
    """
    path = catalogue.scenario_path(asked)
    data = catalogue.read_toml(path)
    if not {"start", "goal", "seasons"} & data.keys():
        raise RequestError(
            [f"{path} is TOML but not a scenario: it has no start, goal or seasons; {EXAMPLE}"]
        )
    if charts is not None:
        data = _with_chart(data, charts)
    if currents:
        data, notes = with_currents(data, currents)
        if on_note is not None:
            for note in notes:
                on_note(note)
    return parse_scenario(data, path.parent)


def parse_scenario(data: dict[str, Any], folder: Path | None = None) -> Scenario:
    """Check a scenario's table, and resolve its catalogue names and paths (from `folder`)."""
    folder = folder or working_directory()
    faults = list(_unknown_names(data))
    scenario, found = _checked(_with_vessel(data))
    faults += [*found, *_cross_faults(_ValidTables.of(data, folder))]
    if scenario is None or faults:
        raise RequestError(faults)
    return _with_paths(scenario, folder)


def _checked(data: dict[str, Any]) -> tuple[Scenario | None, list[str]]:
    """Validate a scenario's table; return it or None, and its faults."""
    try:
        return Scenario.model_validate(data), []
    except ValidationError as error:
        faults = model_faults(error, Scenario, data)
    if data.get("schema_version") != 1:
        # Faults between tables are searched only where every key by itself is valid.
        faults += _checked({**data, "schema_version": 1})[1]
    return None, list(dict.fromkeys(faults))


@dataclass(frozen=True)
class _ValidTables:
    """The tables of a scenario that are valid by themselves."""

    region: Region | None
    plane: Plane | None
    is_planar: bool
    chart: ChartSpec | None
    vessel: VesselSpec | None
    endpoints: dict[str, Point]
    seasons: tuple[Season, ...]

    @classmethod
    def of(cls, data: dict[str, Any], folder: Path) -> _ValidTables:
        """Select them from a scenario's table; relative paths start at `folder`."""
        seasons = data.get("seasons")
        seasons = seasons[:MAX_SEASONS] if isinstance(seasons, list) else []
        found = [_validated(Season, item) for item in seasons]
        chart = _validated(ChartSpec, data.get("chart"))
        endpoints = {}
        via = data.get("via")
        stops = {
            f"via[{at}]": point for at, point in enumerate(via if isinstance(via, list) else ())
        }
        for name, given in {"start": data.get("start"), **stops, "goal": data.get("goal")}.items():
            try:
                endpoints[name] = _POINT.validate_python(given)
            except ValidationError:
                continue
        return cls(
            region=_validated(Region, data.get("region")),
            plane=_validated(Plane, data.get("plane")),
            is_planar="plane" in data,
            chart=None if chart is None else _with_chart_paths(chart, folder),
            vessel=_known_vessel(data.get("vessel")),
            endpoints=endpoints,
            seasons=tuple(_with_files(season, folder) for season in found if season is not None),
        )


def _validated(model: type[ModelT], data: object) -> ModelT | None:
    """Validate one table; None where it is absent or invalid."""
    try:
        return model.model_validate(data)
    except ValidationError:
        return None


def _known_vessel(given: object) -> VesselSpec | None:
    """Return a vessel's table, or that of the catalogue; None where it is unknown or invalid."""
    if isinstance(given, str):
        return catalogue.vessel(given) if given in catalogue.names("vessels") else None
    return _validated(VesselSpec, given)


def _with_vessel(data: dict[str, Any]) -> dict[str, Any]:
    """Replace a vessel's catalogue name by its entry."""
    name = data.get("vessel")
    if not isinstance(name, str):
        return data
    if name in catalogue.names("vessels"):
        return {**data, "vessel": catalogue.vessel_table(name)}
    # The unknown name has a fault already: any valid vessel avoids another one by pydantic.
    return {**data, "vessel": {"length_m": 1.0, "speed_m_s": 1.0, "turn_rate_deg_s": 1.0}}


def _with_chart(data: dict[str, Any], charts: Path) -> dict[str, Any]:
    """Replace a scenario's chart by the user's file or folder."""
    chart = data.get("chart", {})
    source = {"path": str(resolved(charts, "--charts"))}
    return {**data, "chart": {**chart, "source": source}} if isinstance(chart, dict) else data


def _with_paths(scenario: Scenario, folder: Path) -> Scenario:
    """Make the paths of charts and of currents absolute."""
    return scenario.model_copy(
        update={
            "chart": _with_chart_paths(scenario.chart, folder),
            "seasons": tuple(_with_files(season, folder) for season in scenario.seasons),
            "avoid": tuple(
                area.model_copy(update={"path": _absolute(area.path, folder)})
                for area in scenario.avoid
            ),
        }
    )


def _with_chart_paths(chart: ChartSpec, folder: Path) -> ChartSpec:
    """Make the paths of a chart's sources absolute."""
    source = tuple(
        one.model_copy(update={"path": _absolute(one.path, folder)}) if one.path else one
        for one in chart.source
    )
    depths = _absolute(chart.depths, folder) if chart.depths else ""
    return chart.model_copy(update={"source": source, "depths": depths})


def _with_files(season: Season, folder: Path) -> Season:
    """Make the paths of a season's currents absolute."""
    currents = tuple(
        named if isinstance(named, str) else tuple(_absolute(path, folder) for path in named)
        for named in season.currents
    )
    return season.model_copy(update={"currents": currents})


def _absolute(path: str, folder: Path) -> str:
    """Resolve a path, or a pattern of paths, relative to a folder or to the home folder (~)."""
    is_relative = not path.startswith(("~", "/"))
    return str(resolved(folder / path if is_relative else path, "scenario"))


def _missing_paths(chart: ChartSpec) -> Iterator[str]:
    """Find charts that do not exist or can't be read."""
    for one in chart.source:
        if one.path and (reason := unreadable_reason(one.path)):
            remedy = "; give a vector file, or a folder of S-57 cells"
            remedy = remedy if reason == NOT_THERE else ""
            yield f"chart.source = '{shown(one.path)}' {reason}{remedy}"
    if chart.depths and (reason := unreadable_reason(chart.depths)):
        remedy = "; give a GEBCO or EMODnet grid in NetCDF" if reason == NOT_THERE else ""
        yield f"chart.depths = '{shown(chart.depths)}' {reason}{remedy}"


def _unknown_names(data: dict[str, Any]) -> Iterator[str]:
    """Find names of vessels and sources that are not in the catalogue."""
    vessel = data.get("vessel")
    if isinstance(vessel, str) and vessel not in catalogue.names("vessels"):
        yield catalogue.unknown("vessel", "vessel", vessel, catalogue.names("vessels"))
    sources = catalogue.names("sources")
    for key, name in _chart_names(data.get("chart")):
        if name not in sources:
            yield catalogue.unknown("source", key, name, sources) + _AS_PATH
        elif not isinstance(catalogue.source(name), catalogue.ChartEntry):
            yield f"{key} = {name!r} gives currents, not land; use 'osm-land'"
    seasons = data.get("seasons")
    for i, season in enumerate(seasons[:MAX_SEASONS] if isinstance(seasons, list) else ()):
        named = season.get("currents") if isinstance(season, dict) else None
        for j, name in enumerate(named if isinstance(named, list) else ()):
            key = f"seasons[{i}].currents[{j}]"
            if not isinstance(name, str) or looks_like_path(name):
                continue
            if name not in sources:
                yield catalogue.unknown("source", key, name, sources) + _AS_PATH
            elif isinstance(catalogue.source(name), catalogue.ChartEntry):
                yield f"{key} = {name!r} gives land, not currents; name a source of currents"


def _chart_names(chart: object) -> Iterator[tuple[str, str]]:
    """Find the names of catalogue entries in a chart's table, with their keys."""
    if not isinstance(chart, dict) or "source" not in chart:
        return
    try:
        given = ChartSpec.model_validate({"source": chart["source"]})
    except ValidationError:
        return
    for i, one in enumerate(given.source):
        if one.name:
            yield (f"chart.source[{i}]" if len(given.source) > 1 else "chart.source"), one.name


def _cross_faults(tables: _ValidTables) -> Iterator[str]:
    """Find what one table alone does not show: charts that are missing, endpoints in vain."""
    if tables.chart is not None:
        yield from _missing_paths(tables.chart)
        if tables.chart.depths and tables.vessel and tables.vessel.draught_m is None:
            yield (
                "vessel.draught_m is missing, and chart.depths needs it: give the vessel's draught "
                "in metres (--draught)"
            )
    if not tables.is_planar:
        yield from _endpoints_off_earth(tables.endpoints)
    yield from _doubled(tables.endpoints)
    if tables.region is not None:
        yield from _endpoints_outside_region(tables.region, tables.endpoints)
        yield from _uncovered_seasons(tables.region.shape, tables.seasons)
    elif not tables.is_planar:
        yield from _uncovered_voyage(tables.endpoints, tables.seasons)
    elif tables.plane is not None:
        xmin, ymin, xmax, ymax = tables.plane.extent
        for name, (x, y) in tables.endpoints.items():
            distance = math.hypot(max(xmin - x, 0.0, x - xmax), max(ymin - y, 0.0, y - ymax))
            if distance > 0:
                yield (
                    f"{name} = {[x, y]} lies {distance:.4g} m outside plane.extent "
                    f"{list(tables.plane.extent)}; move it inside or widen the extent"
                )


def _doubled(endpoints: dict[str, Point]) -> Iterator[str]:
    """Find stops that are the same as the one before."""
    for (one, place), (other, after) in pairwise(endpoints.items()):
        if place == after:
            yield (
                f"{one} and {other} are the same place, {list(place)}; give two places to sail "
                "between"
            )


def _is_on_earth(lon: float, lat: float) -> bool:
    """Whether two figures are a longitude and a latitude, degrees."""
    return -180 <= lon <= 360 and -90 <= lat <= 90


def _endpoints_off_earth(endpoints: dict[str, Point]) -> Iterator[str]:
    """Find a start or goal that is no longitude and latitude; they may be swapped."""
    for name, (x, y) in endpoints.items():
        if not _is_on_earth(x, y):
            hint = f"; did you mean [{y:g}, {x:g}]?" if _is_on_earth(y, x) else ""
            yield f"{name} = {[x, y]} is not a place on earth: give [longitude, latitude]{hint}"


def _endpoints_outside_region(region: Region, endpoints: dict[str, Point]) -> Iterator[str]:
    """Find a start or goal outside the region, and its distance."""
    import shapely

    for name, point in endpoints.items():
        here = shapely.Point(point)
        if region.shape.covers(here):
            continue
        lon, lat = point
        if not _is_on_earth(lon, lat):
            continue  # it has a fault already
        import pyproj

        nearest = shapely.get_coordinates(shapely.shortest_line(here, region.shape))[-1]
        distance_km = pyproj.Geod(ellps="WGS84").inv(lon, lat, *nearest)[2] / 1000
        bounds = ", ".join(f"{bound:g}" for bound in region.shape.bounds)
        yield (
            f"{name} = {list(point)} lies {distance_km:.0f} km outside the region (its bounds: "
            f"{bounds}); {_swapped_hint(region, point)}"
        )


def _swapped_hint(region: Region, point: Point) -> str:
    """Say what to do about a point outside the region: its coordinates may be swapped."""
    lon, lat = point
    import shapely

    if region.shape.covers(shapely.Point(lat, lon)):
        return f"did you mean [{lat:g}, {lon:g}]? A place is [longitude, latitude]"
    return "move it inside or widen the region"


def _uncovered_voyage(endpoints: dict[str, Point], seasons: tuple[Season, ...]) -> Iterator[str]:
    """Find seasons without a source that covers start and goal, whatever region is chosen."""
    is_complete = {"start", "goal"} <= endpoints.keys()
    if is_complete and all(_is_on_earth(*point) for point in endpoints.values()):
        yield from _uncovered_seasons(least_region(*endpoints.values()), seasons)


def least_region(*stops: Point) -> Polygon:
    """Return the line from stop to stop with little room around: part of any region they get."""
    import shapely

    return shapely.LineString(stops).buffer(_AROUND_DEG)


def _uncovered_seasons(region: Polygon, seasons: tuple[Season, ...]) -> Iterator[str]:
    """Find seasons without a source that covers the region and the period."""
    from pipeline.sources.registry import current_source

    lacking: dict[str, list[str]] = {}
    for season in seasons:
        reasons = [
            current_source(named).uncovered_reason(region, season)
            for named in season.currents
            if not isinstance(named, str) or _gives_currents(named)
        ]
        if reasons and all(reasons):
            lacking.setdefault("; ".join(reasons), []).append(repr(season.name))
    for reason, names in lacking.items():
        yield f"season{'s' * (len(names) > 1)} {', '.join(names)}: {reason}"


def _gives_currents(name: str) -> bool:
    """Whether a name is that of a source of currents; any other has a fault already."""
    known = name in catalogue.names("sources")
    return known and not isinstance(catalogue.source(name), catalogue.ChartEntry)
