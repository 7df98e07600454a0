"""Places of a scenario in the plane: stops, areas to avoid, obstacles; water at hours of the tide.

Places of plane scenarios become instances of the same classes as in a chart scenario, so that every
output format works.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import shapely

import renew
from pipeline import model
from pipeline._types import Geometries
from pipeline.errors import NoWayError, RequestError, refuse_any
from pipeline.findings.text import moment_text
from pipeline.geo.projection import Projection
from pipeline.scenario.catalogue import has_world_land
from pipeline.scenario.model import Scenario, TideSpec
from pipeline.scenario.region import AvoidedArea, ChartSource, ChartSpec, Plane
from pipeline.scenario.season import Season
from pipeline.sources.land.shapes import extract_polygons, in_plane, repaired
from pipeline.sources.land.vector import VectorFile
from pipeline.sources.tide_stations import (
    Station,
    level_notes,
    refuse_far_water,
    stations_of,
    tide_zones,
)
from renew.errors import Strait
from renew.inputs.chart_and_vessel import edges_of

# Distances beyond the nearest shore, true metres: the first whose position is still in water after
# rounding is suggested.
_BEYOND_SHORE_M = (50.0, 200.0, 1000.0, 5000.0)
# Decimals of a degree to which a suggested position is rounded: 11 m.
_DECIMALS = 4
# Number of vertices above which an area to avoid is thinned: planning round a million takes many
# minutes.
_MANY_VERTICES = 10_000
# A thinned area grows by at most this share of its longer side.
_CUT = 1e-4
# Segments per quarter circle of a buffer: its round corners are slightly too narrow.
_QUADRANT_SEGMENTS = 2


def check_endpoints(scenario: Scenario, chart_water: model.Water) -> None:
    """Raise RequestError if a stop is not in water, or no water connects it with the start.

    NoWayError is raised if a wider region might connect them.
    """
    chart = chart_water.chart
    water = shapely.get_parts(chart.water)
    bodies, dry = dict[str, set[int]](), dict[str, shapely.Point]()
    stops = shapely.points(chart_water.to_plane([*scenario.stops.values()]))
    places = dict(zip(scenario.stops, stops, strict=True))
    for (name, given), here in zip(scenario.stops.items(), places.values(), strict=True):
        inside = set(np.flatnonzero(shapely.covers(water, here)).tolist())
        if not inside and given == scenario.start and scenario.under_way is not None:
            # In the margin around land the plan begins in the nearest water.
            near = shapely.covers(chart.open_water, here)
            inside = {int(shapely.distance(water, here).argmin())} if near else inside
        if inside:
            bodies[name] = inside
        else:
            dry[name] = here
    if dry:
        wet = [places[name] for name in bodies]
        raise RequestError(
            [not_in_water(scenario, name, dry[name], chart_water, wet) for name in dry]
        )
    (start, first), *others = bodies.items()
    for other, body in others:
        if not body & first:
            apart = water[[min(first), min(body)]]
            # A wider region does not connect water that land encloses.
            open_ended = not chart_water.is_planar and all(
                _reaches_edge(one, chart) for one in apart
            )
            small = int(shapely.area(apart).argmin())  # as a rule a pocket: it is left
            moved, kept = ((start, other), (other, start))[small]
            roomy = _with_room(apart[1 - small], _room(scenario), chart, [places[kept]])
            distance, place = _nearest_water(places[moved], roomy, chart_water)
            text = (
                f"{other} = {list(scenario.stops[other])} lies in another body of water than "
                f"{start} = {list(scenario.stops[start])}: no water connects them in this chart. "
                f"The nearest water that joins the {kept} is {distance} from the {moved}, at "
                f"{place}; move the {moved} there"
                + ", or in a scenario widen its region"
                * open_ended
            )
            raise (NoWayError if open_ended else RequestError)([text])


def not_in_water(
    scenario: Scenario,
    name: str,
    here: shapely.Point,
    chart_water: model.Water,
    wet: Sequence[shapely.Point] = (),
    margin_m: float = 0.0,
) -> str:
    """Return a message with the distance from a stop to the nearest water, and its position.

    The water joins the stops that are `wet`, with room for the vessel beyond a margin, if any does.
    """
    chart, width = chart_water.chart, _room(scenario) + margin_m / chart_water.projection.scale
    roomy = _with_room(chart.water, width, chart, wet)
    distance, place = _nearest_water(here, roomy, chart_water)
    no_go, lakes = scenario.chart.no_go, lakes_text(scenario.chart)
    around = ", or within the margin around it"
    if chart_water.is_planar:
        around = lakes = ""
    return (
        f"{name} = {list(scenario.stops[name])} lies on {no_go}{around}, {distance} from the "
        f"nearest water with a way out at {place}; move it there, or further out if the vessel "
        f"needs more room to turn{lakes}"
    )


def lakes_text(chart: ChartSpec) -> str:
    """Return a remark that the world's chart has no lakes; "" for a chart of the user's."""
    return " (this chart has only the sea, without lakes and rivers)" * has_world_land(chart)


def _room(scenario: Scenario) -> float:
    """Return the room that a way out needs, planar metres: none where less may be kept.

    Elsewhere it is the diameter of the fastest vessel's turning circle.
    """
    if scenario.planner.shortfall == "least":
        return 0.0
    return 2 * model.planner_vessel(scenario.fastest_vessel).turning_radius


def is_shut_in(case: model.Case, straits: Sequence[Strait], width: float) -> bool:
    """Whether a stop can't reach the chart's edge, so that no wider region can help.

    The way to the edge keeps `width` planar metres off land, and passes none of the straits.
    """
    chart = case.chart
    # Buffered, so that the cuts reach the banks and separate the water.
    gaps = shapely.linestrings(np.array([strait.gap for strait in straits]).reshape(-1, 2, 2))
    shut = [
        *shapely.buffer(gaps, chart.precision),
        *shapely.buffer(np.array(chart.no_go, dtype=object), width, quad_segs=_QUADRANT_SEGMENTS),
    ]
    parts = shapely.get_parts(shapely.difference(chart.water, shapely.union_all(shut)))
    open_water = shapely.union_all([part for part in parts if _reaches_edge(part, chart)])
    stops = shapely.points(case.stops)
    return not all(_legs_out(one, chart, width).intersects(open_water) for one in stops)


def _legs_out(stop: shapely.Point, chart: renew.Chart, width: float) -> shapely.Geometry:
    """Return straight legs from a stop up to padding that does not hold it, at most 2 widths."""
    edges = shapely.linestrings(edges_of(chart.no_go))
    apart = shapely.distance(edges, stop)
    others = edges[(apart > width) & (apart < 3 * width)]
    padding = shapely.buffer(others, width, quad_segs=_QUADRANT_SEGMENTS)
    ends = shapely.get_coordinates(stop.buffer(2 * width))
    rays = shapely.linestrings(np.stack([np.broadcast_to(stop.coords, ends.shape), ends], axis=1))
    legs = shapely.difference(rays, shapely.union_all([*padding, *chart.no_go]))
    parts = shapely.get_parts(legs)
    return shapely.union_all(parts[shapely.dwithin(parts, stop, chart.precision)])


def _reaches_edge(body: shapely.Geometry, chart: renew.Chart) -> bool:
    """Whether a body of water reaches the chart's edge, so that it may continue beyond."""
    return bool(shapely.dwithin(body, chart.extent.exterior, 2 * chart.precision))


