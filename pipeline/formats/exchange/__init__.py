"""Routes for an ECDIS, a plotter, a vehicle: RTZ, GPX, KML and missions with the same waypoints."""

from pipeline.formats.shared.result import RunResult


def can_write(result: RunResult) -> bool:
    """Whether a run's routes can be exchanged: a planar scenario lies nowhere on earth."""
    return not result.scenario.is_planar
