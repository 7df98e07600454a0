"""Start–goal pairs that lie on land are refused before anything is written, each with its row."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.sources.land.polygons import box_around
from pipeline.sources.registry import land_source
from pipeline.stages.endpoint_look import endpoints_on_land

if TYPE_CHECKING:
    from pipeline.nightly.request.cases import Block, Cases
    from pipeline.nightly.request.config import NightConfig
    from pipeline.scenario.model import Scenario

# Distance around a place within which its land is looked at, m.
_NEAR_M = 2_000.0


def pairs_on_land(config: NightConfig, cases: Cases) -> list[str]:
    """Return a fault for each start and goal on land."""
    faults = []
    for block in cases.blocks:
        file = config.table.cases[block.number].pairs
        for scenario, row in _voyages(block):
            if not _is_suspect(scenario):
                continue
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


def _is_suspect(scenario: Scenario) -> bool:
    """Whether an end may be on land; the closer look, which finds water, takes longer."""
    if scenario.is_planar:
        return False
    source = land_source(scenario.chart, scenario.vessel.draught_m)
    for place in (scenario.start, scenario.goal):
        land = source.land(box_around(shapely.Point(place), _NEAR_M)).polygons
        if shapely.intersects_xy(np.array(land, dtype=object), *place).any():
            return True
    return False