def _with_room(
    water: shapely.Geometry, width: float, chart: renew.Chart, stops: Sequence[shapely.Point]
) -> shapely.Geometry:
    """Return the parts of water that join stops and the chart's edge, `width` off land all the way.

    Where there are none, the parts that do one of the two, or else all the water.
    """
    edge = chart.extent.exterior
    parts = shapely.get_parts(shapely.buffer(water, -width, quad_segs=_QUADRANT_SEGMENTS))
    for ends in ([*stops, edge], [edge], stops):
        joins = shapely.dwithin(parts[:, None], np.array(ends, dtype=object), 2 * width)
        if len(ends) and (chosen := joins.all(axis=1)).any():
            return shapely.multipolygons(parts[chosen])
    return water


def _nearest_water(
    here: shapely.Point, water: shapely.Geometry, chart_water: model.Water
) -> tuple[str, str]:
    """Return the distance to the nearest water and its position, as a scenario would write it."""
    projection = chart_water.projection
    line = shapely.get_coordinates(shapely.shortest_line(here, water))
    shore, here_xy = line[-1], line[0]
    if chart_water.is_planar:
        return f"{np.linalg.norm(shore - here_xy):.4g} m", f"[{shore[0]:.6g}, {shore[1]:.6g}]"
    ahead = (shore - here_xy) / max(float(np.linalg.norm(shore - here_xy)), 1e-12)
    # Beyond the shore, so that rounding does not move it back onto land.
    tries = [shore + ahead * beyond / projection.scale for beyond in _BEYOND_SHORE_M]
    rounded = [np.round(projection.to_lonlat(xy), _DECIMALS) for xy in [*tries, shore]]
    in_water = [at for at in rounded if water.covers(shapely.Point(projection.to_plane(at)))]
    lon, lat = (in_water or rounded[-1:])[0]
    metres = projection.geodesic_length_m([here_xy, projection.to_plane((lon, lat))])
    distance = f"{metres / 1000:.1f} km" if metres >= 1000 else f"{metres:.0f} m"
    return distance, f"[{lon:.{_DECIMALS}f}, {lat:.{_DECIMALS}f}]"


