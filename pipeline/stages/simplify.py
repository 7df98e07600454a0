"""Second stage: simplify the land to an outer cover, the hard no-go zone, and to inner polygons.

The steps, in true metres in the plane that is centred on the region:

1. Project and repair the land, and clip it to the region and a little beyond.
2. Cover it and its margin with polygons of fewer vertices
   (:mod:`pipeline.geo.coast`); only covers that overlap are joined.
3. Keep starts and goals in water, and connected (:mod:`pipeline.geo.coast`).
4. Simplify the land inwards, without a margin. A route that avoids only this inner land gives a
   lower bound on the cost of every route that avoids the land.
5. Check that the results are valid, the cover contains all land, and land contains all inner land.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, pairwise

import numpy as np
import shapely

from pipeline._types import FloatArray, Geometries
from pipeline.errors import StageError
from pipeline.geo.coast import covering_land, inner_land, opened, within
from pipeline.geo.projection import MAX_EDGE_M, Projection, position_text
from pipeline.machine.store import Artefact, Store
from pipeline.model import Land, Note, Place, SimplifiedLand, planner_vessel
from pipeline.scenario.model import Scenario
from pipeline.scenario.strict import Point
from pipeline.sources.land.shapes import extract_polygons, in_plane
from pipeline.stages.places import unsimplified

# Extent of land beyond the region's edge, as a share of the region's diagonal: more than the edge
# can move when the next stage approximates a curved edge by straight ones.
_OVERLAP = 3e-3
# Share of the region's diagonal (1 m per 1,000 km) by which the cover is widened and inner land is
# narrowed, so that rounding of coordinates, to degrees and back, does not uncover land.
_ROUNDING = 1e-6
# The tolerance as shares of the turning radius and of the region's diagonal; see
# `chosen_tolerance_m`.
_OF_RADIUS = 1 / 8
_OF_DIAGONAL = 5e-5
# Uncovered area that is ascribed to rounding where two polygons share an edge, m².
_UNCOVERED_M2 = 1.0


def simplify(
    scenario: Scenario, land: Artefact[Land], store: Store, ends: Sequence[Point] = ()
) -> Artefact[SimplifiedLand]:
    """Simplify the chart's land; the scenario's stops and the points `ends` stay in water."""
    region, chart, fastest = scenario.region, scenario.chart, scenario.fastest_vessel
    names = {"region", "plane", "scale", "chart", "start", "goal", "via"}
    figures = scenario.model_dump(mode="json", include=names)
    inputs = land.key, figures, fastest.model_dump(), list(ends)

    def make() -> SimplifiedLand:
        if region is None:
            return unsimplified(land.value)
        return simplify_land(
            land.value.polygons,
            region.shape,
            margin_m=chart.margin_m,
            accuracy_m=land.value.accuracy_m,
            tolerance_m=chart.tolerance_m,
            turning_radius_m=planner_vessel(fastest).turning_radius * scenario.scale,
            endpoints=(*chain(*pairwise(scenario.stops.values())), *ends),
            projection=Projection.for_region(region.shape),
        )

    return store.artefact("simplify", SimplifiedLand, inputs, make)


def simplify_land(
    polygons: Sequence[shapely.Polygon],
    region: shapely.Polygon,
    *,
    margin_m: float | None = None,
    tolerance_m: float | None = None,
    accuracy_m: float = 0.0,
    turning_radius_m: float = 0.0,
    endpoints: Sequence[tuple[float, float]] = (),
    projection: Projection | None = None,
) -> SimplifiedLand:
    """Simplify land to disjoint, valid polygons that cover it, and to others that lie inside it.

    Raises StageError if the result failed a check.

    Parameters
    ----------
    polygons : land near the region, lon/lat degrees; may overlap or be invalid.
    region : lon/lat degrees. Land that meets its edge extends a little beyond it in the result.
    margin_m, accuracy_m : the margin asked for and the coast's position error (true metres); the
        larger is applied.
    tolerance_m : largest distance of the simplified coast from the land with its margin (true
        metres); default: `chosen_tolerance_m`.
    turning_radius_m : the vessel's turning radius (true metres), for the choice of the tolerance.
    endpoints : start, goal (lon, lat) of each leg in turn. They stay in water, and connected, if
        they are so on the original land.
    projection : the planner's plane, in which edges will be straight; by default the region's own.
    """
    used_margin_m, notes = margin_m or accuracy_m, tuple[Note, ...]()
    if margin_m is not None and margin_m < accuracy_m:
        used_margin_m = accuracy_m
        notes += (Note.of("margin-raised", margin_m=margin_m, accuracy_m=accuracy_m),)
    plane = replace(projection or Projection.for_region(region), scale=1.0)
    extent = plane.geometry_to_plane(region, MAX_EDGE_M)
    shapely.prepare(extent)
    xmin, ymin, xmax, ymax = extent.bounds
    diagonal_m = math.hypot(xmax - xmin, ymax - ymin)
    ends = plane.to_plane(np.array(endpoints, dtype=np.float64).reshape(-1, 2))
    if tolerance_m is None:
        tolerance_m = chosen_tolerance_m(accuracy_m, turning_radius_m, diagonal_m)
    rounding_m = _ROUNDING * diagonal_m
    stretch = max(1.0, float(plane.point_scale(shapely.get_coordinates(region)).max()))
    planar_m = used_margin_m * stretch + rounding_m
    overlap_m = max(_OVERLAP * diagonal_m, 2 * used_margin_m)
    window = extent.buffer(overlap_m + planar_m + tolerance_m, join_style="mitre")
    land = extract_polygons(within(in_plane(polygons, plane), window))
    cover = opened(
        covering_land(land, tolerance_m, planar_m, ends), land, extent, ends, planar_m + tolerance_m
    )
    outer, inner, charted = (
        polygons[shapely.intersects(extent, polygons)]
        for polygons in (cover.land, inner_land(land, tolerance_m, rounding_m), land)
    )
    check(outer, inner, charted, ends, plane)
    if cover.narrowest is not None:
        place, width_m = Place(*plane.to_lonlat(cover.narrowest).tolist()), cover.width_m
        notes += (Note.of("margin-narrowed", margin_m=used_margin_m, width_m=width_m, place=place),)
    return SimplifiedLand(
        polygons=tuple(plane.geometry_to_lonlat(outer).tolist()),
        inner_polygons=tuple(plane.geometry_to_lonlat(inner).tolist()),
        original_vertices=_count_vertices(land),
        vertices=_count_vertices(outer),
        tolerance_m=tolerance_m,
        margin_m=used_margin_m,
        notes=notes,
    )


def chosen_tolerance_m(accuracy_m: float, turning_radius_m: float, diagonal_m: float) -> float:
    """Choose the largest tolerance that hardly affects routes, because vertices cost time.

    It is the largest of three lengths (true metres): the chart's accuracy, below which the coast is
    not known; an eighth of the turning radius, because the vessel can't follow much tighter bends;
    and 0.05 per mille of the region's diagonal. The last makes a route longer by about 0.01 %,
    because a route turns by one to two radians in total round the capes that it passes.
    """
    return max(accuracy_m, _OF_RADIUS * turning_radius_m, _OF_DIAGONAL * diagonal_m)


def check(
    outer: Geometries, inner: Geometries, land: Geometries, endpoints: FloatArray, plane: Projection
) -> None:
    """Raise StageError unless all polygons are valid, and inner land ⊂ land ⊂ outer land.

    All inputs are planar. An endpoint (n, 2) on outer land is a fault unless it is on land itself.
    The message names places in lon/lat.
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
            (_beyond(inner, land), "inner land lie outside the land"),
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


def _place(area: shapely.Geometry, plane: Projection) -> str:
    """Return the position of a point inside an area of the plane, as text in lon/lat."""
    lon, lat = plane.to_lonlat(shapely.get_coordinates(shapely.point_on_surface(area))[0])
    return f"at {position_text(lon, lat)}"


def _beyond(areas: Geometries, cover: Geometries) -> Geometries:
    """Return each area minus the cover (n,), without areas that one cover polygon contains."""
    # Nearly every area lies in one polygon of the cover; this test is quick.
    covered = shapely.STRtree(areas).query(cover, predicate="covers")[1]
    left = np.delete(areas, np.unique(covered))
    tree = shapely.STRtree(cover)
    beyond = [
        shapely.difference(area, shapely.union_all(cover[tree.query(area, predicate="intersects")]))
        for area in left
    ]
    return np.array(beyond, dtype=object)


def _count_vertices(polygons: Geometries) -> int:
    """Count the vertices of polygons; a ring's last point, equal to its first, is not counted."""
    rings = shapely.get_num_interior_rings(polygons).sum() + len(polygons)
    return int(shapely.get_num_coordinates(polygons).sum() - rings)
