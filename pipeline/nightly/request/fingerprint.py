"""A hash of a night's request: if it changes, finished cycles are planned anew."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from typing import TYPE_CHECKING

from pipeline.nightly.request.cases import Block, Cases
from pipeline.sources.registry import land_source

if TYPE_CHECKING:
    from pipeline.nightly.request.config import NightConfig

# Keys that do not affect results.
_NO_RESULT = {"output", "keep", "limit_hours", "workers"}


def request_hash(config: NightConfig, cases: Cases) -> str:
    """Return a hash of everything that results depend on, except the currents' data and the code.

    Charts, depths and pairs are hashed by their content.
    """
    described = [
        config.table.model_dump_json(exclude=_NO_RESULT),
        *(text for block in cases.blocks for text in _described(block)),
    ]
    return hashlib.sha256("\n".join(described).encode()).hexdigest()


def _described(block: Block) -> Iterator[str]:
    """Yield the texts that describe a block of cases."""
    scenario = block.scenario
    yield scenario.model_dump_json()
    yield str([block.vessels, block.members, block.pairs, [one.name for one in block.seasons]])
    if not scenario.is_planar:
        yield "\n".join(land_source(scenario.chart, scenario.vessel.draught_m).identity)
