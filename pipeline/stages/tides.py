"""The tide over a chart: the hours when water is deep enough, on each case's clock."""

import math
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime

import numpy as np
import shapely

import renew
from pipeline._types import Geometries
from pipeline.errors import RequestError
from pipeline.geo.projection import Projection
from pipeline.model import Case, CaseResult, Land, Note, Simplified
from pipeline.scenario.model import Scenario
from pipeline.sources.land.shapes import extract_polygons, repaired
from pipeline.sources.tides.station import Station, refuse_far_water, stations_of, tide_zones

# Need (m) that no tide on earth meets.
_NEVER_M = 100.0
# Segments per quarter circle of a buffer; factor on its radius, because its flat sides cut the
# circle.
_QUADRANT_SEGMENTS = 4
_FLAT = math.cos(math.pi / 4 / _QUADRANT_SEGMENTS)


def tidal_depth(
    scenario: Scenario,
    land: Land,
    simplified: Simplified,
    extent: shapely.Polygon,
    projection: Projection,
) -> Callable[[datetime | None], renew.TidalDepth | None]:
    """Return the tidal water in an extent, planar m, on any clock that begins at a departure.

    Areas are grown by the chart's margin, as land is. Where land parts them from every station, so
    that none is near by water, they are never deep enough.

    Raises
    ------
    RequestError
        Chart and stations have different datums, or some water has no station near it.
    """
    if scenario.tide is None:
        return lambda _: None
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

    spec = scenario.tide

    def on_clock(departure: datetime | None) -> renew.TidalDepth | None:
        if departure is None:
            return None
        tides = [station.tide(departure) for station in stations]
        relied_on = {"surge": spec.surge_m, "lag": spec.lag_s}
        return renew.TidalDepth(areas, needs, [tides[at] for at in of], names=names, **relied_on)

    return on_clock


def tide_notes(scenario: Scenario, planned: Sequence[tuple[Case, CaseResult]]) -> Iterator[Note]:
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
    for case, depth in [(case, case.tidal_depth) for case, _ in planned if case.tidal_depth][:1]:
        for at in np.flatnonzero(np.asarray(depth.needs) == _NEVER_M)[:1]:
            place = shapely.get_coordinates(shapely.point_on_surface(depth.areas[at]))[0]
            yield Note.of("tide-unknown", place=case.water.place(place))
    for case, result in planned:
        if result.plan is not None:
            yield from _least_water(case, result.plan)
            for area in result.plan.shut:
                if isinstance(area, renew.TidalArea):
                    begin, until = _next_hours(case, area, float(result.plan.best.times[0]))
                    yield Note.of(
                        "tide-too-low", area=area.name, need_m=area.need, begin=begin, until=until
                    ).about(case.name)


def _least_water(case: Case, plan: renew.Plan) -> Iterator[Note]:
    """Yield a note on the least water of a case's best route, with the hours around it."""
    least, kept_m = plan.best.least_water, case.under_keel_clearance_m
    if least is None:
        return
    begin, until = _next_hours(case, least.area, least.time)
    yield Note.of(
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
    case: Case, area: renew.TidalArea, time_s: float
) -> tuple[datetime | float | None, datetime | float | None]:
    """Return begin and end of an area's hours of enough water around a time (s), or next to it."""
    hours = area.next_hours(time_s)
    if hours is None:
        return None, None
    begin, until = hours
    return case.moment(begin), case.moment(until)


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
