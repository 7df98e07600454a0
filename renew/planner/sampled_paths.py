"""Find paths of a class by the paper's sampling; the harmonic mean of their fuel ranks classes.

The published figures are of smoothed paths, and hardly any raw chain can be steered. So each chain
is smoothed before it is checked and counted in the harmonic mean.
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from renew._types import BoolArray, FloatArray
from renew.classes.h_signature import Rays
from renew.errors import InfeasibleError
from renew.paths.corridor import Corridor
from renew.paths.shortcuts import each_shortened, with_shortcuts
from renew.results import Route
from renew.steering.corners import steerable
from renew.voyage.voyage import Voyage


def harmonic_mean(fuels: FloatArray) -> float:
    """Return the harmonic mean of the fuel of some paths (n,)."""
    return float(len(fuels) / (1 / fuels).sum())


def chosen_class(routes: Sequence[Route]) -> int:
    """Return the index of the route whose class has the least harmonic mean (h* of the paper).

    The optimal method has one path per class, whose fuel is the harmonic mean. So it chooses the
    least-fuel route.
    """
    return min(range(len(routes)), key=lambda i: routes[i].harmonic_mean)


# Number of sampled chains, least fuel first, that are tried for steering, and number of chains that
# are smoothed further.
_MAX_CHAINS, _MAX_SMOOTHED = 60, 4


def sampled_paths(
    corridor: Corridor, rays: Rays, samples: int, seed: int
) -> tuple[Iterable[FloatArray], float]:
    """Return paths (n, 2) of a class, the best first, and the harmonic mean of their fuel.

    Raises InfeasibleError if no sample can be sailed.
    """
    voyage = corridor.voyage
    rng = np.random.default_rng([seed, *corridor.channel.triangles.tolist()])
    paths, times = each_shortened(corridor, rays, random_chains(corridor, samples, rng))
    if not paths:
        raise InfeasibleError(
            f"each of {samples} sampled chains crosses the soft no-go zone, or water whose current "
            "is as fast as the vessel"
        )
    chosen = np.flatnonzero(_are_steerable(paths, voyage))
    if not len(chosen):
        raise InfeasibleError(
            f"none of {samples} sampled chains can be steered at a turn rate of "
            f"{math.degrees(voyage.vessel.turn_rate):g} degrees a second; method='optimal' may"
        )
    best = [paths[i] for i in chosen[np.argsort(times[chosen])[:_MAX_CHAINS]]]
    smooth = [with_shortcuts(corridor, rays, path) for path in best[:_MAX_SMOOTHED]]
    class_mean = harmonic_mean(voyage.vessel.fuel_rate * times[chosen])
    return (*sorted(smooth, key=voyage.fuel), *best), class_mean


def _are_steerable(paths: Sequence[FloatArray], voyage: Voyage) -> BoolArray:
    """Return which paths (n, 2) can be steered; paths of equal length are checked together."""
    points = np.array([len(path) for path in paths])
    result = np.zeros(len(paths), dtype=bool)
    for count in np.unique(points):
        alike = np.flatnonzero(points == count)
        stacked = np.stack([paths[i] for i in alike.tolist()])
        times = np.stack([voyage.reading_times(paths[i])[1:-1] for i in alike.tolist()])
        result[alike] = steerable(stacked, voyage.current, voyage.vessel, times)
    return result


def random_chains(corridor: Corridor, samples: int, rng: np.random.Generator) -> FloatArray:
    """Return random chains (samples, n, 2) through the free part of each passing edge.

    The paper samples whole passing edges and rejects points in V. Sampling the free part gives the
    same distribution sooner. Legs between the points may cross V.
    """
    passing_edges, free = corridor.open_sections(math.inf, math.inf)
    chains = np.empty((samples, len(passing_edges.left) + 2, 2))
    chains[:, 0], chains[:, -1] = corridor.voyage.start, corridor.voyage.goal
    chains[:, 1:-1] = passing_edges.points(free.draw(samples, rng)).swapaxes(0, 1)
    return chains