def avoided_zones(
    avoid: Iterable[AvoidedArea], region: shapely.Polygon, *, may_be_far: bool = False
) -> tuple[tuple[model.Zone, ...], tuple[model.Note, ...]]:
    """Return the avoided areas near a region (lon/lat degrees), in their order, and notes on them.

    Raises RequestError if a file can't be read or, unless it may be far, has no area near the
    region; all faults are listed.
    """
    zones, notes, faults = list[model.Zone](), list[model.Note](), list[str]()
    for at, area in enumerate(avoid):
        try:
            land = replace(area_file(area), is_addition=may_be_far).land(region)
        except RequestError as error:
            faults += [f"avoid[{at}]: {fault}" for fault in error.faults]
            continue
        shape = _thinned(shapely.union_all(np.array(land.polygons, dtype=object)))
        # How accurate a coast is does not matter here.
        notes += (note for note in land.notes if note.kind != "accuracy-assumed")
        zones.append(model.Zone("shut", Path(area.path).stem, hours_text(area), shape))
    refuse_any(faults)
    return tuple(zones), tuple(notes)


def _thinned(area: shapely.Geometry) -> shapely.Geometry:
    """Return an area as it is, or one of fewer vertices around it if it has very many."""
    if shapely.get_num_coordinates(area) <= _MANY_VERTICES:
        return area
    west, south, east, north = area.bounds
    cut = _CUT * max(east - west, north - south)
    return shapely.buffer(shapely.simplify(area, cut), cut, join_style="mitre")


def hours_text(area: AvoidedArea) -> str:
    """Return an area's hours as text: "always shut", or "shut from ... until ..."."""
    begin = "" if area.begin is None else f" from {moment_text(area.begin)}"
    until = "" if area.until is None else f" until {moment_text(area.until)}"
    return f"shut{begin}{until}" if area.has_hours else "always shut"


def shut_polygons(
    avoid: Iterable[AvoidedArea], zones: Iterable[model.Zone], projection: Projection
) -> tuple[tuple[AvoidedArea, model.Zone, shapely.Geometry], ...]:
    """Return each area that is shut for some time, its zone, and its polygons in the plane."""
    shut = [zone for zone in zones if zone.kind == "shut"]
    return tuple(
        (area, zone, shapely.union_all(in_plane([zone.area], projection)))
        for area, zone in zip(avoid, shut, strict=True)
    )


def shut_areas(
    shut: Iterable[tuple[AvoidedArea, model.Zone, shapely.Geometry]], begin: datetime | None
) -> tuple[renew.ShutArea, ...]:
    """Return the shut areas on a clock that begins at a first departure."""
    return tuple(
        renew.ShutArea(
            polygon,
            _seconds(area.begin, begin, -math.inf),
            _seconds(area.until, begin, math.inf),
            zone.name,
        )
        for area, zone, polygon in shut
    )


def shut_notes(planned: Iterable[tuple[model.Case, model.CaseResult]]) -> tuple[model.Note, ...]:
    """Return notes on the areas that routes avoid because they are shut during the voyage."""
    return tuple(
        model.Note.of(
            "area-shut", area=area.name, begin=case.moment(area.begin), until=case.moment(area.end)
        ).about(case.name)
        for case, result in planned
        if result.plan is not None
        for area in result.plan.shut
        if isinstance(area, renew.ShutArea) and not isinstance(area, renew.OverLimit)
    )


def area_file(area: AvoidedArea) -> VectorFile:
    """Return the reader of an area's file."""
    keys = area.model_dump(exclude={"from", "begin", "until"})
    return VectorFile(Path(area.path), ChartSource(**keys))


def _seconds(moment: datetime | None, begin: datetime | None, otherwise: float) -> float:
    """Return the seconds from `begin` to `moment`, or `otherwise` if one of them is None."""
    return otherwise if moment is None or begin is None else (moment - begin).total_seconds()


def fetched_plane(plane: Plane, scale: float) -> model.Fetched:
    """Return the obstacles as land, and no currents: `plane_current` reads them later."""
    projection = Projection.at(0.0, 0.0, scale)  # 0 N 0 E is the plane's origin
    credit = model.Credit(
        name="Obstacles of the scenario", kind="land", text=plane.credit, licence=""
    )
    polygons = tuple(
        projection.geometry_to_lonlat(polygon) for polygon in map(shapely.Polygon, plane.obstacles)
    )
    return model.Fetched(model.Land(polygons, (credit,), accuracy_m=0.0), ())


