"""The chart: an extent of water and the hard no-go zone L in it, checked once, at the door."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from renew.errors import GeometryError

# Coordinates closer than this share of the extent's diagonal are one point. The grid keeps
# overlay results noded (no sliver between an island and the extent that it touches), and is
# far below anything that a vessel could notice: 1 mm on 1,000 km.
_PRECISION = 1e-9


class Chart:
    """Extent and hard no-go zone in planar metres.

    Islands may overlap, touch each other or the extent, stick out of it, and have lakes; holes
    in the extent are land. The extent's own edge is the end of the chart, not a hazard.

    Parameters
    ----------
    extent : Polygon
        Where routes may go at all (m).
    no_go : iterable of Polygon
        Land and shoals (m). MultiPolygons are taken apart.

    Raises
    ------
    GeometryError
        Polygons that are invalid (the message says where and why, all at once), empty or not
        finite, or no water left.
    """

    def __init__(self, extent: Polygon, no_go: Iterable[Polygon] = ()) -> None:
        islands = [part for geometry in no_go for part in _polygons(geometry)]
        _check(extent, islands)
        # Where the extent has a hole there is no water: land like any other.
        islands += [Polygon(hole) for hole in extent.interiors]
        extent = Polygon(extent.exterior)
        minx, miny, maxx, maxy = extent.bounds
        self.precision = _PRECISION * float(np.hypot(maxx - minx, maxy - miny))
        """Grid on which the chart's coordinates are snapped (m)."""
        self.extent: Polygon = extent
        merged = shapely.union_all(np.array(islands, dtype=object), grid_size=self.precision)
        clipped = shapely.intersection(merged, extent, grid_size=self.precision)
        self.no_go: tuple[Polygon, ...] = tuple(_polygons(clipped))
        """The hard no-go zone inside the extent as disjoint polygons."""
        if self.water.is_empty:
            raise GeometryError("chart: the no-go zone covers the whole extent; no water is left")

    @cached_property
    def hard_no_go(self) -> MultiPolygon:
        """The hard no-go zone L as one geometry."""
        return MultiPolygon(self.no_go)

    @cached_property
    def water(self) -> BaseGeometry:
        """The extent minus L: a Polygon, or a MultiPolygon where land parts it."""
        return shapely.difference(self.extent, self.hard_no_go, grid_size=self.precision)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """The extent's (xmin, ymin, xmax, ymax) in metres."""
        xmin, ymin, xmax, ymax = self.extent.bounds
        return xmin, ymin, xmax, ymax


def _polygons(geometry: BaseGeometry) -> list[Polygon]:
    """Take the polygons out of any geometry; points and lines have no area to keep out of."""
    return [
        part
        for part in shapely.get_parts(geometry, return_index=False).tolist()
        if isinstance(part, Polygon) and not part.is_empty
    ]


def _check(extent: Polygon, islands: list[Polygon]) -> None:
    """Raise one GeometryError that names every bad polygon."""
    if not isinstance(extent, Polygon) or extent.is_empty:
        raise GeometryError(f"chart: the extent must be a non-empty Polygon, not {extent!r}")
    faults = []
    for name, polygon in [("extent", extent), *((f"no_go[{i}]", p) for i, p in enumerate(islands))]:
        if not np.isfinite(shapely.get_coordinates(polygon)).all():
            faults.append(f"{name} has coordinates that are not finite")
        elif not polygon.is_valid:
            faults.append(f"{name} is not valid: {shapely.is_valid_reason(polygon)}")
    if faults:
        raise GeometryError("chart: " + "; ".join(faults) + ". Mend with shapely.make_valid.")
