"""Land as maps draw it: that of the chart, continued beyond the region by the land around it."""

import contextlib
from collections.abc import Iterator, Sequence

import numpy as np
import shapely

from pipeline._types import Geometries
from pipeline.errors import RequestError
from pipeline.model import Scene


def continued(land: Geometries, surroundings: Geometries) -> Geometries:
    """Join land with the land around it, so that no edge shows where one ends in the other."""
    if not len(surroundings):
        return land
    touched = np.unique(shapely.STRtree(land).query(surroundings, predicate="intersects")[1])
    joined = shapely.disjoint_subset_union_all(np.concatenate([land[touched], surroundings]))
    return np.concatenate([np.delete(land, touched), shapely.get_parts(joined)])


def planar_land(scene: Scene, surroundings: Sequence[shapely.Polygon]) -> Geometries:
    """Land of a scene, continued by the land around it (lon/lat degrees), in the scene's plane."""
    around = np.array([*_projected(scene, surroundings)], dtype=object)
    return continued(np.array(scene.land, dtype=object), shapely.make_valid(around))


def _projected(scene: Scene, polygons: Sequence[shapely.Polygon]) -> Iterator[shapely.Polygon]:
    """Yield polygons in the plane, but for those that reach too far for it, as across a pole."""
    for polygon in polygons:
        with contextlib.suppress(RequestError):
            yield scene.projection.geometry_to_plane(polygon)