def unsimplified(land: model.Land) -> model.SimplifiedLand:
    """Return the obstacles unchanged: in a plane scenario nothing is simplified."""
    vertices = sum(int(shapely.get_num_coordinates(polygon)) for polygon in land.polygons)
    return model.SimplifiedLand(
        polygons=land.polygons,
        inner_polygons=land.polygons,
        original_vertices=vertices,
        vertices=vertices,
        tolerance_m=0.0,
        margin_m=0.0,
    )


def plane_water(scenario: Scenario, plane: Plane) -> model.Water:
    """Build the chart from the given metres; a detour over lon/lat would round them."""
    obstacles = tuple(map(shapely.Polygon, plane.obstacles))
    projection = Projection.at(0.0, 0.0, scenario.scale)
    water = model.Water(renew.Chart(plane.shape, obstacles), obstacles, projection, is_planar=True)
    check_endpoints(scenario, water)
    return water


def plane_current(season: Season, extent: shapely.Polygon) -> model.Current:
    """Return the gyre or uniform current of a case."""
    if season.gyre is not None:
        _, _, width, height = extent.bounds
        return renew.GyreCurrent(
            season.gyre.amplitude, width, height, season.gyre.columns, season.gyre.rows
        )
    if season.uniform is not None:
        return renew.UniformCurrent(season.uniform.u, season.uniform.v)
    raise RequestError(f"season {season.name!r} gives no current; add 'gyre' or 'uniform'")


# Need (m) that no tide on earth meets.
_NEVER_M = 100.0
# Segments per quarter circle of a buffer; factor on its radius, because its flat sides cut the
# circle.
_BUFFER_SEGMENTS = 4
_FLAT = math.cos(math.pi / 4 / _BUFFER_SEGMENTS)


def tidal_depth(
    spec: TideSpec | None,
    chart: ChartSpec,
    land: model.Land,
    simplified: model.SimplifiedLand,
    water: model.Water,
) -> Callable[[datetime | None], renew.TidalDepth | None]:
    """Return the tidal water of a chart in the plane, on any clock that begins at a departure.

    Areas are grown by the chart's margin, as land is. Where land parts them from every station, so
    that none is near by water, they are never deep enough. Raises RequestError if chart and
    stations have different datums, some water has no station near it, or a departure lies outside
    the hours of official levels.
    """
    if spec is None:
        return lambda _: None
    stations = stations_of(spec)
    check_datum(chart, land, stations)
    extent, projection = water.chart.extent, water.projection
    areas, needs, names, of = list[shapely.Polygon](), list[float](), list[str](), list[int]()
    shore = projection.geometry_to_plane(np.array(simplified.inner_polygons, dtype=object))
    zones, unknown = tide_zones(stations, extent, projection, extract_polygons(repaired(shore)[0]))
    outside = shapely.difference(extent, shapely.union_all([*zones, unknown]))
    if any(station.series for station in stations):
        # Official levels end at the coast of their model: what lies beyond is not known.
        unknown, outside = shapely.union(unknown, outside), shapely.Polygon()
    given = np.array([one.area for one in land.tidal_water], dtype=object)
    grown = _grown(projection.geometry_to_plane(given), simplified, projection.scale)
    far = extract_polygons(shapely.intersection(grown, outside))
    if len(far):
        refuse_far_water(shapely.point_on_surface(far[0]), stations, projection)
    for at, zone in enumerate([*zones, unknown]):
        is_known = at < len(zones)
        shapely.prepare(zone)
        for meets in np.flatnonzero(shapely.intersects(zone, grown)):
            parts = extract_polygons(shapely.intersection(grown[meets], zone)).tolist()
            tidal = land.tidal_water[meets]
            areas += parts
            needs += [tidal.need_m if is_known else _NEVER_M] * len(parts)
            names += [tidal.name] * len(parts)
            of += [at if is_known else 0] * len(parts)

    def on_clock(departure: datetime | None) -> renew.TidalDepth | None:
        if departure is None:
            return None
        for name, hours in {station.name: station.hours for station in stations}.items():
            if hours is not None and not hours[0] <= departure < hours[1]:
                raise RequestError(
                    f"tide.stations: {name} has levels from {moment_text(hours[0])} until "
                    f"{moment_text(hours[1])}, and the departure is {moment_text(departure)}; "
                    "depart in these hours, or give other levels"
                )
        tides = [station.tide(departure) for station in stations]
        relied_on = {"surge": spec.surge_m, "lag": spec.lag_s}
        return renew.TidalDepth(areas, needs, [tides[at] for at in of], names=names, **relied_on)

    return on_clock


