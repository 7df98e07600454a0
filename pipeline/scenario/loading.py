"""Load a scenario's file, with the currents that `--currents` names; write a scenario as TOML.

The keys of a file are checked first, all at once, then whether its tables go together. Sources are
not asked here: `pipeline.stages.choosing.coverage` checks whether their data cover a season.
"""

import glob
import json
import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from pipeline.errors import Fault, Faults, RequestError
from pipeline.machine.paths import NOT_THERE, resolved, shown, unreadable_reason, working_directory
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import EXAMPLE, ScenarioFile
from pipeline.scenario.model import Scenario
from pipeline.scenario.region import Plane, Region
from pipeline.scenario.season import Season
from pipeline.scenario.strict import looks_like_path, near_miss, validated

_AS_PATH = "; write a folder or file as a path: './charts', './field.nc'"


def load_scenario(
    asked: str | ScenarioFile,
    *,
    charts: Path | None = None,
    currents: Sequence[str | Path] = (),
    on_note: Callable[[str], None] | None = None,
) -> Scenario:
    """Load a scenario by its name in the catalogue or its path, or from its file that was read.

    Parameters
    ----------
    asked
        The name, the path or the file. Relative paths in the file start at its own folder.
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
    path, _, table = catalogue.read_scenario(asked) if isinstance(asked, str) else asked
    if not {"start", "goal", "seasons"} & table.keys():
        raise RequestError(
            f"{path} is TOML but not a scenario: it has no start, goal or seasons; {EXAMPLE}"
        )
    faults = Faults()
    if charts is not None:
        table = faults.collect(partial(_with_chart, table, charts)) or table
    if currents:
        table, notes = faults.collect(partial(with_currents, table, currents)) or (table, [])
        if on_note is not None:
            for note in notes:
                on_note(note)
    scenario = faults.collect(lambda: parse_scenario(table, path.parent))
    if scenario is not None:
        faults.lines += _kept_members(scenario)
    if scenario is None or faults.lines:
        raise RequestError(faults.lines)
    return scenario


def parse_scenario(data: dict[str, Any], folder: Path | None = None) -> Scenario:
    """Check a scenario's table, and resolve its catalogue names and paths (from `folder`).

    Raises
    ------
    RequestError
        One line for each faulty key; or, where all keys are valid, for each fault between them.
    """
    scenario = validated(Scenario, data, folder=folder or working_directory())
    faults = [
        *_unknown_sources(scenario),
        *_missing_paths(scenario),
        *_missing_draught(scenario),
        *_misplaced_stops(scenario),
    ]
    if faults:
        raise RequestError(faults)
    return scenario


def _with_chart(data: dict[str, Any], charts: Path) -> dict[str, Any]:
    """Replace a scenario's chart by the user's file or folder."""
    chart = data.get("chart", {})
    source = {"path": str(resolved(charts, "--charts"))}
    return {**data, "chart": {**chart, "source": source}} if isinstance(chart, dict) else data


def _missing_paths(scenario: Scenario) -> Iterator[str]:
    """Find charts and lists of havens that do not exist or can't be read."""
    chart, havens = scenario.chart, scenario.havens
    for one in chart.source:
        if one.path and (reason := unreadable_reason(one.path)):
            remedy = "; give a vector file, or a folder of S-57 cells"
            remedy = remedy if reason == NOT_THERE else ""
            yield f"chart.source = '{shown(one.path)}' {reason}{remedy}"
    if chart.depths and (reason := unreadable_reason(chart.depths)):
        remedy = "; give a GEBCO or EMODnet grid in NetCDF" if reason == NOT_THERE else ""
        yield f"chart.depths = '{shown(chart.depths)}' {reason}{remedy}"
    if havens is not None and (reason := unreadable_reason(havens.path)):
        remedy = "; give a GeoJSON file with points" if reason == NOT_THERE else ""
        yield f"havens.path = '{shown(havens.path)}' {reason}{remedy}"


def _kept_members(scenario: Scenario) -> Iterator[str]:
    """Find members that are the forecasts of a night, which other commands don't have."""
    for at, season in enumerate(scenario.seasons):
        if season.members is not None and season.members.are_kept:
            yield (
                f"seasons[{at}].members (season {season.name!r}) has neither 'along' nor 'spread', "
                "and only renew nightly keeps forecasts; give one of the two"
            )


