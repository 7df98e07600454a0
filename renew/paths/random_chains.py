"""The paper's random chains: one random point on the free part of each passing edge."""

import math

import numpy as np

from renew._types import FloatArray
from renew.paths.corridor import Corridor


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
