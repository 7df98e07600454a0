"""Second stage: the hard no-go zone, which covers all land, and land within the land for bounds.

In true metres, in the plane that is centred on the region:

1. land is projected, repaired, and clipped to the region and a little beyond;
2. it is covered, with its margin, by polygons of fewer vertices
   (:mod:`pipeline.geo.coast.covering_land`): nothing is joined but what overlaps then;
3. starts and goals stay in water, and connected (:mod:`pipeline.geo.coast.open_water`);
4. the same is done inwards, without a margin: no route that stays off the land can be better than
   one that need only stay off this;
5. the results are checked: valid, all of the land covered, nothing inside that is not land.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from pipeline._types import FloatArray, Geometries
from pipeline.errors import StageError
from pipeline.geo.coast.covering_land import covering_land, inner_land
from pipeline.geo.coast.open_water import OpenWater, opened
from pipeline.geo.position import position_text
from pipeline.geo.projection import Projection
from pipeline.machine.storage.store import Made, Store
from pipeline.model import Land, Simplified
from pipeline.model.for_planner import planner_vessel
from pipeline.model.notes import Note, Place
from pipeline.scenario.model import Scenario
from pipeline.scenario.strict import Point
from pipeline.stages.projecting import planar

# Maximum length of an edge when it is projected, m: what is straight in degrees is curved in the
# plane, by 1.3 m for 5 km at 70 degrees of latitude.
_MAX_EDGE_M = 5_000.0
# How far land extends beyond the region's edge, as a share of its diagonal: more than the edge can
# move when another stage divides a curved edge into straight ones.
_OVERLAP = 3e-3
# Added to the margin, as a share of the region's diagonal (1 m to 1,000 km), and taken from inner
# land: rounding coordinates on the way to degrees and back must not uncover land.
_ROUNDING = 1e-6
# The tolerance as shares of the turning radius and of the region's diagonal; see
# `chosen_tolerance_m`.
_OF_RADIUS = 1 / 8
_OF_DIAGONAL = 5e-5
# Area that may seem uncovered by rounding where two polygons share an edge, m².
_UNCOVERED_M2 = 1.0


@dataclass(frozen=True, slots=True)
class SimplifiedLand:
    """The stage's result, and notes on it: a margin raised, a passage opened."""

    simplified: Simplified
    notes: tuple[Note, ...]


def simplify(
    scenario: Scenario, land: Made[Land], store: Store, ends: Sequence[Point] = ()
) -> Made[SimplifiedLand]:
    """Simplify the land of a scenario's chart; `ends` are kept in water beside its own stops."""
    region, chart, fastest = scenario.region, scenario.chart, scenario.fastest_vessel
    names = {"region", "plane", "scale", "chart", "start", "goal", "via"}
    figures = scenario.model_dump(mode="json", include=names)
    inputs = land.key, figures, fastest.model_dump(), list(ends)

    def make() -> SimplifiedLand:
        if region is None:
            return SimplifiedLand(planar.unsimplified(land.value), ())
        return simplify_land(
            land.value.polygons,
            region.shape,
            margin_m=chart.margin_m,
            accuracy_m=land.value.accuracy_m,
            tolerance_m=chart.tolerance_m,
            turning_radius_m=planner_vessel(fastest).turning_radius * scenario.scale,
            endpoints=(*chain(*pairwise(scenario.stops.values())), *ends),
            projection=Projection.for_region(region.shape, 1.0, region.crs),
        )

    return store.made("simplify", SimplifiedLand, inputs, make)


