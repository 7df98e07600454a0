"""Choose a missing region, check it against its sources, widen it where routes near its edge."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray, Geometries
from pipeline.errors import Faults, RequestError, refuse_any
from pipeline.findings.note_words import MORE_CURRENTS
from pipeline.findings.result import RunResult
from pipeline.geo.projection import METRES_PER_DEGREE, Bounds, Projection, bounds_of, common_bounds
from pipeline.machine.store import DOWNLOADS, Store, artefact_key
from pipeline.model import Note, Water, planner_vessel
from pipeline.model.inputs import LandSource
from pipeline.scenario.catalogue import has_world_land
from pipeline.scenario.model import Scenario
from pipeline.scenario.region import Region
from pipeline.scenario.season import Season, source_name
from pipeline.scenario.strict import Point
from pipeline.sources.combined_charts import Overlay
from pipeline.sources.current_field import LandMask
from pipeline.sources.land import osm
from pipeline.sources.land.shapes import box_around
from pipeline.sources.land.vector import read_havens
from pipeline.sources.registry import charted_land, current_source
from pipeline.sources.tide_stations import stations_of
from pipeline.stages.places import avoided_zones, check_datum, lakes_text, not_in_water
from pipeline.stages.water_grid import (
    FAR_WAY,
    MAX_LATITUDE,
    MAX_WIDTH,
    DirectLine,
    choose_region,
    rounded_outward,
    widened_by,
)

# Smallest margin of a region around its stops, degrees (about 100 m).
_AROUND_DEG = 1e-3
# Distance around a position within which the quick check searches for water, m.
_LOOK_M = 20_000.0
# Margin around land, m, that a way out of water keeps there: about the accuracy of most charts.
_MARGIN_M = 50.0


def least_region(*stops: Point) -> shapely.Polygon:
    """Return the line through all stops with a small margin; every region contains it."""
    return shapely.LineString(stops).buffer(_AROUND_DEG)


def _known_region(scenario: Scenario) -> shapely.Polygon:
    """Return a scenario's region or, where that is open, the least one."""
    return scenario.region.shape if scenario.region else least_region(*scenario.stops.values())


def uncovered_seasons(scenario: Scenario) -> Iterator[str]:
    """Yield a message for each reason why no region or source covers some cases and stops.

    The area is the region or, without one, the stops. Each caller that plans calls this first,
    because loading a scenario file does not check the sources.
    """
    if scenario.is_planar:
        return
    stops, region = scenario.stops.values(), _known_region(scenario)
    for name, (lon, lat) in scenario.stops.items() if scenario.region is None else ():
        if abs(lat) > MAX_LATITUDE:
            yield (
                f"{name} = {[lon, lat]} lies beyond {MAX_LATITUDE:g} degrees of latitude, where no "
                "region is chosen; move it away from the pole, or in a scenario give a [region]"
            )
    east = [lon for lon, _ in stops] if scenario.region is None else [0.0]
    if (width := max(east) - min(east)) > MAX_WIDTH - 1:
        yield (
            f"the stops are {width:g} degrees of longitude apart, and a chart is at most "
            f"{MAX_WIDTH:g} wide; plan the voyage in parts"
        )
    lacking: dict[str, list[str]] = {}
    for season in scenario.seasons:
        about = season.members, season.current_variables
        sources = [current_source(named, *about) for named in season.currents]
        reasons = [source.uncovered_reason(region, season) for source in sources]
        if all(reasons):
            lacking.setdefault("; ".join(reasons), []).append(repr(season.name))
    for reason, names in lacking.items():
        yield f"season{'s' * (len(names) > 1)} {', '.join(names)}: {reason}"


def require_covered(scenario: Scenario) -> None:
    """Raise RequestError if no source covers a case, or an area that is always shut has a stop."""
    refuse_any([*uncovered_seasons(scenario), *_in_shut_areas(scenario)])


def require_sailable(scenario: Scenario) -> None:
    """Raise RequestError if no source covers a case, a stop lies on land, or a power is none."""
    planner_vessel(scenario.fastest_vessel)
    dry = endpoints_on_land(scenario, scenario.planner.snap)
    refuse_any([*uncovered_seasons(scenario), *dry])


