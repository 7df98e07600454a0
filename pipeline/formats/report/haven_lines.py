"""What the page's map shows of havens: the places, the ways to them, and what is covered."""

from collections.abc import Callable
from typing import Any

import numpy as np

from pipeline._types import FloatArray
from pipeline.findings.haven_rows import LAST_TURNS, haven_rows, stretch_line
from pipeline.findings.result import RunCase


def haven_lines(case: RunCase, line: Callable[[FloatArray], list[int]]) -> dict[str, Any] | None:
    """Return what the map shows of a case's havens, encoded by `line`; None without havens."""
    coverage = case.coverage
    if coverage is None:
        return None
    return {
        "places": [
            {"name": haven.name, "place": line(haven.place[None, :])} for haven in coverage.havens
        ],
        "ways": [line(np.asarray(one.route.path)) for one in coverage.diversions],
        "stretches": [
            {
                "state": row.kind,
                "places": line(np.asarray(stretch_line(case, row).coords)),
            }
            for row in haven_rows(case)
            if row.kind not in LAST_TURNS
        ],
    }
