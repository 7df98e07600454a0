"""Routes for a bridge, a plotter, a phone: RTZ, GPX and GeoJSON over the same waypoints."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pipeline.formats.shared.result import RunResult


def can_write(result: RunResult) -> bool:
    """Whether a run's routes are for a plotter.

    Those of a plane scenario are not: its metres lie nowhere on earth, and a file that a plotter
    takes in would place them in the Gulf of Guinea, at 0 N 0 E.
    """
    return not result.scenario.is_planar