def require_whole_files(scenario: Scenario) -> None:
    """Raise RequestError if a file of the scenario's charts, areas or havens can't be used.

    The currents' files are opened by `require_sailable`, and so are those of the tide.
    """
    if scenario.is_planar:
        return
    faults = Faults()
    faults.lines += faults.collect(lambda: _in_shut_areas(scenario)) or []
    if (havens := scenario.havens) is not None:
        faults.collect(lambda: read_havens(Path(havens.path)))
    tide = scenario.tide
    if tide or scenario.chart.depths or any(source.path for source in scenario.chart.source):
        land = faults.collect(lambda: charted_land(scenario).land(_known_region(scenario)))
        if tide and land:
            faults.collect(lambda: check_datum(scenario.chart, land, stations_of(tide)))
    refuse_any(faults.lines)


def _in_shut_areas(scenario: Scenario) -> list[str]:
    """Return a message for each stop in an avoided area that is always shut.

    Raises RequestError if a file of areas can't be read, or none of it is near a given region.
    """
    # A region that is chosen may have areas that these bounds lack.
    is_open = scenario.region is None
    zones, _ = avoided_zones(scenario.avoid, _known_region(scenario), may_be_far=is_open)
    return [
        f"{name} = {[lon, lat]} lies in area {zone.name!r} (avoid[{at}]), which is always shut; "
        "move it out of there, or give the area hours: 'from', 'until'"
        for (at, area), zone in zip(enumerate(scenario.avoid), zones, strict=True)
        for name, (lon, lat) in scenario.stops.items()
        if not area.has_hours and shapely.intersects_xy(zone.area, lon, lat)
    ]


def covered_by_currents(
    seasons: Sequence[Season], direct: DirectLine, folder: Path, *, offline: bool
) -> tuple[Bounds, tuple[str, ...]]:
    """Return the bounds that the first usable source of every case covers, and what limits them.

    The second value is the source that limits each side, as in SIDES; "" for the world's edge. A
    usable source is available and covers start and goal. A case without a usable source is ignored
    here, and fails later. Downloads are cached in `folder`. Raises RequestError if no case has a
    usable source, with a line for each reason; or the cases' sources have no water in common.
    """
    middle = (direct.start[0] + direct.goal[0]) / 2
    world = (max(middle - 180, -180), -MAX_LATITUDE, min(middle + 180, 360), MAX_LATITUDE)
    limits, sources = world, ("",) * len(SIDES)
    reasons: dict[str, list[str]] = {}
    for season in seasons:
        bounds, text = _covered_by(season, world, direct, folder, offline=offline)
        if bounds is None:
            reasons.setdefault(text, []).append(repr(season.name))
            continue
        common = common_bounds(limits, bounds)
        if common is None:
            raise RequestError("the seasons' currents have no water in common; plan each by itself")
        sources = tuple(
            text if edge == its_edge != limit else source
            for edge, its_edge, limit, source in zip(common, bounds, limits, sources, strict=True)
        )
        limits = common
    if sum(map(len, reasons.values())) == len(seasons):
        raise RequestError(
            [
                f"season{'s' * (len(names) > 1)} {', '.join(names)}: no currents for this voyage: "
                f"{why}; {MORE_CURRENTS}"
                for why, names in reasons.items()
            ]
        )
    return limits, sources


def _covered_by(
    season: Season, world: Bounds, direct: DirectLine, folder: Path, *, offline: bool
) -> tuple[Bounds | None, str]:
    """Return bounds and name of a case's first usable source, or None and why there is none."""
    ends = least_region(direct.start, direct.goal)
    reasons = []
    for named in season.currents:
        source = current_source(named, season.members, season.current_variables)
        name = source_name(named)
        reason = source.refusal(name, ends, season, folder, offline=offline)
        bounds = source.covered_bounds(shapely.box(*world), season)
        if not reason and bounds is not None:
            return bounds, name
        reasons.append(reason or f"{name} has no data there")
    return None, "; ".join(reasons)


