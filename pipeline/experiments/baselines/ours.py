"""RENEW itself, both methods, in the form of a baseline's result."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

import renew
from pipeline.experiments.baselines.candidate import Candidate

if TYPE_CHECKING:
    from collections.abc import Mapping

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
