"""Names of land, as charts have them: a point on each named area."""

from collections.abc import Iterator, Sequence

import numpy as np
import shapely

from pipeline._types import Geometries
from pipeline.model import PlaceName
from pipeline.sources.land.polygons import extract_polygons

NAME_COLUMNS = ("name", "objnam")
"""Columns that hold names of land, in small letters: everyone's, and that of S-57."""


def named_places(names: Sequence[object], geometries: Geometries) -> Iterator[PlaceName]:
    """Yield the names of areas (lon/lat degrees); what is no area or has no name is left out.

    Of several areas under one name, such as a country's, only the largest has it.
    """
    for name, geometry in zip(names, geometries, strict=True):
        parts = extract_polygons(np.array([geometry], dtype=object))
        text = " ".join(str(name).split()) if isinstance(name, str) else ""
        if not text or not len(parts):
            continue
        largest = parts[shapely.area(parts).argmax()]
        point = shapely.point_on_surface(largest)
        yield PlaceName(text, float(point.x), float(point.y), float(largest.area))