def endpoints_on_land(scenario: Scenario, snap_m: float = 0.0) -> list[str]:
    """Return a message for each stop that lies more than `snap_m` from water; none for a plane."""
    if scenario.is_planar:
        return []
    source = charted_land(scenario)
    return [
        fault
        for name, (lon, lat) in scenario.stops.items()
        if (fault := _on_land(scenario, source, name, (lon, lat), snap_m))
    ]


def _on_land(scenario: Scenario, source: LandSource, name: str, place: Point, snap_m: float) -> str:
    """Return a message with a remedy if a position lies too far from water, otherwise ""."""
    lon, lat = place
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
        remedy = f"move it into water{lakes_text(scenario.chart)}"
        if scenario.chart.no_go == "land":
            remedy = _remedy(source, lon, lat) or remedy
        return (
            f"{name} = {[lon, lat]} lies on {scenario.chart.no_go}, more than "
            f"{_LOOK_M / 1000:.0f} km from the nearest water; {remedy}"
        )
    here = shapely.Point(projection.to_plane((lon, lat)))
    if snap_m and shapely.distance(chart.water, here) * projection.scale <= snap_m:
        return ""
    return not_in_water(scenario, name, here, Water(chart, (), projection), margin_m=_MARGIN_M)


def _remedy(source: LandSource, lon: float, lat: float) -> str:
    """Return the remedy for a position far inland whose coordinates may be swapped, or ""."""
    can_swap = -90 <= lon <= 90
    if can_swap and not shapely.intersects_xy(_land_near(source, lat, lon), lat, lon).any():
        return f"did you mean [{lat:g}, {lon:g}]? A place is [longitude, latitude]"
    return ""


def are_water_swapped(scenario: Scenario, places: Iterable[Point]) -> bool:
    """Whether positions with longitude and latitude exchanged are water on the world's chart."""

    def is_land(lon: float, lat: float) -> bool:
        near = osm.polygons_near("Osm", box_around(shapely.Point(lon, lat), _LOOK_M))[0][0]
        return bool(shapely.intersects_xy(near, lon, lat).any())

    swapped = [(lat, (lon + 180) % 360 - 180) for lon, lat in places]
    return has_world_land(scenario.chart) and not any(
        abs(lat) > 90 or is_land(lon, lat) for lon, lat in swapped
    )


def _land_near(source: LandSource, lon: float, lat: float) -> Geometries:
    """Return the chart's land around a position; empty if the chart has nothing near it.

    The run itself checks with its whole region whether the chart covers it.
    """
    box = box_around(shapely.Point(lon, lat), _LOOK_M)
    try:
        # The world's land without its second shoreline, which takes as long to read.
        is_world = source == Overlay((osm.OsmLand(),))
        found = (osm.land_polygons(box) if is_world else source.land(box)).polygons
    except RequestError:
        found = ()
    return np.array(found, dtype=object)


# Least extent of land that matters to the choice, as a share of the direct line's length.
_LEAST_LAND = 1 / 600
SIDES = ("west", "south", "east", "north")
"""The sides of bounds, in their order."""

# Distance from the edge below which a route is near it, as a share of the region's margin around
# start, goal and the ways between.
_NEAR = 0.3
# Growth of the region, as a share of that margin.
_GROWTH = 2.0
# Growth of a region without a way from start to goal, as a share of their distance.
_OPENING = 0.5
# Smallest growth that justifies another plan, as a share of the wanted growth.
_LEAST_GAIN = 0.1

MAX_WIDENINGS = 3
"""Largest number of times that a chosen region is widened; each time needs a new plan."""