def tide_notes(
    tide: TideSpec | None, planned: Sequence[tuple[model.Case, model.CaseResult]]
) -> Iterator[model.Note]:
    """Yield notes on the tide relied on, on the least water, and on water that is too shallow."""
    if tide is None:
        return
    stations = stations_of(tide)
    yield model.Note.of(
        "tide-relied-on",
        stations=tuple(dict.fromkeys(station.name for station in stations)),
        datum=stations[0].datum,
        lag_min=tide.lag_s / 60,
        surge_m=tide.surge_m,
    )
    yield from level_notes(stations, tide.surge_m)
    for case, depth in [(case, case.tidal_depth) for case, _ in planned if case.tidal_depth][:1]:
        for at in np.flatnonzero(np.asarray(depth.needs) == _NEVER_M)[:1]:
            place = shapely.get_coordinates(shapely.point_on_surface(depth.areas[at]))[0]
            yield model.Note.of("tide-unknown", place=case.water.place(place))
    for case, result in planned:
        if result.plan is not None:
            yield from _least_water(case, result.plan)
            for area in result.plan.shut:
                if isinstance(area, renew.TidalArea):
                    begin, until = _next_hours(case, area, float(result.plan.best.times[0]))
                    yield model.Note.of(
                        "tide-too-low", area=area.name, need_m=area.need, begin=begin, until=until
                    ).about(case.name)


def _least_water(case: model.Case, plan: renew.Plan) -> Iterator[model.Note]:
    """Yield a note on the least water of a case's best route, with the hours around it."""
    least, kept_m = plan.best.least_water, case.under_keel_clearance_m
    if least is None:
        return
    begin, until = _next_hours(case, least.area, least.time)
    yield model.Note.of(
        "least-water",
        least_m=least.spare + kept_m,
        early_m=least.early + kept_m,
        late_m=least.late + kept_m,
        at=case.moment(least.time),
        place=case.water.place(least.place),
        begin=begin,
        until=until,
    ).about(case.name)


def _next_hours(
    case: model.Case, area: renew.TidalArea, time_s: float
) -> tuple[datetime | float | None, datetime | float | None]:
    """Return begin and end of an area's hours of enough water around a time (s), or next to it."""
    hours = area.next_hours(time_s)
    if hours is None:
        return None, None
    begin, until = hours
    return case.moment(begin), case.moment(until)


def check_datum(chart: ChartSpec, land: model.Land, stations: Sequence[Station]) -> None:
    """Refuse a chart without depths, and depths and tides that are not counted from one datum."""
    stated, faults = chart.datum, list[str]()
    datum = land.datum or ("" if chart.depths else stated)
    if land.depths is None:
        raise RequestError(
            "[tide] needs a chart with depths; give S-57 cells (chart.source, --charts) or a grid "
            "(chart.depths, --depths), or leave the tide out"
        )
    if stated and land.datum not in {"", stated}:
        faults.append(
            f"chart.datum = {stated!r}, but the chart's depths are from {land.datum}; leave it out"
        )
    for station in stations:
        if not datum:
            faults.append(
                "the chart does not state the datum of its depths, and the tide of "
                f"{station.name} is over {station.datum}; if the depths are from there, too, set "
                f"chart.datum = {station.datum!r} (--datum)"
            )
        elif datum != station.datum:
            faults.append(
                f"the depths are from {datum}, and the tide of {station.name} is over "
                f"{station.datum}{_apart(station, datum)}; give a station's TOML file with datum = "
                f"{datum!r}"
            )
    refuse_any(faults)


def _apart(station: Station, datum: str) -> str:
    """Say how far another datum lies from a station's, if its file says so."""
    level = station.datums.get(datum)
    if level is None:
        return ""
    return f" ({datum} is {abs(level):.2f} m {'above' if level > 0 else 'below'} it)"


def _grown(planar: Geometries, simplified: model.SimplifiedLand, scale: float) -> Geometries:
    """Return areas that cover the given ones, planar m, with the chart's margin around them."""
    margin, tolerance = simplified.margin_m / scale, simplified.tolerance_m / scale
    valid, _ = repaired(planar)
    wide = shapely.buffer(valid, (margin + tolerance) / _FLAT, quad_segs=_BUFFER_SEGMENTS)
    return np.asarray(shapely.simplify(wide, tolerance))