def simplify_land(
    polygons: Sequence[Polygon],
    region: Polygon,
    *,
    margin_m: float | None = None,
    tolerance_m: float | None = None,
    accuracy_m: float = 0.0,
    turning_radius_m: float = 0.0,
    endpoints: Sequence[tuple[float, float]] = (),
    projection: Projection | None = None,
) -> SimplifiedLand:
    """Cover land by disjoint, valid polygons of fewer vertices, and fill it by others.

    Parameters
    ----------
    polygons
        Land near the region, lon/lat degrees; may overlap or be invalid.
    region
        Lon/lat degrees. Land that meets its edge extends a little beyond it in the result.
    margin_m, accuracy_m
        Margin asked for, and how far the coast may be off (true metres): the larger one is added.
    tolerance_m
        How far the simplified coast may be from the land with its margin (true metres); left out,
        `chosen_tolerance_m`.
    turning_radius_m
        The vessel's turning radius (true metres), for the choice of the tolerance.
    endpoints
        Start and goal (lon, lat) of each voyage in turn: they stay in water, and connected, where
        the land leaves them so.
    projection
        The planner's plane, in which edges will be straight; by default the region's own.

    Raises
    ------
    StageError
        The result failed a check.
    """
    used_margin_m, notes = _margin_used(margin_m, accuracy_m)
    plane = replace(projection or Projection.for_region(region), scale=1.0)
    area = _Area.of(region, plane, endpoints)
    if tolerance_m is None:
        tolerance_m = chosen_tolerance_m(accuracy_m, turning_radius_m, area.diagonal_m)
    rounding_m = _ROUNDING * area.diagonal_m
    planar_m = used_margin_m * area.stretch + rounding_m
    overlap_m = max(_OVERLAP * area.diagonal_m, 2 * used_margin_m)
    window = area.extent.buffer(overlap_m + planar_m + tolerance_m, join_style="mitre")
    land = _planar_land(polygons, plane, window)
    cover = opened(
        covering_land(land, tolerance_m, planar_m, area.endpoints),
        land,
        area.extent,
        area.endpoints,
        planar_m + tolerance_m,
    )
    outer = area.within(cover.land)
    inner = area.within(inner_land(land, tolerance_m, rounding_m))
    check(outer, inner, area.within(land), area.endpoints, plane)
    simplified = Simplified(
        polygons=tuple(plane.geometry_to_lonlat(outer).tolist()),
        inner_polygons=tuple(plane.geometry_to_lonlat(inner).tolist()),
        original_vertices=_count_vertices(land),
        vertices=_count_vertices(outer),
        tolerance_m=tolerance_m,
        margin_m=used_margin_m,
    )
    return SimplifiedLand(simplified, (*notes, *_opening_notes(cover, used_margin_m, plane)))


def chosen_tolerance_m(accuracy_m: float, turning_radius_m: float, diagonal_m: float) -> float:
    """Choose the tolerance: the largest that costs nothing that matters, as vertices cost time.

    It is the largest of three lengths (true metres). Below the chart's accuracy the coast is not
    known. A vessel can't follow bends of the coast much tighter than its turning radius: an eighth
    of that. And a tolerance of 0.05 per mille of the region's diagonal makes a route longer by some
    0.01 %, as a route turns by one to two radians in all round the capes that it passes.
    """
    return max(accuracy_m, _OF_RADIUS * turning_radius_m, _OF_DIAGONAL * diagonal_m)


@dataclass(frozen=True, slots=True)
class _Area:
    """The region in the plane, and what follows from its size.

    `stretch` is the plane's largest point scale (at least 1), `endpoints` (n, 2) are start and
    goal.
    """

    extent: Polygon
    endpoints: FloatArray
    diagonal_m: float
    stretch: float

    @classmethod
    def of(
        cls, region: Polygon, plane: Projection, endpoints: Sequence[tuple[float, float]]
    ) -> _Area:
        """Project a region and its endpoints (lon/lat degrees)."""
        extent = plane.geometry_to_plane(region, _MAX_EDGE_M)
        shapely.prepare(extent)
        xmin, ymin, xmax, ymax = extent.bounds
        return cls(
            extent=extent,
            endpoints=plane.to_plane(np.array(endpoints, dtype=np.float64).reshape(-1, 2)),
            diagonal_m=math.hypot(xmax - xmin, ymax - ymin),
            stretch=max(1.0, float(plane.point_scale(shapely.get_coordinates(region)).max())),
        )

    def within(self, polygons: Geometries) -> Geometries:
        """Return those polygons of which a part lies in the extent."""
        return np.asarray(polygons[shapely.intersects(self.extent, polygons)])


def _margin_used(margin_m: float | None, accuracy_m: float) -> tuple[float, tuple[Note, ...]]:
    """Return the margin, never below the accuracy, and a note where that is more than asked."""
    if margin_m is None or margin_m >= accuracy_m:
        return margin_m or accuracy_m, ()
    return accuracy_m, (Note.of("margin-raised", margin_m=margin_m, accuracy_m=accuracy_m),)


