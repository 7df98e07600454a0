"""Islands by which a navigator tells the ways of a voyage apart: west or east of it.

Among hundreds of islets all of the best classes pass the same large islands on the same side. So
words are spelled by a few islands only: the largest of those that lie on the way, as many as it
takes for k classes by passing each on either side. The largest one counts, however small it is.
"""

import math

import numpy as np
import shapely

from renew._types import FloatArray
from renew.classes.h_signature import Rays

# An island lies on the way where going by it makes the way longer by this share at most, and
# matters where it is at least such a share of the way wide.
_DETOUR, _SIZE = 0.25, 1 / 50


def rays_that_matter(rays: Rays, path: FloatArray, count: int) -> Rays:
    """Rays of the islands by which `count` classes around a path (n, 2), m, are to differ."""
    length = float(shapely.length(shapely.LineString(path)))
    origins = np.column_stack([rays.x, rays.y])
    through_it = sum(np.linalg.norm(origins - end, axis=1) for end in path[[0, -1]])
    on_the_way = through_it - rays.size <= (1 + _DETOUR) * length
    by_it = np.flatnonzero(on_the_way)
    largest_first = by_it[np.argsort(-rays.size[by_it], kind="stable")]
    that_matter = max(1, np.count_nonzero(rays.size[by_it] >= _SIZE * length))
    chosen = np.zeros(len(rays.x), dtype=bool)
    chosen[largest_first[: min(that_matter, math.ceil(math.log2(count)))]] = True
    return rays.only(chosen)