def _unknown_sources(scenario: Scenario) -> Iterator[str]:
    """Find names that are not in the catalogue, or that name other data than the key needs."""
    charts = scenario.chart.source
    named = [
        (f"chart.source[{i}]" if len(charts) > 1 else "chart.source", one.name, True)
        for i, one in enumerate(charts)
        if one.name
    ]
    named += [
        (f"seasons[{i}].currents[{j}]", name, False)
        for i, season in enumerate(scenario.seasons)
        for j, name in enumerate(season.currents)
        if isinstance(name, str)
    ]
    known = catalogue.names("sources")
    for key, name, needs_land in named:
        if name not in known:
            yield Fault(key, f" {catalogue.unknown('source', name, known)}{_AS_PATH}")
        elif isinstance(catalogue.source(name), catalogue.ChartEntry) is not needs_land:
            yield (
                f"{key} = {name!r} gives currents, not land; use 'osm-land'"
                if needs_land
                else f"{key} = {name!r} gives land, not currents; name a source of currents"
            )


def _missing_draught(scenario: Scenario) -> Iterator[str]:
    """Find a chart with depths whose vessel has no draught."""
    if scenario.chart.depths and scenario.vessel.draught_m is None:
        yield (
            "vessel.draught_m is missing, and chart.depths needs it: give the vessel's draught in "
            "metres (--draught)"
        )


def _misplaced_stops(scenario: Scenario) -> Iterator[str]:
    """Find stops off the earth, outside the region or plane, or equal to the stop before."""
    stops = scenario.stops
    for (one, place), (other, after) in pairwise(stops.items()):
        if place == after:
            yield (
                f"{one} and {other} are the same place, {list(place)}; give two places to sail "
                "between"
            )
    for name, (x, y) in stops.items():
        if scenario.plane is not None:
            yield from _outside_plane(scenario.plane, name, x, y)
        elif not _is_on_earth(x, y):
            hint = f"; did you mean [{y:g}, {x:g}]?" if _is_on_earth(y, x) else ""
            yield f"{name} = {[x, y]} is not a place on earth: give [longitude, latitude]{hint}"
        elif scenario.region is not None:
            yield from _outside_region(scenario.region, name, x, y)


def _is_on_earth(lon: float, lat: float) -> bool:
    """Whether two figures are a longitude and a latitude, degrees."""
    return -180 <= lon <= 360 and -90 <= lat <= 90


def _outside_plane(plane: Plane, name: str, x: float, y: float) -> Iterator[str]:
    """Say how far a stop lies outside the plane, metres."""
    xmin, ymin, xmax, ymax = plane.extent
    distance = math.hypot(max(xmin - x, 0.0, x - xmax), max(ymin - y, 0.0, y - ymax))
    if distance > 0:
        yield (
            f"{name} = {[x, y]} lies {distance:.4g} m outside plane.extent "
            f"{list(plane.extent)}; move it inside or widen the extent"
        )


def _outside_region(region: Region, name: str, lon: float, lat: float) -> Iterator[str]:
    """Say how far a stop lies outside the region; its coordinates may be swapped."""
    import shapely

    here = shapely.Point(lon, lat)
    if region.shape.covers(here):
        return
    import pyproj

    nearest = shapely.get_coordinates(shapely.shortest_line(here, region.shape))[-1]
    distance_km = pyproj.Geod(ellps="WGS84").inv(lon, lat, *nearest)[2] / 1000
    bounds = ", ".join(f"{bound:g}" for bound in region.shape.bounds)
    remedy = "move it inside or widen the region"
    if region.shape.covers(shapely.Point(lat, lon)):
        remedy = f"did you mean [{lat:g}, {lon:g}]? A place is [longitude, latitude]"
    yield (
        f"{name} = {[lon, lat]} lies {distance_km:.0f} km outside the region (its bounds: "
        f"{bounds}); {remedy}"
    )


def asked_currents(asked: Sequence[str | Path]) -> list[str | list[str]]:
    """Return the sources that --currents names, in their order of preference.

    Names of the catalogue stay as they are; files are one source, in the place of the first.
    """
    known = catalogue.names("sources")
    found: list[str | list[str]] = []
    files: list[str] = []
    for one in map(str, asked):
        if one in known:
            found.append(one)
            continue
        if not files:
            found.append(files)
        files.append(str(resolved(one, "--currents")))
    return found


