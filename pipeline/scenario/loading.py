"""Load a scenario from its file, and check it; write a scenario as TOML.

The keys of a file are checked first, all at once, and then whether its tables go together. No data
are opened here: `pipeline.stages.region` checks whether the sources cover region and time.
"""

import glob
import json
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from pipeline.errors import Fault, Faults, RequestError, refuse_any
from pipeline.machine import paths
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import EXAMPLE, ScenarioFile
from pipeline.scenario.model import Scenario, wait_at
from pipeline.scenario.pairs import refusals
from pipeline.scenario.region import MAX_PLANE_M, Plane, Region
from pipeline.scenario.season import Season
from pipeline.scenario.strict import looks_like_path, near_miss, validated

_AS_PATH = "; write a folder or file as a path: './charts', './field.nc'"


def load_scenario(
    asked: str | ScenarioFile,
    *,
    charts: Sequence[Mapping[str, Any]] = (),
    currents: Sequence[str | Path] = (),
    on_note: Callable[[str], None] | None = None,
) -> Scenario:
    """Load a scenario by its name in the catalogue, by its path, or from a file that was read.

    Relative paths in the file start at its own folder. `charts` are tables of sources of land that
    replace those of the scenario's chart. `currents` are files that belong together, and sources of
    the catalogue in order of preference: they replace every season's currents; seasons that
    embedded tables lack are left out, and `on_note` is called with a note for each. Raises
    RequestError if not found, not a scenario, or invalid: one line for each fault.
    """
    path, _, table = catalogue.read_scenario(asked) if isinstance(asked, str) else asked
    if not {"start", "goal", "seasons"} & table.keys():
        raise RequestError(
            f"{path} is TOML but not a scenario: it has no start, goal or seasons; {EXAMPLE}"
        )
    faults = Faults()
    if charts:
        table = _with_charts(table, charts)
    if currents:
        table, notes = faults.collect(partial(with_currents, table, currents)) or (table, [])
        if on_note is not None:
            for note in notes:
                on_note(note)
    scenario = faults.collect(lambda: parse_scenario(table, path.parent))
    if scenario is None or faults.lines:
        raise RequestError(faults.lines)
    return scenario


def parse_scenario(data: dict[str, Any], folder: Path | None = None) -> Scenario:
    """Check a scenario's table, and resolve its catalogue names and paths (from `folder`).

    Raises RequestError with a line for each faulty key; or, where all keys are valid, for each
    fault between them.
    """
    scenario = validated(Scenario, data, folder=folder or paths.working_directory())
    faults = [
        *refusals(scenario),
        *_repeated_seasons(scenario),
        *_plane_faults(scenario),
        *_time_faults(scenario),
        *_waiting_faults(scenario),
        *_limit_faults(scenario),
        *_under_way_faults(scenario),
        *_unknown_sources(scenario),
        *_missing_paths(scenario),
        *_misplaced_stops(scenario),
    ]
    refuse_any(faults)
    return scenario


