"""Choose a missing region, and widen it while a route comes near its edge."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely

from pipeline._types import FloatArray
from pipeline.findings.result import RunResult
from pipeline.geo.lonlat import METRES_PER_DEGREE, Bounds, bounds_of, common_bounds
from pipeline.machine.store import DOWNLOADS, Store, artefact_key
from pipeline.model import Note
from pipeline.scenario.model import Scenario
from pipeline.scenario.region import Region
from pipeline.sources.current_field import LandMask
from pipeline.sources.land import osm
from pipeline.sources.registry import charted_land
from pipeline.stages.choosing.coverage import Coverage, covered_by_currents
from pipeline.stages.choosing.region_choice import (
    FAR_WAY,
    MAX_WIDTH,
    DirectLine,
    RegionChoice,
    choose_region,
)

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
    """Bounds of a region in degrees, the coverage that limits them, and notes for the report."""

    bounds: Bounds
    coverage: Coverage
    direct: DirectLine
    notes: tuple[Note, ...] = ()

    def complete(self, scenario: Scenario) -> Scenario:
        """Return the scenario with this region."""
        return scenario.model_copy(update={"region": Region(bbox=self.bounds)})


def chosen_region(scenario: Scenario, store: Store, *, offline: bool) -> ChosenRegion:
    """Choose the region of a scenario from its positions, chart and currents.

    Raises
    ------
    RequestError
        No usable source of currents covers start and goal.
    """
    lines = [DirectLine.between(*ends) for ends in pairwise(scenario.stops.values())]
    folder = store.root / DOWNLOADS
    # The coverage of each leg; all legs have the same sources.
    *_, coverage = (
        covered_by_currents(scenario.seasons, line, folder, offline=offline) for line in lines
    )
    direct = max(lines, key=lambda line: line.distance_m)
    source = charted_land(scenario)
    is_world = all(one.name == "osm-land" for one in scenario.chart.source)
    least_deg = _LEAST_LAND * direct.distance_m / METRES_PER_DEGREE

    def mask_of(bounds: Bounds) -> LandMask:
        box = shapely.box(*bounds)
        if is_world:
            return LandMask.of(osm.polygons_near("Osm", box, least_deg)[0].polygons, bounds)
        return LandMask.of(source.land(box).polygons, bounds)

    stops = tuple(scenario.stops.values())
    key = artefact_key("region", source.identity, *stops, coverage.bounds)

    def choose() -> list[RegionChoice]:
        return [choose_region(line, mask_of, coverage.bounds) for line in lines]

    choices = store.load_or_make("region", key, list, choose)
    bounds = bounds_of([choice.bounds for choice in choices])
    chosen = ChosenRegion(bounds, coverage, direct)
    note = Note.of(
        "region-chosen",
        bounds=bounds,
        ends=_ends_of_currents(chosen, range(len(SIDES))),
        left_out=FAR_WAY if any(choice.leaves_out for choice in choices) else 0.0,
    )
    return replace(chosen, notes=(note,))


def wider_region(chosen: ChosenRegion, paths: Sequence[FloatArray]) -> ChosenRegion | None:
    """Widen a region on the sides that a best route, (n, 2) in degrees, comes near.

    Returns None if no route comes near a side, or the currents end there; see `edge_notes`.
    """
    near = sides_near(chosen.bounds, paths, chosen.direct.margin_m)
    bounds = grown(chosen.bounds, near, chosen.direct.margin_m, chosen.coverage.bounds)
    if bounds == chosen.bounds:
        return None
    sides = tuple(SIDES[side] for side in near)
    note = Note.of("region-widened", bounds=bounds, near=sides)
    return replace(chosen, bounds=bounds, notes=(*chosen.notes, note))


def opened_region(chosen: ChosenRegion) -> ChosenRegion | None:
    """Widen a region without a way from start to goal; None if its currents reach no further."""
    bounds = opened(chosen.bounds, chosen.direct.distance_m, chosen.coverage.bounds)
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
    limits, sources = chosen.coverage.bounds, chosen.coverage.sources
    ending: dict[str, list[str]] = {}
    for side in sides:
        if sources[side] and chosen.bounds[side] == limits[side]:
            ending.setdefault(sources[side], []).append(SIDES[side])
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


def grown(bounds: Bounds, sides: Sequence[int], margin_m: float, limits: Bounds) -> Bounds:
    """Move the given sides outward by twice the margin, at most to the limits.

    Bounds that would hardly change are returned unchanged.
    """
    return _moved(bounds, sides, _GROWTH * margin_m, limits)


def opened(bounds: Bounds, distance_m: float, limits: Bounds) -> Bounds:
    """Move all sides outward by half the distance of the voyage, at most to the limits.

    Bounds that would hardly change are returned unchanged.
    """
    return _moved(bounds, range(len(SIDES)), _OPENING * distance_m, limits)


def _moved(bounds: Bounds, sides: Sequence[int], metres: float, limits: Bounds) -> Bounds:
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
