"""Choose a class as in the paper: by the harmonic mean of the fuel of its sampled paths."""

from collections.abc import Sequence

from renew._types import FloatArray
from renew.results import Route


def harmonic_mean(fuels: FloatArray) -> float:
    """Return the harmonic mean of the fuel of some paths (n,)."""
    return float(len(fuels) / (1 / fuels).sum())


def chosen_class(routes: Sequence[Route]) -> int:
    """Return the index of the route whose class has the least harmonic mean (h* of the paper).

    The optimal method has one path per class, whose fuel is the harmonic mean. So it chooses the
    least-fuel route.
    """
    return min(range(len(routes)), key=lambda i: routes[i].harmonic_mean)
