"""Read the areas to avoid from files, as zones of the chart and as shut areas of each season."""

import math
from collections.abc import Iterable, Mapping
from datetime import datetime
from pathlib import Path

import numpy as np
import shapely

import renew
from pipeline.errors import RequestError
from pipeline.formats.shared.text import moment_text
from pipeline.geo.projection import Projection
from pipeline.model import Note, Scene, SeasonPlan, Zone
from pipeline.scenario.model import Scenario
from pipeline.scenario.region import AvoidedArea, ChartSource
from pipeline.sources.land.shapes import extract_polygons, repaired
from pipeline.sources.land.vector import VectorFile


def area_identities(scenario: Scenario) -> tuple[object, ...]:
    """Return the avoided areas of a scenario, each with the identity of its file."""
    return tuple((area.model_dump(mode="json"), _file(area).identity) for area in scenario.avoid)


def avoided_zones(scenario: Scenario, region: shapely.Polygon) -> tuple[Zone, ...]:
    """Return the avoided areas near a region (lon/lat degrees), in the scenario's order.

    Raises
    ------
    RequestError
        A file can't be read, or has no area near the region; all faults are listed.
    """
    zones, faults = list[Zone](), list[str]()
    for at, area in enumerate(scenario.avoid):
        try:
            polygons = _file(area).land(region).polygons
        except RequestError as error:
            faults += [fault.replace("chart.source", f"avoid[{at}]") for fault in error.faults]
            continue
        shape = shapely.union_all(np.array(polygons, dtype=object))
        zones.append(Zone("shut", Path(area.path).stem, hours_text(area), shape))
    if faults:
        raise RequestError(faults)
    return tuple(zones)


def hours_text(area: AvoidedArea) -> str:
    """Return an area's hours as text: "always shut", or "shut from ... until ..."."""
    begin = "" if area.begin is None else f" from {moment_text(area.begin)}"
    until = "" if area.until is None else f" until {moment_text(area.until)}"
    return f"shut{begin}{until}" if area.has_hours else "always shut"


def shut_areas(
    scenario: Scenario, zones: Iterable[Zone], projection: Projection
) -> dict[str, tuple[renew.ShutArea, ...]]:
    """Return each season's shut areas in the plane, with hours in s since its first departure."""
    shut = [zone for zone in zones if zone.kind == "shut"]
    planar = projection.geometry_to_plane(np.array([zone.area for zone in shut], dtype=object))
    # Polygons that are valid in degrees may be invalid in the plane.
    polygons = [shapely.union_all(extract_polygons(repaired(one)[0])) for one in planar[:, None]]
    return {
        season.name: tuple(
            renew.ShutArea(
                polygon,
                _seconds(area.begin, season.first_departure, -math.inf),
                _seconds(area.until, season.first_departure, math.inf),
                zone.name,
            )
            for area, zone, polygon in zip(scenario.avoid, shut, polygons, strict=True)
        )
        for season in scenario.seasons
    }


def later(areas: Iterable[renew.ShutArea], shift: float) -> tuple[renew.ShutArea, ...]:
    """Return areas with hours that are counted from a departure `shift` seconds later."""
    return tuple(
        renew.ShutArea(area.polygon, area.begin - shift, area.end - shift, area.name)
        for area in areas
    )


def shut_notes(scene: Scene, plans: Iterable[SeasonPlan]) -> tuple[Note, ...]:
    """Return notes on the areas that routes avoid because they are shut during the voyage."""
    return tuple(
        Note.of(
            "area-shut",
            area=area.name,
            begin=scene.moment(plan.season, area.begin),
            until=scene.moment(plan.season, area.end),
        ).about(plan.season)
        for plan in plans
        if plan.plan is not None
        for area in plan.plan.shut
    )


def known_clocks(scenario: Scenario) -> Mapping[str, datetime]:
    """Return the first departure of each season whose plan depends on the date."""
    return {
        season.name: season.first_departure
        for season in scenario.seasons
        if season.first_departure is not None
        and (
            season.is_changing
            or season.speed is not None
            or any(area.has_hours for area in scenario.avoid)
        )
    }


def _file(area: AvoidedArea) -> VectorFile:
    """Return the reader of an area's file."""
    return VectorFile(Path(area.path), ChartSource(path=area.path))


def _seconds(moment: datetime | None, begin: datetime | None, otherwise: float) -> float:
    """Return the seconds from `begin` to `moment`, or `otherwise` if one of them is None."""
    return otherwise if moment is None or begin is None else (moment - begin).total_seconds()