def _with_charts(data: dict[str, Any], charts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Replace a scenario's sources of land."""
    chart, source = data.get("chart", {}), list(map(dict, charts))
    return {**data, "chart": {**chart, "source": source}} if isinstance(chart, dict) else data


def _repeated_seasons(scenario: Scenario) -> Iterator[str]:
    for name, count in Counter(season.name for season in scenario.seasons).items():
        if count > 1:
            yield f"has {count} seasons called {name!r}; rename all but one"


def _plane_faults(scenario: Scenario) -> Iterator[str]:
    """Find a plane that is too large, or that begins elsewhere than its gyres."""
    if scenario.plane is None:
        return
    width_km = scenario.plane.width_m * scenario.scale / 1000
    if width_km > MAX_PLANE_M / 1000:
        yield (
            f"has a plane of {width_km:,.0f} true km at scale = {scenario.scale:g}; "
            f"{MAX_PLANE_M / 1000:,.0f} km is the most: lower scale or extent"
        )
    corner = scenario.plane.extent[:2]
    for season in scenario.seasons:
        if season.gyre and corner != (0, 0):
            yield (
                f"season {season.name!r} is a gyre, but the plane's extent begins at "
                f"{list(corner)}; begin it at [0, 0]"
            )


def _time_faults(scenario: Scenario) -> Iterator[str]:
    """Find hours without a clock, choices of times where nothing changes, and too short limits."""
    hours = _keys_with_hours(scenario)
    for season in scenario.seasons:
        if not hours:
            yield from _timeless_faults(season)
        elif season.first_departure is None:
            for key, remedy in hours.items():
                yield (
                    f"season {season.name!r} has no 'departure', from which the hours of {key} "
                    f"count; add it, or leave {remedy} out"
                )
    havens, turn_s = scenario.havens, 360 / scenario.vessel.turn_rate_deg_s
    power = scenario.vessel.power
    if havens and not (havens.within or havens.endurance or (power and power.usable_j)):
        yield (
            "has havens with neither 'within' nor 'endurance'; give one of the two, as within = "
            "'6h', or the vessel's battery or tank"
        )
    if havens is not None and havens.within_s is not None and havens.within_s < turn_s:
        yield (
            f"has havens.within = {havens.within!r}, and one full turn takes the vessel "
            f"{turn_s:.0f} s; give more"
        )


def _keys_with_hours(scenario: Scenario) -> dict[str, str]:
    """Return the keys with hours that shut water, and what to leave out to drop the hours."""
    keys = {}
    if any(area.has_hours for area in scenario.avoid):
        keys["[[avoid]]"] = "'from' and 'until'"
    if scenario.tide is not None:
        keys["[tide]"] = "it"
    if scenario.limits is not None:
        keys["[limits]"] = "it"
    return keys


def _limit_faults(scenario: Scenario) -> Iterator[str]:
    """Find limits of weather without files, and files without a limit."""
    spec, limits = scenario.limits, scenario.weather_limits
    if spec is None:
        return
    by_wind = {"wind_m_s", "gust_m_s", "leeway"}
    by_key = (("waves", "wave_m = 1.2", {"wave_m", "period_s"}), ("wind", "wind_m_s = 12", by_wind))
    for key, option, names in by_key:
        given = [name for name in sorted(names) if getattr(spec, name) is not None]
        has_limit = any(getattr(limits, name) is not None for name in names)
        if given and not getattr(spec, key):
            yield (
                f"has limits.{given[0]}, but no limits.{key} to hold it against; give files: "
                f"limits.{key} = ['FILE'] (--{key} FILE)"
            )
        if getattr(spec, key) and not has_limit:
            yield (
                f"has limits.{key}, and neither [limits] nor the vessel has a limit for it; add "
                f"limits.{option} (--max-{key.removesuffix('s')}), or leave limits.{key} out"
            )


def _timeless_faults(season: Season) -> Iterator[str]:
    """Find keys that need water that changes with time, in a season whose water does not."""
    given = [
        repr(name)
        for name in ("departures", "to_within", "arrive_by")
        if getattr(season, name) is not None and (name != "arrive_by" or season.speed is None)
    ]
    if given and not season.is_changing:
        yield (
            f"(season {season.name!r}) has {' and '.join(given)}, which "
            f"need{'s' * (len(given) == 1)} currents that change, a [tide], [limits], or hours in "
            "[[avoid]]; add time_method = 'changing', or leave them out"
            + (", or give speeds to choose from" if given == ["'arrive_by'"] else "")
        )


def _waiting_faults(scenario: Scenario) -> Iterator[str]:
    """Find more than one wait at anchorages, and a wait where nothing changes with time."""
    waiting = [f"via[{at}].wait" for at, via in enumerate(scenario.via) if wait_at(via)]
    if len(waiting) > 1:
        yield (
            f"has {' and '.join(waiting)}; a plan waits at one anchorage: leave out the other "
            "waits, or plan the way on from there by itself"
        )
    has_hours = bool(_keys_with_hours(scenario))
    for season in scenario.seasons if waiting else ():
        if season.first_departure is None or not (season.is_changing or has_hours):
            yield (
                f"season {season.name!r} has nothing to wait for at {waiting[0]}: give it a "
                "'departure', with a [tide], [limits], hours in [[avoid]] or time_method = "
                "'changing', or leave the wait out"
            )


def _under_way_faults(scenario: Scenario) -> Iterator[str]:
    """Find what a voyage under way lacks: region, one season, and a departure after it left."""
    if scenario.under_way is None or scenario.plane is not None:
        return
    if scenario.region is None:
        yield "has [under_way], which needs the [region] of the plan's results; add it"
    if len(scenario.seasons) != 1:
        yield f"has [under_way] and {len(scenario.seasons)} seasons; give the one that is sailed"
        return
    (season,) = scenario.seasons
    departure, departed = season.first_departure, scenario.under_way.departed
    if departure is None:
        yield f"season {season.name!r} has no 'departure', the time at 'start'; add it"
    elif departure < departed:
        yield (
            f"season {season.name!r} has departure = {departure.isoformat()}, before "
            f"under_way.departed = {departed.isoformat()}; give a later time"
        )


def _missing_paths(scenario: Scenario) -> Iterator[str]:
    """Find charts and lists of havens that do not exist or can't be read."""
    chart, havens = scenario.chart, scenario.havens
    what = "a vector file, or a folder of S-57 cells"
    named = [("chart.source", source.path, what) for source in chart.source]
    named.append(("chart.depths", chart.depths, "a GEBCO or EMODnet grid in NetCDF"))
    named.append(("havens.path", havens.path if havens else "", "a GeoJSON file with points"))
    for key, path, what in named:
        if path and (reason := paths.unreadable_reason(path)):
            remedy = f"; give {what}" if reason == paths.NOT_THERE else ""
            yield f"{key} = '{paths.shown(path)}' {reason}{remedy}"
    if chart.depths and scenario.vessel.draught_m is None:
        yield f"vessel.draught_m is missing, and chart.depths needs it: {catalogue.DRAUGHT}"


def _unknown_sources(scenario: Scenario) -> Iterator[str]:
    """Find names of sources that are not in the catalogue, or that give the wrong kind of data."""
    charts = scenario.chart.source
    named = [
        (f"chart.source[{i}]" if len(charts) > 1 else "chart.source", chart.name, True)
        for i, chart in enumerate(charts)
        if chart.name
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


def _misplaced_stops(scenario: Scenario) -> Iterator[str]:
    """Find stops off the earth, outside the region or plane, or equal to the stop before."""
    stops = scenario.stops
    for (stop, place), (next_stop, after) in pairwise(stops.items()):
        if place == after:
            yield (
                f"{stop} and {next_stop} are the same place, {list(place)}; give two places to "
                "sail between"
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
    """Say how far a stop lies outside the region, or that its coordinates are swapped."""
    import shapely

    here = shapely.Point(lon, lat)
    if region.shape.covers(here):
        return
    import pyproj

    nearest = shapely.get_coordinates(shapely.shortest_line(here, region.shape))[-1]
    distance_km = pyproj.Geod(ellps="WGS84").inv(lon, lat, *nearest)[2] / 1000
    bounds = ", ".join(f"{bound:g}" for bound in region.shape.bounds)
    remedy = "move it inside or widen the region"
    if "--at" in name:  # under way the region is that of the plan
        remedy = "correct it, or plan from there anew with renew go"
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
    sources: list[str | list[str]] = []
    files: list[str] = []
    for name in map(str, asked):
        if name in known:
            sources.append(name)
            continue
        if not files:
            sources.append(files)
        files.append(str(paths.resolved(name, "--currents")))
    return sources


def require_currents(asked: Sequence[str | Path], key: str = "--currents") -> None:
    """Raise RequestError if `key` names a file that can't be read, or an unknown source.

    Patterns of files are looked up later.
    """
    known = catalogue.names("sources")
    faults = []
    for name in map(str, asked):
        if name in known or glob.has_magic(name):
            continue
        if reason := paths.unusable_reason(name):
            faults.append(f"{key} {paths.shown(name)} {reason}")
            continue
        reason = paths.unreadable_reason(paths.resolved(name, key))
        if reason == paths.NOT_THERE:
            hint = "give a NetCDF, GRIB or Zarr file"
            if not looks_like_path(name):
                hint = f"it is no source of the catalogue either: {near_miss(name, known)}"
            reason = f"{reason}; {hint}"
        if reason:
            faults.append(f"{key} = '{paths.shown(name)}' {reason}".lstrip())
    refuse_any(faults)


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
    tables = [catalogue.source(name) for name in currents if isinstance(name, str)]
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
        given = {key: entry for key, entry in value.items() if entry not in (None, "")}
        return f"{{ {', '.join(f'{key} = {inline(entry)}' for key, entry in given.items())} }}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(inline, value))}]"
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
        for inner_table in value if _is_list(value) else (value,):
            yield ""
            yield f"[[{name}]]" if _is_list(value) else f"[{name}]"
            yield from _lines(inner_table, name)


def _is_list(value: object) -> bool:
    """Whether a value is a list of tables."""
    return (
        isinstance(value, list) and bool(value) and all(isinstance(entry, dict) for entry in value)
    )
