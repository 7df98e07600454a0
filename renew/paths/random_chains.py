"""The paper's random chains: one random point on the free part of each passing edge."""

from __future__ import annotations

import math

import numpy as np

from renew._types import FloatArray
from renew.errors import InfeasibleError
from renew.paths.corridor import Corridor


def random_chains(corridor: Corridor, samples: int, rng: np.random.Generator) -> FloatArray:
    """Random chains (samples', n, 2) on the free part of each passing edge, those clear of V.

    The paper samples whole passing edges and discards; a point in V can't be kept, so drawing
    from the free part gives the same chains sooner.
    """
    passing_edges, free = corridor.open_sections(math.inf, math.inf)
    chains = np.empty((samples, len(passing_edges.left) + 2, 2))
    chains[:, 0], chains[:, -1] = corridor.voyage.start, corridor.voyage.goal
    chains[:, 1:-1] = passing_edges.points(free.draw(samples, rng)).swapaxes(0, 1)
    clear = np.array([corridor.legs_clear(chain).all() for chain in chains])
    if not clear.any():
        raise InfeasibleError(f"each of {samples} sampled chains crosses the soft no-go zone")
    return np.asarray(chains[clear])
