"""Checks of a request against its sources: the area that currents cover, and stops on land."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import shapely

import renew
from pipeline._types import Geometries
from pipeline.errors import Faults, RequestError
from pipeline.findings.note_words import MORE_CURRENTS
from pipeline.geo.lonlat import Bounds, common_bounds
from pipeline.geo.projection import Projection
from pipeline.model.inputs import LandSource
from pipeline.scenario.catalogue import has_world_land
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import Season, source_name
from pipeline.scenario.strict import Point
from pipeline.sources.land.shapes import box_around
from pipeline.sources.land.vector import open_layer, read_havens
from pipeline.sources.registry import charted_land, current_source
from pipeline.stages.choosing.region_choice import MAX_LATITUDE, DirectLine
from pipeline.stages.places import avoided_zones, lakes_text, not_in_water

# Smallest margin of a region around its stops, degrees (about 100 m).
_AROUND_DEG = 1e-3
# Distance around a position within which the quick check searches for water, m.
_LOOK_M = 20_000.0
# Margin around land, m, that a way out of water keeps there: about the accuracy of most charts.
_MARGIN_M = 50.0


@dataclass(frozen=True, slots=True)
class Coverage:
    """Bounds that the currents of all seasons cover, and the source that limits each side.

    The order is west, south, east, north. A source is "" if only the world's edge limits that side.
    """

    bounds: Bounds
    sources: tuple[str, str, str, str]


def least_region(*stops: Point) -> shapely.Polygon:
    """Return the line through all stops with a small margin; every region contains it."""
    return shapely.LineString(stops).buffer(_AROUND_DEG)


def uncovered_seasons(scenario: Scenario) -> Iterator[str]:
    """Yield a message for each reason why no region or source covers some seasons and stops.

    The area is the region or, without one, the stops. Each caller that plans calls this first,
    because loading a scenario file does not check the sources.
    """
    if scenario.is_planar:
        return
    stops = scenario.stops.values()
    region = least_region(*stops) if scenario.region is None else scenario.region.shape
    for name, (lon, lat) in scenario.stops.items() if scenario.region is None else ():
        if abs(lat) > MAX_LATITUDE:
            yield (
                f"{name} = {[lon, lat]} lies beyond {MAX_LATITUDE:g} degrees of latitude, where no "
                "region is chosen; move it away from the pole, or give a [region]"
            )
    lacking: dict[str, list[str]] = {}
    for season in scenario.seasons:
        sources = map(current_source, season.currents)
        reasons = [source.uncovered_reason(region, season) for source in sources]
        if all(reasons):
            lacking.setdefault("; ".join(reasons), []).append(repr(season.name))
    for reason, names in lacking.items():
        yield f"season{'s' * (len(names) > 1)} {', '.join(names)}: {reason}"


def require_covered(scenario: Scenario) -> None:
    """Raise RequestError if no source covers a season, with a line for each reason."""
    if faults := list(uncovered_seasons(scenario)):
        raise RequestError(faults)


def require_sailable(scenario: Scenario) -> None:
    """Raise RequestError if no source covers a season or a stop lies on land."""
    if faults := [*uncovered_seasons(scenario), *endpoints_on_land(scenario)]:
        raise RequestError(faults)


def require_whole_files(scenario: Scenario) -> None:
    """Raise RequestError if a file of the scenario's charts, areas or havens can't be used.

    The currents' files are opened by `require_sailable`, and so are those of the tide.
    """
    if scenario.is_planar:
        return
    faults = Faults()
    region = least_region(*scenario.stops.values())
    if scenario.region is not None:
        region = scenario.region.shape
        faults.collect(lambda: avoided_zones(scenario, region))
    for area in scenario.avoid if scenario.region is None else ():
        version = (Path(area.path).stat().st_mtime_ns,)
        faults.collect(partial(open_layer, Path(area.path), area.layer, area.crs, version))
    if (havens := scenario.havens) is not None:
        faults.collect(lambda: read_havens(Path(havens.path)))
    if scenario.chart.depths or any(source.path for source in scenario.chart.source):
        faults.collect(lambda: charted_land(scenario).land(region))
    if faults.lines:
        raise RequestError(faults.lines)


def covered_by_currents(
    seasons: Sequence[Season], direct: DirectLine, folder: Path, *, offline: bool
) -> Coverage:
    """Return the area that the first usable source of every season covers.

    A usable source is available and covers start and goal. A season without a usable source is
    ignored here, and fails later. Downloads are cached in `folder`.

    Raises
    ------
    RequestError
        No season has a usable source; the message has a line for each reason.
    """
    middle = (direct.start[0] + direct.goal[0]) / 2
    world = (max(middle - 180, -180), -MAX_LATITUDE, min(middle + 180, 360), MAX_LATITUDE)
    found = Coverage(world, ("", "", "", ""))
    reasons: dict[str, list[str]] = {}
    for season in seasons:
        covered, why = _of_season(season, world, direct, folder, offline=offline)
        if covered is None:
            reasons.setdefault(why, []).append(repr(season.name))
        else:
            found = _intersection(found, covered)
    if sum(map(len, reasons.values())) == len(seasons):
        raise RequestError(
            [
                f"season{'s' * (len(names) > 1)} {', '.join(names)}: no currents for this voyage: "
                f"{why}; {MORE_CURRENTS}"
                for why, names in reasons.items()
            ]
        )
    return found


def _of_season(
    season: Season, world: Bounds, direct: DirectLine, folder: Path, *, offline: bool
) -> tuple[Coverage | None, str]:
    """Return the coverage of a season's first usable source, or None and the reason."""
    ends = least_region(direct.start, direct.goal)
    reasons = []
    for named in season.currents:
        source = current_source(named, season.members)
        name = source_name(named)
        reason = source.uncovered_reason(ends, season)
        if not reason and source.needs_network(ends, season, folder):
            reason = source.unavailable_reason()
            if offline:
                reason = f"{name} needs the network; leave --offline out"
        bounds = source.covered_bounds(shapely.box(*world), season)
        if not reason and bounds is not None:
            return Coverage(bounds, (name, name, name, name)), ""
        reasons.append(reason or f"{name} has no data there")
    return None, "; ".join(reasons)


