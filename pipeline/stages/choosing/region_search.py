"""Plan in a chosen region, and again in a wider one while a best route comes near its edge."""

from collections.abc import Callable
from dataclasses import replace

from pipeline._types import FloatArray
from pipeline.errors import NoWayError, PipelineError
from pipeline.formats.shared.result import RunResult
from pipeline.machine.store import Made, Store
from pipeline.model import Note
from pipeline.scenario.model import Scenario
from pipeline.stages.choosing.region import (
    ChosenRegion,
    chosen_region,
    edge_notes,
    opened_region,
    wider_region,
)

RunInRegion = Callable[[Scenario, tuple[Note, ...]], Made[RunResult]]

# Largest number of times that a chosen region is widened; each time needs a new plan.
_MAX_WIDENINGS = 3


def search_region(
    asked: Scenario,
    store: Store,
    run_in_region: RunInRegion,
    *,
    offline: bool,
) -> Made[RunResult]:
    """Return the result in a region that is widened until no best route comes near its edge.

    Parameters
    ----------
    asked
        A chart scenario without a region.
    run_in_region
        Plans a scenario with its region, given the notes on the region.

    Raises
    ------
    PipelineError
        The run in the first region failed; or the first region has no way from start to goal, and
        the run in the widest region failed. After a region with a way, the search stops at the
        first wider region that fails, and returns the last result.
    """
    region, made = _first_with_a_way(
        chosen_region(asked, store, offline=offline), asked, run_in_region
    )
    for _ in range(_MAX_WIDENINGS):
        wider = wider_region(region, _best_paths(made.value))
        if wider is None:
            break
        try:
            made = run_in_region(wider.complete(asked), wider.notes)
        except PipelineError:
            break
        region = wider
    limits = edge_notes(region, _best_paths(made.value))
    result = made.value
    fetched = replace(result.fetched, notes=(*result.fetched.notes, *limits))
    return replace(made, value=replace(result, fetched=fetched, choices=(*result.choices, *limits)))


def _first_with_a_way(
    region: ChosenRegion,
    asked: Scenario,
    run_in_region: RunInRegion,
) -> tuple[ChosenRegion, Made[RunResult]]:
    """Widen a region until it has a way from start to goal; return it and the result in it."""
    for _ in range(_MAX_WIDENINGS):
        try:
            return region, run_in_region(region.complete(asked), region.notes)
        except NoWayError:
            wider = opened_region(region)
            if wider is None:
                raise
            region = wider
    return region, run_in_region(region.complete(asked), region.notes)


def _best_paths(result: RunResult) -> list[FloatArray]:
    """Return the path of every season's best route, (n, 2) in lon/lat degrees."""
    return [
        result.scene.projection.to_lonlat(ranked.route.path)
        for ranked in result.routes
        if ranked.rank == 1
    ]
