"""Find start–goal pairs on land before anything is written; each fault names its row."""

from collections.abc import Sequence

import shapely

from pipeline.nightly.request.cases import Block, Cases
from pipeline.nightly.request.config import NightConfig
from pipeline.scenario.model import Scenario
from pipeline.sources.land.shapes import box_around
from pipeline.sources.registry import land_source
from pipeline.stages.projecting.endpoint_look import endpoints_on_land

# Land is read within this distance of any start or goal, m.
_NEAR_M = 2_000.0


def pairs_on_land(config: NightConfig, cases: Cases) -> list[str]:
    """Return a message for each start and goal on land."""
    faults = []
    for block in cases.blocks:
        if block.scenario.is_planar:
            continue
        file = config.table.cases[block.number].pairs
        voyages = _voyages(block)
        for suspect in _suspects([scenario for scenario, _ in voyages]):
            scenario, row = voyages[suspect]
            where = f"cases[{block.number}].pairs: {file}, row {row}: " if row else ""
            faults += [config.located(f"{where}{fault}") for fault in endpoints_on_land(scenario)]
    return faults


def _voyages(block: Block) -> list[tuple[Scenario, int]]:
    """Return the scenario of each pair, with the pair's row; 0 for the scenario's own ends."""
    return [
        (block.scenario, 0)
        if pair is None
        else (block.scenario.model_copy(update={"start": pair.start, "goal": pair.goal}), pair.row)
        for pair in block.pairs
    ]


def _suspects(scenarios: Sequence[Scenario]) -> list[int]:
    """Return the indices of the voyages on one chart that have an end on land.

    All are tested together, which is quick; finding the nearest water for messages takes longer.
    """
    ends = shapely.points([end for one in scenarios for end in (one.start, one.goal)])
    around = box_around(shapely.box(*shapely.total_bounds(ends)), _NEAR_M)
    source = land_source(scenarios[0].chart, scenarios[0].vessel.draught_m)
    land = shapely.STRtree(source.land(around).polygons)
    found = land.query(ends, predicate="intersects")[0]
    return sorted(set((found // 2).tolist()))