@dataclass(frozen=True, slots=True)
class ChosenRegion:
    """A region's bounds, degrees, within the `limits` of the currents, and notes for the report.

    `sources` are those that limit each side, as in SIDES; `direct` is the longest leg.
    """

    bounds: Bounds
    limits: Bounds
    sources: tuple[str, ...]
    direct: DirectLine
    notes: tuple[Note, ...] = ()

    def with_line(self, line: FloatArray) -> "ChosenRegion":
        """Return the region, widened by its margin if a line (n, 2), degrees, is near its edge."""
        if not len(line) or not sides_near(self.bounds, [line], self.direct.margin_m):
            return self
        around = rounded_outward(widened_by(bounds_of(line), self.direct.margin_m))
        wider = common_bounds(bounds_of([self.bounds, around]), self.limits) or self.bounds
        (note,) = self.notes
        values = tuple((key, wider if key == "bounds" else one) for key, one in note.values)
        return replace(self, bounds=wider, notes=(replace(note, values=values),))

    def complete(self, scenario: Scenario) -> Scenario:
        """Return the scenario with this region."""
        return scenario.model_copy(update={"region": Region(bbox=self.bounds)})


def chosen_region(scenario: Scenario, store: Store, *, offline: bool) -> ChosenRegion:
    """Choose the region of a scenario from its positions, chart and currents.

    Raises RequestError if no usable source of currents covers start and goal.
    """
    lines = [DirectLine.between(*ends) for ends in pairwise(scenario.stops.values())]
    folder = store.root / DOWNLOADS
    # Every leg must be covered; all legs have the same sources.
    *_, (limits, sources) = (
        covered_by_currents(scenario.seasons, line, folder, offline=offline) for line in lines
    )
    direct = max(lines, key=lambda line: line.distance_m)
    source = charted_land(scenario)
    is_world = all(one.name == "osm-land" for one in scenario.chart.source)
    least_deg = _LEAST_LAND * direct.distance_m / METRES_PER_DEGREE

    def mask_of(bounds: Bounds) -> LandMask:
        box = shapely.box(*bounds)
        if is_world:
            return LandMask.of(osm.polygons_near("Osm", box, least_deg)[0][0], bounds)
        return LandMask.of(source.land(box).polygons, bounds)

    stops = tuple(scenario.stops.values())
    key = artefact_key("region", source.identity, *stops, limits)

    def choose() -> list[tuple[Bounds, bool]]:
        return [choose_region(line, mask_of, limits) for line in lines]

    choices = store.load_or_make("region", key, list, choose)
    bounds = bounds_of([bounds for bounds, _ in choices])
    planner = scenario.planner
    kept_m = planner.clearance or 0.0
    kept_m += 0.0 if isinstance(planner.padding, str) else planner.padding
    # Land beyond the margin is near a route that is to keep further off it.
    if (more_m := kept_m - min(line.margin_m for line in lines)) > 0:
        bounds = common_bounds(rounded_outward(widened_by(bounds, more_m)), limits) or bounds
    chosen = ChosenRegion(bounds, limits, sources, direct)
    note = Note.of(
        "region-chosen",
        bounds=bounds,
        ends=_ends_of_currents(chosen, range(len(SIDES))),
        left_out=FAR_WAY if any(leaves_out for _, leaves_out in choices) else 0.0,
    )
    chosen = replace(chosen, notes=(note,))
    return chosen.with_line(_havens_in_reach(scenario, bounds, direct.distance_m))


def _havens_in_reach(scenario: Scenario, bounds: Bounds, most_m: float) -> FloatArray:
    """Return a scenario's havens (n, 2), degrees, that a vessel might get to from bounds.

    They are at most `most_m` away, and as far as it gets in still water within the limits.
    """
    if (spec := scenario.havens) is None:
        return np.empty((0, 2))
    places = np.array([(one.x, one.y) for one in read_havens(Path(spec.path)).values()])
    low, high = np.array(bounds).reshape(2, 2)
    places[:, 0] -= 360 * np.round((places[:, 0] - (low[0] + high[0]) / 2) / 360)
    off = (places - np.clip(places, low, high)) * METRES_PER_DEGREE
    off[:, 0] *= np.cos(np.radians(places[:, 1]))
    longest_s = min(filter(None, (spec.within_s, spec.endurance_s)), default=np.inf)
    reach_m = min(most_m, scenario.fastest_vessel.speed_m_s * longest_s)
    return np.asarray(places[np.hypot(*off.T) <= reach_m])


