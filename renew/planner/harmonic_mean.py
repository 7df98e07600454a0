"""The paper's choice of a class: by the harmonic mean of the fuel of its sampled paths."""

from collections.abc import Sequence

from renew._types import FloatArray
from renew.results import Route


def harmonic_mean(fuels: FloatArray) -> float:
    """Harmonic mean of the fuel of some paths (n,)."""
    return float(len(fuels) / (1 / fuels).sum())


def chosen_class(routes: Sequence[Route]) -> int:
    """Index of the route whose class has the least harmonic mean (h* of the paper).

    The optimal method knows one path a class, whose fuel is its harmonic mean: the least-fuel route
    is chosen.
    """
    return min(range(len(routes)), key=lambda i: routes[i].harmonic_mean)
