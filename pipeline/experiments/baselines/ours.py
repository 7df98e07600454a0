"""RENEW itself, both methods, in the form of a baseline's result."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

import renew
from pipeline.experiments.baselines.candidate import Candidate

if TYPE_CHECKING:
    from collections.abc import Mapping

    from renew._types import FloatArray
    from renew.inputs.voyage import Voyage


def planned(voyage: Voyage, options: Mapping[str, object]) -> tuple[renew.Plan, Candidate]:
    """Plan, and return the best route beside the plan.

    Its states are the vertices of the triangles of all channels that were planned in.
    """
    started = time.process_time()
    plan = renew.plan(
        voyage.chart,
        voyage.current,
        voyage.vessel,
        voyage.start,
        voyage.goal,
        **options,  # type: ignore[arg-type]
    )
    seconds = time.process_time() - started
    corners = np.concatenate([route.corners.reshape(-1, 2) for route in plan.routes])
    size = len(np.unique(corners, axis=0))
    return plan, Candidate(plan.best.path, size, is_smoothed=True, seconds=seconds)


def kept_padding(plan: renew.Plan) -> FloatArray:
    """Edges (e, 5) x0, y0, x1, y1, padding (m) that rivals must keep, for a fair comparison.

    Each edge has the padding of the best route; those that it does not pad, the least that any
    other route kept. So no rival needs to keep further off land than our own route did.
    """
    paddings: dict[tuple[float, ...], float] = {}
    for route in (plan.best, *plan.routes):
        mine: dict[tuple[float, ...], float] = {}
        for row in route.padding_used.tolist():
            ends = tuple(sorted([tuple(row[:2]), tuple(row[2:4])]))
            key = (*ends[0], *ends[1])
            mine[key] = max(mine.get(key, 0.0), row[4])
        if route is plan.best and not paddings:
            paddings.update(mine)
            best = set(mine)
            continue
        for key, padding in mine.items():
            if key not in best:
                paddings[key] = min(paddings.get(key, padding), padding)
    rows = [(*key, padding) for key, padding in paddings.items()]
    return np.array(rows).reshape(-1, 5)
