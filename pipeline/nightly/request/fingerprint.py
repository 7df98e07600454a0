"""A hash of what a night is asked for: where it differs, cycles that stand are planned anew."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from typing import TYPE_CHECKING

from pipeline.nightly.request.cases import Block, Cases
from pipeline.sources.registry import land_source

if TYPE_CHECKING:
    from pipeline.nightly.request.config import NightConfig

# Keys that change no result.
_NO_RESULT = {"output", "keep", "limit_hours", "workers"}


def request_hash(config: NightConfig, cases: Cases) -> str:
    """Return a hash of all that results depend on, but for the currents' data and the code.

    Charts, depths and pairs enter by their content.
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