def check(
    outer: Geometries,
    inner: Geometries,
    land: Geometries,
    endpoints: FloatArray,
    plane: Projection,
) -> None:
    """Raise StageError unless all is valid, and inner land < land < outer land, by area.

    All are planar; endpoints (n, 2) on outer land are a fault but for those on land. The message
    has places in lon/lat.
    """
    faults = []
    for name, polygons in (("outer", outer), ("inner", inner)):
        if not (valid := shapely.is_valid(polygons)).all():
            first = polygons[~valid][0]
            reason = shapely.is_valid_reason(first).partition("[")[0]
            place = _place(shapely.centroid(first), plane)
            faults.append(f"{(~valid).sum()} {name} polygons are invalid ({reason}, {place})")
    if not faults:
        for beyond, what in (
            (_beyond(land, outer), "land are uncovered"),
            (_beyond(inner, land), "inner land are no land"),
        ):
            if (m2 := float(shapely.area(beyond).sum())) > _UNCOVERED_M2:
                largest = beyond[int(np.argmax(shapely.area(beyond)))]
                faults.append(f"{m2:.0f} m² of {what}, {_place(largest, plane)}")
        points = shapely.points(endpoints)
        on_land, on_outer = (
            np.isin(np.arange(len(points)), shapely.STRtree(some).query(points, "intersects")[0])
            for some in (land, outer)
        )
        covered = points[on_outer & ~on_land]
        if len(covered):
            places = " and ".join(_place(point, plane) for point in covered)
            faults.append(f"{len(covered)} of starts and goals are covered by land, {places}")
    if faults:
        raise StageError(
            f"simplify: {' and '.join(faults)}: an error in the program; try another "
            "chart.tolerance_m"
        )


def _place(area: BaseGeometry, plane: Projection) -> str:
    """Name a place in an area of the plane."""
    lon, lat = plane.to_lonlat(shapely.get_coordinates(shapely.point_on_surface(area))[0])
    return f"at {position_text(lon, lat)}"


def _beyond(areas: Geometries, cover: Geometries) -> Geometries:
    """Return the parts (n,) of areas beyond those of a cover, where areas overlap once for each."""
    # Nearly all areas lie in one polygon of the cover, which is quick to see.
    covered = shapely.STRtree(areas).query(cover, predicate="covers")[1]
    left = np.delete(areas, np.unique(covered))
    tree = shapely.STRtree(cover)
    beyond = [
        shapely.difference(area, shapely.union_all(cover[tree.query(area, predicate="intersects")]))
        for area in left
    ]
    return np.array(beyond, dtype=object)


def _planar_land(polygons: Sequence[Polygon], plane: Projection, window: Polygon) -> Geometries:
    """Project and repair the land, and clip it to the window."""
    # Repaired before long edges are divided, which alone would drop half of a figure of eight, and
    # again after.
    degrees = _repaired(np.array(polygons, dtype=object))
    planar = shapely.get_parts(_repaired(plane.geometry_to_plane(degrees, _MAX_EDGE_M)))
    shapely.prepare(window)
    planar = planar[shapely.intersects(window, planar)]
    crosses = ~shapely.covers(window, planar)
    planar[crosses] = shapely.intersection(planar[crosses], window)
    parts = shapely.get_parts(planar)
    kind = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    return np.asarray(parts[kind & ~shapely.is_empty(parts)])


def _repaired(polygons: Geometries) -> Geometries:
    """Make invalid polygons valid; one may become several."""
    invalid = ~shapely.is_valid(polygons)
    repaired = polygons.copy()
    repaired[invalid] = shapely.make_valid(
        polygons[invalid], method="structure", keep_collapsed=False
    )
    return repaired


def _count_vertices(polygons: Geometries) -> int:
    """Count the vertices of polygons; the last point of a ring is its first."""
    rings = shapely.get_num_interior_rings(polygons).sum() + len(polygons)
    return int(shapely.get_num_coordinates(polygons).sum() - rings)


def _opening_notes(cover: OpenWater, margin_m: float, plane: Projection) -> tuple[Note, ...]:
    """Say where start and goal are connected by less water than the margin leaves."""
    if cover.narrowest is None:
        return ()
    place = Place(*plane.to_lonlat(cover.narrowest).tolist())
    note = Note.of("margin-narrowed", margin_m=margin_m, width_m=cover.width_m, place=place)
    return (note,)
