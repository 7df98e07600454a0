"""The region of a scenario without one: chosen before the first plan, widened after a plan."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely

from pipeline._types import FloatArray
from pipeline.machine.storage.store import DOWNLOADS, Store, artefact_key
from pipeline.model.notes import Note
from pipeline.scenario.model import Scenario
from pipeline.scenario.region import Region
from pipeline.sources.quality.coverage import Bounds
from pipeline.sources.quality.field import LandMask
from pipeline.sources.registry import land_source
from pipeline.stages.choosing.coverage import Coverage, covered_by_currents
from pipeline.stages.choosing.region_choice import Voyage, choose_region
from pipeline.stages.choosing.region_growth import SIDES, grown, opened, sides_near

# Distance between start and goal below which the mask of 500 m is too coarse, m: the chart's own
# polygons are used.
_FINE_M = 50_000.0


@dataclass(frozen=True, slots=True)
class ChosenRegion:
    """A region in degrees, what limits it, and what a reader should know about it."""

    bounds: Bounds
    coverage: Coverage
    voyage: Voyage
    notes: tuple[Note, ...] = ()

    def complete(self, scenario: Scenario) -> Scenario:
        """Return the scenario with this region."""
        return scenario.model_copy(update={"region": Region(bbox=self.bounds)})


def chosen_region(scenario: Scenario, store: Store, *, offline: bool) -> ChosenRegion:
    """Choose the region of a scenario from its positions, chart and currents.

    Raises
    ------
    RequestError
        No source of currents that can be used covers start and goal.
    """
    parts = [Voyage.between(*ends) for ends in pairwise(scenario.stops.values())]
    folder = store.root / DOWNLOADS
    # The coverage of each leg; all legs have the same sources.
    *_, coverage = (
        covered_by_currents(scenario.seasons, part, folder, offline=offline) for part in parts
    )
    voyage = max(parts, key=lambda part: part.distance_m)
    source = land_source(scenario.chart, scenario.vessel.draught_m)
    is_world = all(one.name == "osm-land" for one in scenario.chart.source)

    def mask_of(bounds: Bounds) -> LandMask:
        if is_world and voyage.distance_m > _FINE_M:
            return LandMask.world()
        return LandMask.from_land(source.land(shapely.box(*bounds)), bounds)

    stops = tuple(scenario.stops.values())
    key = artefact_key("region", source.identity, *stops, coverage.bounds)

    def choose() -> Bounds:
        boxes = np.array([choose_region(part, mask_of, coverage.bounds) for part in parts])
        west, south = boxes[:, :2].min(axis=0).tolist()
        east, north = boxes[:, 2:].max(axis=0).tolist()
        return west, south, east, north

    bounds = store.load_or_make("region", key, tuple, choose)
    chosen = ChosenRegion(bounds, coverage, voyage)
    ends = _ends_of_currents(chosen, range(len(SIDES)))
    return replace(chosen, notes=(Note.of("region-chosen", bounds=bounds, ends=ends),))


def wider_region(chosen: ChosenRegion, paths: Sequence[FloatArray]) -> ChosenRegion | None:
    """Widen a region where one of the best routes, (n, 2) in degrees, comes near its edge.

    None where no route does, or nothing is gained; then `edge_notes` says what limits it.
    """
    near = sides_near(chosen.bounds, paths, chosen.voyage.margin_m)
    bounds = grown(chosen.bounds, near, chosen.voyage.margin_m, chosen.coverage.bounds)
    if bounds == chosen.bounds:
        return None
    sides = tuple(SIDES[side] for side in near)
    note = Note.of("region-widened", bounds=bounds, near=sides)
    return replace(chosen, bounds=bounds, notes=(*chosen.notes, note))


def opened_region(chosen: ChosenRegion) -> ChosenRegion | None:
    """Widen a region in which no way joins start and goal; None where it ends with its currents."""
    bounds = opened(chosen.bounds, chosen.voyage.distance_m, chosen.coverage.bounds)
    if bounds == chosen.bounds:
        return None
    note = Note.of("region-opened", bounds=bounds)
    return replace(chosen, bounds=bounds, notes=(*chosen.notes, note))


def edge_notes(chosen: ChosenRegion, paths: Sequence[FloatArray]) -> tuple[Note, ...]:
    """Say where a best route is near an edge beyond which there are no currents."""
    near = sides_near(chosen.bounds, paths, chosen.voyage.margin_m)
    ends = _ends_of_currents(chosen, near)
    return (Note.of("route-near-edge", ends=ends),) if ends else ()


def _ends_of_currents(chosen: ChosenRegion, sides: Sequence[int]) -> tuple[Note, ...]:
    """Note for each source on which of some sides the region ends at the edge of its currents."""
    limits, sources = chosen.coverage.bounds, chosen.coverage.sources
    ending: dict[str, list[str]] = {}
    for side in sides:
        if sources[side] and chosen.bounds[side] == limits[side]:
            ending.setdefault(sources[side], []).append(SIDES[side])
    return tuple(
        Note.of("currents-end", sides=tuple(names), source=source)
        for source, names in ending.items()
    )
