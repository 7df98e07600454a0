"""Routes for an ECDIS, a plotter, a vehicle: RTZ, GPX, KML and missions with the same waypoints."""

from pipeline.formats.shared.result import RunResult


def can_write(result: RunResult) -> bool:
    """Whether a run's routes can be exchanged.

    Those of a planar scenario can't: its metres lie nowhere on earth, and a plotter would show them
    in the Gulf of Guinea, at 0 N 0 E.
    """
    return not result.scenario.is_planar