def wider_region(chosen: ChosenRegion, paths: Sequence[FloatArray]) -> ChosenRegion | None:
    """Widen a region on the sides that a best route, (n, 2) in degrees, comes near.

    Returns None if no route comes near a side, or the currents end there; see `edge_notes`.
    """
    near = sides_near(chosen.bounds, paths, chosen.direct.margin_m)
    bounds = grown(chosen.bounds, near, _GROWTH * chosen.direct.margin_m, chosen.limits)
    if bounds == chosen.bounds:
        return None
    sides = tuple(SIDES[side] for side in near)
    note = Note.of("region-widened", bounds=bounds, near=sides)
    return replace(chosen, bounds=bounds, notes=(*chosen.notes, note))


def opened_region(chosen: ChosenRegion) -> ChosenRegion | None:
    """Widen a region without a way from start to goal; None if its currents reach no further."""
    further_m = _OPENING * chosen.direct.distance_m
    bounds = grown(chosen.bounds, range(len(SIDES)), further_m, chosen.limits)
    if bounds == chosen.bounds:
        return None
    note = Note.of("region-opened", bounds=bounds)
    return replace(chosen, bounds=bounds, notes=(*chosen.notes, note))


def edge_notes(chosen: ChosenRegion, paths: Sequence[FloatArray]) -> tuple[Note, ...]:
    """Return a note if a best route comes near an edge at which the currents end."""
    near = sides_near(chosen.bounds, paths, chosen.direct.margin_m)
    ends = _ends_of_currents(chosen, near)
    return (Note.of("route-near-edge", ends=ends),) if ends else ()


def _ends_of_currents(chosen: ChosenRegion, sides: Sequence[int]) -> tuple[Note, ...]:
    """Return a note for each source whose coverage limits the region on some of these sides."""
    ending: dict[str, list[str]] = {}
    for side in sides:
        source = chosen.sources[side]
        if source and chosen.bounds[side] == chosen.limits[side]:
            ending.setdefault(source, []).append(SIDES[side])
    return tuple(
        Note.of("currents-end", sides=tuple(names), source=source)
        for source, names in ending.items()
    )


def sides_near(bounds: Bounds, paths: Sequence[FloatArray], margin_m: float) -> list[int]:
    """Return the indices in SIDES of the sides that paths (n, 2), degrees, come near."""
    if not paths:
        return []
    lon, lat = np.concatenate(paths).T
    per_lon = METRES_PER_DEGREE * np.cos(np.radians(lat))
    west, south, east, north = bounds
    distances = (
        (lon - west) * per_lon,
        (lat - south) * METRES_PER_DEGREE,
        (east - lon) * per_lon,
        (north - lat) * METRES_PER_DEGREE,
    )
    return [side for side, metres in enumerate(distances) if metres.min() < _NEAR * margin_m]


def grown(bounds: Bounds, sides: Sequence[int], metres: float, limits: Bounds) -> Bounds:
    """Move the given sides outward, at most to the limits, unless they would hardly move."""
    up = metres / METRES_PER_DEGREE
    widest = max(abs(bounds[1]), abs(bounds[3]))
    aside = up / float(np.cos(np.radians(min(widest, 89.0))))
    aside = min(aside, max(0.0, (MAX_WIDTH - (bounds[2] - bounds[0])) / 2))
    moves = (-aside, -up, aside, up)
    west, south, east, north = (
        round(bound + move, 3) if side in sides else bound
        for side, (bound, move) in enumerate(zip(bounds, moves, strict=True))
    )
    wider = common_bounds((west, south, east, north), limits) or bounds
    gained = max(abs(new - old) for new, old in zip(wider, bounds, strict=True))
    return wider if gained > _LEAST_GAIN * up else bounds


def best_paths(result: RunResult) -> list[FloatArray]:
    """Return the path of every case's best route, (n, 2) in lon/lat degrees."""
    return [
        result.water.projection.to_lonlat(case.routes[0].route.path)
        for case in result.cases
        if case.routes
    ]