def _intersection(one: Coverage, other: Coverage) -> Coverage:
    """Return the intersection of two coverages that both contain start and goal."""
    bounds = common_bounds(one.bounds, other.bounds)
    if bounds is None:
        raise RequestError("the seasons' currents have no water in common; plan each by itself")
    west, south, east, north = (
        theirs if edge == limit and edge != ours_edge else ours
        for edge, limit, ours_edge, ours, theirs in zip(
            bounds, other.bounds, one.bounds, one.sources, other.sources, strict=True
        )
    )
    return Coverage(bounds, (west, south, east, north))


def endpoints_on_land(scenario: Scenario) -> list[str]:
    """Return a message for each stop that lies on land; none for a plane scenario."""
    if scenario.is_planar:
        return []
    source = charted_land(scenario)
    return [
        fault
        for name, (lon, lat) in scenario.stops.items()
        if (fault := _on_land(scenario, source, name, lon, lat))
    ]


def _on_land(scenario: Scenario, source: LandSource, name: str, lon: float, lat: float) -> str:
    """Return a message with a remedy if a position lies on land, otherwise ""."""
    region = box_around(shapely.Point(lon, lat), _LOOK_M)
    land = _land_near(source, lon, lat)
    if not shapely.intersects_xy(land, lon, lat).any():
        return ""
    projection = Projection.for_region(region)
    try:
        chart = renew.Chart(
            projection.geometry_to_plane(region), projection.geometry_to_plane(land)
        )
    except renew.GeometryError:
        remedy = _remedy(source, lon, lat) or f"move it into water{lakes_text(scenario)}"
        return (
            f"{name} = {[lon, lat]} lies on land, more than {_LOOK_M / 1000:.0f} km from the "
            f"nearest water; {remedy}"
        )
    here = shapely.Point(projection.to_plane((lon, lat)))
    return not_in_water(scenario, name, here, chart, projection, margin_m=_MARGIN_M)


def _remedy(source: LandSource, lon: float, lat: float) -> str:
    """Return the remedy for a position far inland whose coordinates may be swapped, or ""."""
    can_swap = -90 <= lon <= 90
    if can_swap and not shapely.intersects_xy(_land_near(source, lat, lon), lat, lon).any():
        return f"did you mean [{lat:g}, {lon:g}]? A place is [longitude, latitude]"
    return ""


def are_water_swapped(scenario: Scenario, places: Iterable[Point]) -> bool:
    """Whether positions with longitude and latitude exchanged are water on the world's chart."""
    source = charted_land(scenario)
    swapped = [(lat, (lon + 180) % 360 - 180) for lon, lat in places]
    return has_world_land(scenario.chart) and not any(
        abs(lat) > 90 or shapely.intersects_xy(_land_near(source, lon, lat), lon, lat).any()
        for lon, lat in swapped
    )


def _land_near(source: LandSource, lon: float, lat: float) -> Geometries:
    """Return the chart's land around a position; empty if the chart has nothing near it.

    The run itself checks with its whole region whether the chart covers it.
    """
    try:
        found = source.land(box_around(shapely.Point(lon, lat), _LOOK_M)).polygons
    except RequestError:
        found = ()
    return np.array(found, dtype=object)