def require_currents(asked: Sequence[str | Path], key: str = "--currents") -> None:
    """Raise RequestError if `key` names a file that can't be read, or an unknown source.

    Patterns of files are looked up later.
    """
    known = catalogue.names("sources")
    faults = []
    for one in map(str, asked):
        if one in known or glob.has_magic(one):
            continue
        reason = unreadable_reason(resolved(one, key))
        if reason == NOT_THERE:
            hint = "give a NetCDF, GRIB or Zarr file"
            if not looks_like_path(one):
                hint = f"it is no source of the catalogue either: {near_miss(one, known)}"
            reason = f"{reason}; {hint}"
        if reason:
            faults.append(f"{key} = '{shown(one)}' {reason}".lstrip())
    if faults:
        raise RequestError(faults)


def require_seasons(scenario: Scenario, asked: Sequence[str]) -> None:
    """Raise RequestError for names of seasons that a scenario does not have."""
    known = [season.name for season in scenario.seasons]
    faults = [
        f"{scenario.name} has no season {name!r}: it has {', '.join(known)}"
        for name in asked
        if name not in known
    ]
    if faults:
        raise RequestError(faults)


def with_currents(
    data: dict[str, Any], asked: Sequence[str | Path]
) -> tuple[dict[str, Any], list[str]]:
    """Replace the currents of a scenario's seasons by the sources that --currents names.

    Embedded tables hold some seasons only. The other seasons are left out, each with a note, unless
    no season would remain.
    """
    if "plane" in data:
        raise RequestError(
            "--currents needs a scenario with a [region]; a [plane] gives its current as numbers"
        )
    require_currents(asked)
    currents = asked_currents(asked)
    given = data.get("seasons")
    seasons = [
        {**season, "currents": currents} if isinstance(season, dict) else season
        for season in (given if isinstance(given, list) else [])
    ]
    held = [season for season in seasons if not _is_in_no_table(season, currents)]
    if not held:
        return {**data, "seasons": seasons}, []
    notes = [
        f"season {season['name']!r} is left out: {', '.join(map(str, currents))} has no such season"
        for season in seasons
        if season not in held
    ]
    return {**data, "seasons": held}, notes


def _is_in_no_table(season: object, currents: Sequence[str | list[str]]) -> bool:
    """Whether a valid season has only embedded tables as sources, and is in none of them."""
    tables = [catalogue.source(one) for one in currents if isinstance(one, str)]
    try:
        valid = Season.model_validate(season)
    except ValidationError:
        return False
    return len(tables) == len(currents) and all(
        isinstance(table, catalogue.EmbeddedTableSpec) and table.season_for(valid) is None
        for table in tables
    )


def inline(value: object) -> str:
    """Spell a value as in TOML, on one line; empty entries of tables are left out."""
    if isinstance(value, dict):
        given = {key: one for key, one in value.items() if one not in (None, "")}
        return f"{{ {', '.join(f'{key} = {inline(one)}' for key, one in given.items())} }}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(inline(one) for one in value)}]"
    # As in JSON, except for the one control character that JSON does not escape.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def scenario_text(scenario: Scenario) -> str:
    """Spell a scenario as TOML, without defaults; a known vessel by its name."""
    table = scenario.model_dump(mode="json", exclude_defaults=True)
    table = {"schema_version": scenario.schema_version, **table}
    name = scenario.vessel.name
    if name in catalogue.names("vessels") and catalogue.vessel(name) == scenario.vessel:
        table["vessel"] = name
    return "\n".join(_lines(table, "")) + "\n"


def _lines(table: dict[str, Any], path: str) -> Iterator[str]:
    """Yield the lines of a table: its values first, then the tables in it."""
    inner = {
        key: value for key, value in table.items() if isinstance(value, dict) or _is_list(value)
    }
    for key, value in table.items():
        if key not in inner:
            yield f"{key} = {inline(value)}"
    for key, value in inner.items():
        name = f"{path}.{key}".strip(".")
        for one in value if _is_list(value) else (value,):
            yield ""
            yield f"[[{name}]]" if _is_list(value) else f"[{name}]"
            yield from _lines(one, name)


def _is_list(value: object) -> bool:
    """Whether a value is a list of tables."""
    return isinstance(value, list) and bool(value) and all(isinstance(one, dict) for one in value)
