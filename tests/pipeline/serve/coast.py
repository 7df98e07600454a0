"""The coarse coast that comes with the page; `python -m tests.pipeline.serve.coast` writes it."""

import json

import numpy as np
import shapely

from pipeline._types import Geometries
from pipeline.serve.land import COAST, COAST_STEP_DEG
from pipeline.sources.land import osm

# Detail of the coast, degrees, and the least area of an island, square degrees.
_DETAIL_DEG, _LEAST = 0.1, 0.03


def sharp() -> Geometries:
    """The world's land, but for islands that are smaller than the detail."""
    world = shapely.box(-179.999, -90, 179.999, 90)
    return osm.polygons_near("Osm", world, least_deg=_DETAIL_DEG)[0][0]


def main() -> None:
    simple = shapely.simplify(sharp(), _DETAIL_DEG)
    rings = []
    for ring in shapely.get_rings(simple[shapely.area(simple) > _LEAST]):
        steps = np.rint(shapely.get_coordinates(ring)[:-1] / COAST_STEP_DEG).astype(int)
        moves = np.diff(steps, axis=0, prepend=0)
        if len(moves) > 2:
            rings.append(json.dumps(moves.ravel().tolist(), separators=(",", ":")))
    COAST.write_text("[" + ",\n".join(rings) + "]\n", encoding="utf-8")


if __name__ == "__main__":
    main()
