"""Columns and geometries of layers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from pipeline.formats.shared.result import RankedRoute, RunResult

ROUTE_STEP_M = 2_000.0
"""Maximum length, true metres, of a segment of a route.

A straight line of the plane departs from the straight line in degrees by s²/8R·tan(latitude): by
0.1 m at 10 degrees, 0.2 m at 70.
"""

ZONE_STEP_M = 10_000.0
"""The same for the edges of zones, which are no more accurate than the chart."""


@dataclass(frozen=True)
class Table:
    """A layer's content: geometries, and columns of the same length in order."""

    geometry: npt.NDArray[np.object_]
    columns: Mapping[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class Layer:
    """A layer of the file: name, title and description for readers, and its content."""

    name: str
    title: str
    description: str
    geometry_type: str
    table: Callable[[RunResult], Table]


def route_key(
    ranked: tuple[RankedRoute, ...], repeats: list[int] | None = None
) -> dict[str, npt.NDArray[Any]]:
    """Columns season and rank, repeated for each of a route's features."""
    counts = [1] * len(ranked) if repeats is None else repeats
    return {
        "season": text([r.season for r, n in zip(ranked, counts, strict=True) for _ in range(n)]),
        "rank": integer([r.rank for r, n in zip(ranked, counts, strict=True) for _ in range(n)]),
    }


def to_lonlat(
    result: RunResult, geometries: list[BaseGeometry], step_m: float
) -> npt.NDArray[np.object_]:
    """Transform planar geometries to lon/lat, with segments of at most `step_m` true metres.

    Areas become MultiPolygons.
    """
    array = np.empty(len(geometries), dtype=object)
    array[:] = geometries
    lonlat = result.scene.projection.geometry_to_lonlat(array, densify_m=step_m)
    areas = not all(shapely.get_type_id(lonlat) == shapely.GeometryType.LINESTRING)
    return multi(lonlat) if areas else lonlat


def multi(areas: Any) -> npt.NDArray[np.object_]:  # noqa: ANN401 - any sequence of geometries
    """Make MultiPolygons of areas; lines and points that a union leaves are dropped."""
    multis = np.full(len(areas), shapely.MultiPolygon(), dtype=object)
    parts, index = shapely.get_parts(np.array(areas, dtype=object), return_index=True)
    polygons = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    shapely.multipolygons(parts[polygons], indices=index[polygons], out=multis)
    return multis


def text(values: list[str]) -> npt.NDArray[np.object_]:
    """Column of strings."""
    return np.array(values, dtype=object)


def integer(values: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Column of whole numbers."""
    return np.array(values, dtype=np.int64)


def real(values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Column of numbers; any that is not finite becomes NaN, which is written as NULL."""
    column = np.array(values, dtype=np.float64)
    column[~np.isfinite(column)] = np.nan
    return column


def concatenated(columns: list[npt.NDArray[np.float64]]) -> npt.NDArray[np.float64]:
    """Columns of numbers, concatenated."""
    return real(np.concatenate([np.empty(0), *columns]))


def stack(points: list[npt.NDArray[np.float64]]) -> npt.NDArray[np.float64]:
    """Points (n, 2), concatenated."""
    return np.concatenate([np.empty((0, 2)), *points])
