"""The tide over a chart: the hours when water is deep enough, on each season's clock."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from datetime import datetime

import numpy as np
import shapely

import renew
from pipeline._types import Geometries
from pipeline.errors import RequestError
from pipeline.geo.projection import Projection
from pipeline.model import Land, Note, Scene, SeasonPlan, Simplified
from pipeline.scenario.model import Scenario
from pipeline.sources.land.shapes import extract_polygons, repaired
from pipeline.sources.tides.station import Station, refuse_far_water, stations_of, tide_zones

# Need (m) that no tide on earth meets.
_NEVER_M = 100.0
# Segments per quarter circle of a buffer; factor on its radius, because its flat sides cut the
# circle.
_QUADRANT_SEGMENTS = 4
_FLAT = math.cos(math.pi / 4 / _QUADRANT_SEGMENTS)


def tidal_depths(
    scenario: Scenario,
    land: Land,
    simplified: Simplified,
    extent: shapely.Polygon,
    projection: Projection,
) -> dict[str, renew.TidalDepth]:
    """Return the tidal water in an extent, planar m, on the clock of each season's departure.

    Areas are grown by the chart's margin, as land is. Where land parts them from every station, so
    that none is near by water, they are never deep enough.

    Raises
    ------
    RequestError
        Chart and stations have different datums, or some water has no station near it.
    """
    if scenario.tide is None:
        return {}
    stations = stations_of(scenario.tide)
    _check_datum(scenario, land, stations)
    areas, needs, names, of = list[shapely.Polygon](), list[float](), list[str](), list[int]()
    shore = projection.geometry_to_plane(np.array(simplified.inner_polygons, dtype=object))
    zones, unknown = tide_zones(stations, extent, projection, extract_polygons(repaired(shore)[0]))
    outside = shapely.difference(extent, shapely.union_all([*zones, unknown]))
    given = np.array([one.area for one in land.tidal_water], dtype=object)
    grown = _grown(projection.geometry_to_plane(given), simplified, projection.scale)
    for water, area in zip(land.tidal_water, grown.tolist(), strict=True):
        far = extract_polygons(shapely.intersection(area, outside))
        if len(far):
            refuse_far_water(shapely.point_on_surface(far[0]), stations, projection)
        for at, zone in enumerate([*zones, unknown]):
            is_known = at < len(zones)
            parts = extract_polygons(shapely.intersection(area, zone)).tolist()
            areas += parts
            needs += [water.need_m if is_known else _NEVER_M] * len(parts)
            names += [water.name] * len(parts)
            of += [at if is_known else 0] * len(parts)

    def on_clock(departure: datetime) -> renew.TidalDepth:
        tides = [station.tide(departure) for station in stations]
        relied_on = {"surge": spec.surge_m, "lag": spec.lag_s}
        return renew.TidalDepth(areas, needs, [tides[at] for at in of], names=names, **relied_on)

    spec = scenario.tide
    departures = {season.name: season.first_departure for season in scenario.seasons}
    return {name: on_clock(begin) for name, begin in departures.items() if begin is not None}


def later_tides(depth: renew.TidalDepth, shift_s: float) -> renew.TidalDepth:
    """Return tidal water on a clock that begins `shift_s` seconds later."""
    given = [depth.tide] if isinstance(depth.tide, renew.Tide) else depth.tide
    shift = np.timedelta64(round(shift_s * 1e6), "us")
    later = {tide: replace(tide, epoch=np.datetime64(tide.epoch) + shift) for tide in given}
    if isinstance(depth.tide, renew.Tide):
        return replace(depth, tide=later[depth.tide])
    return replace(depth, tide=[later[tide] for tide in depth.tide])


def tide_notes(scenario: Scenario, scene: Scene, plans: Iterable[SeasonPlan]) -> Iterator[Note]:
    """Yield notes on the tide relied on, on the least water, and on water that is too shallow."""
    if scenario.tide is None:
        return
    stations = stations_of(scenario.tide)
    yield Note.of(
        "tide-relied-on",
        stations=tuple(station.name for station in stations),
        datum=stations[0].datum,
        lag_min=scenario.tide.lag_s / 60,
        surge_m=scenario.tide.surge_m,
    )
    for depth in [*scene.tidal_depths.values()][:1]:
        for at in np.flatnonzero(np.asarray(depth.needs) == _NEVER_M)[:1]:
            place = shapely.get_coordinates(shapely.point_on_surface(depth.areas[at]))[0]
            yield Note.of("tide-unknown", place=scene.place(place))
    for plan in plans:
        if plan.plan is not None:
            yield from _least_water(scene, plan.season, plan.plan)
            for area in plan.plan.shut:
                if isinstance(area, renew.TidalArea):
                    departure = float(plan.plan.best.times[0])
                    begin, until = _next_hours(scene, plan.season, area, departure)
                    yield Note.of(
                        "tide-too-low", area=area.name, need_m=area.need, begin=begin, until=until
                    ).about(plan.season)


def _least_water(scene: Scene, season: str, plan: renew.Plan) -> Iterator[Note]:
    """Yield a note on the least water of a season's best route, with the hours around it."""
    least, kept_m = plan.best.least_water, scene.under_keel_clearance_m
    if least is None:
        return
    begin, until = _next_hours(scene, season, least.area, least.time)
    yield Note.of(
        "least-water",
        least_m=least.spare + kept_m,
        early_m=least.early + kept_m,
        late_m=least.late + kept_m,
        at=scene.moment(season, least.time),
        place=scene.place(least.place),
        begin=begin,
        until=until,
    ).about(season)


def _next_hours(
    scene: Scene, season: str, area: renew.TidalArea, time_s: float
) -> tuple[datetime | float | None, datetime | float | None]:
    """Return begin and end of an area's hours of enough water around a time (s), or next to it."""
    hours = area.next_hours(time_s)
    if hours is None:
        return None, None
    begin, until = hours
    return scene.moment(season, begin), scene.moment(season, until)


def _check_datum(scenario: Scenario, land: Land, stations: Sequence[Station]) -> None:
    """Refuse a chart without depths, and depths and tides that are not counted from one datum."""
    stated, faults = scenario.chart.datum, list[str]()
    # A grid does not state its datum, whatever the cells beside it state.
    datum = stated or ("" if scenario.chart.depths else land.datum)
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
    if faults:
        raise RequestError(faults)


def _apart(station: Station, datum: str) -> str:
    """Say how far another datum lies from a station's, if its file says so."""
    level = station.datums.get(datum)
    if level is None:
        return ""
    return f" ({datum} is {abs(level):.2f} m {'above' if level > 0 else 'below'} it)"


def _grown(planar: Geometries, simplified: Simplified, scale: float) -> Geometries:
    """Return areas that cover the given ones, planar m, with the chart's margin around them."""
    margin, tolerance = simplified.margin_m / scale, simplified.tolerance_m / scale
    valid, _ = repaired(planar)
    wide = shapely.buffer(valid, (margin + tolerance) / _FLAT, quad_segs=_QUADRANT_SEGMENTS)
    return np.asarray(shapely.simplify(wide, tolerance))
