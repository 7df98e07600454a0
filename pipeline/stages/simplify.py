"""Second stage: replace land of 100,000 vertices by polygons of a few hundred that cover it.

In true metres, in the plane that is centred on the region:

1. *margin* (:mod:`pipeline.geo.coast.grow_margin`): every coast grows by the margin;
2. *gaps* (:mod:`pipeline.geo.coast.close_gaps`): gaps too narrow for a route, pools and lakes
   become land;
3. *vertices* (:mod:`pipeline.geo.coast.covering_simplify`): vertices are removed, and land is only
   ever added;
4. while there are more vertices than the budget allows, islets are merged with their neighbours and
   the tolerance grows;
5. the result is checked: valid, no two polygons touch, all of the land is covered.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.errors import RequestError, StageError
from pipeline.geo.coast.close_gaps import ClosedLand, close_gaps
from pipeline.geo.coast.covering_simplify import ProtectedWater, count_vertices, covering_simplify
from pipeline.geo.coast.grow_margin import are_connected, grow_margin
from pipeline.geo.projection import Projection
from pipeline.model import Simplified

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt
    from shapely.geometry import Polygon
    from shapely.geometry.base import BaseGeometry

    FloatArray = npt.NDArray[np.float64]
    Geometries = npt.NDArray[np.object_]

# Maximum length of an edge when it is projected, m: what is straight in degrees is curved in the
# plane, by 1.3 m for 5 km at 70 degrees of latitude.
_MAX_EDGE_M = 5_000.0
# Thinning before and after the margin, as a share of the tolerance and of the gap: costs little
# water and spares the triangulation half of its vertices.
_THINNING = 1 / 20
# How far land extends beyond the region's edge, as a share of its diagonal: more than the edge can
# move when another stage divides a curved edge into straight ones.
_OVERLAP = 3e-3
# Added to the margin, as a share of the region's diagonal (1 m to 1,000 km): rounding coordinates
# on the way to degrees and back must not uncover land.
_ROUNDING = 1e-6
# From trial to trial the tolerance grows by the ratio of vertices to budget, within these factors
# (the vertices decrease a little slower than it grows), up to this share of the region's diagonal.
_MIN_GROWTH, _MAX_GROWTH = 1.2, 3.0
_MAX_TOLERANCE = 1 / 50
# Gap across which islets are merged, as a multiple of the tolerance: of the pairs that meet a
# budget, this one lost about the least water around Palawan.
_MERGE = 1.5
# Clear water around an endpoint or an opening, as a share of the gap or of the opening's width.
_CLEARANCE = 1 / 4
# Minimum distance between two polygons where no gaps are closed, m.
_MIN_DISTANCE_M = 1.0
# Area that may seem uncovered by rounding where two polygons share an edge, m².
_UNCOVERED_M2 = 1.0


@dataclass(frozen=True, slots=True)
class SimplifiedLand:
    """The stage's result, and notes on it.

    `added` is the share by which the land's area in the region grew. `notes` say in plain words
    which passages were left open to connect start and goal, and what was merged.
    """

    simplified: Simplified
    added: float
    notes: tuple[str, ...]


def simplify_land(
    polygons: Sequence[Polygon],
    region: Polygon,
    *,
    margin_m: float | None,
    close_gaps_m: float,
    tolerance_m: float,
    vertex_budget: int,
    accuracy_m: float = 0.0,
    endpoints: Sequence[tuple[float, float]] = (),
    projection: Projection | None = None,
) -> SimplifiedLand:
    """Cover land by few valid polygons of few vertices, without a point in common.

    Parameters
    ----------
    polygons
        Land near the region, lon/lat degrees; may overlap or be invalid.
    region
        Lon/lat degrees. Land that meets its edge extends a little beyond it in the result.
    margin_m, accuracy_m
        Margin asked for, and how far the coast may be off (true metres): the larger one is added.
    close_gaps_m
        Gaps narrower than this (true metres) become land.
    tolerance_m
        Maximum distance of the new coast from the land (true metres); grows to meet the budget.
    vertex_budget
        Maximum number of vertices.
    endpoints
        Start and goal (lon, lat): they stay in water, and connected, by the widest passage.
    projection
        The planner's plane, in which edges will be straight; by default the region's own.

    Raises
    ------
    RequestError
        The budget can't be met; the message says how many vertices are enough.
    StageError
        The result failed a check.
    """
    used_margin_m, notes = _margin_used(margin_m, accuracy_m)
    plane = replace(projection or Projection.for_region(region), scale=1.0)
    area = _Area.of(region, plane, used_margin_m, endpoints)
    original = _planar_land(polygons, plane, area.window(used_margin_m, close_gaps_m))
    region_land = shapely.intersection(shapely.disjoint_subset_union_all(original), area.extent)
    thinning = _THINNING * min(close_gaps_m or tolerance_m, tolerance_m)
    land, margin_notes = _with_margin(original, region_land, area, used_margin_m, thinning)
    trial = _ToleranceSearch(area, close_gaps_m).run(land, tolerance_m, vertex_budget)
    check(trial.polygons, region_land, area.endpoints)
    simplified = Simplified(
        polygons=tuple(plane.geometry_to_lonlat(trial.polygons).tolist()),
        original_vertices=count_vertices(original),
        vertices=count_vertices(trial.polygons),
        tolerance_m=trial.tolerance_m,
        closed_gap_m=close_gaps_m,
        margin_m=used_margin_m,
    )
    added = _added_share(trial.polygons, region_land, area.extent)
    notes += (*margin_notes, *_trial_notes(trial, close_gaps_m, plane))
    return SimplifiedLand(simplified, added, notes)


@dataclass(frozen=True, slots=True)
class _Area:
    """The region in the plane, and what follows from its size.

    `overlap_m` is how far land extends beyond the region's edge, `stretch` the plane's largest
    point scale (at least 1), `endpoints` (n, 2) are start and goal.
    """

    extent: Polygon
    endpoints: FloatArray
    diagonal_m: float
    overlap_m: float
    stretch: float

    @classmethod
    def of(
        cls,
        region: Polygon,
        plane: Projection,
        margin_m: float,
        endpoints: Sequence[tuple[float, float]],
    ) -> _Area:
        """Project a region and its endpoints (lon/lat degrees)."""
        extent = plane.geometry_to_plane(region, _MAX_EDGE_M)
        xmin, ymin, xmax, ymax = extent.bounds
        diagonal_m = math.hypot(xmax - xmin, ymax - ymin)
        return cls(
            extent=extent,
            endpoints=plane.to_plane(np.array(endpoints, dtype=np.float64).reshape(-1, 2)),
            diagonal_m=diagonal_m,
            overlap_m=max(_OVERLAP * diagonal_m, 2 * margin_m),
            stretch=max(1.0, float(plane.point_scale(shapely.get_coordinates(region)).max())),
        )

    def window(self, margin_m: float, gap_m: float) -> Polygon:
        """Return the extent with all surroundings whose land can matter inside it."""
        return self.extent.buffer(self.overlap_m + 2 * margin_m + gap_m)


def _added_share(polygons: Geometries, land: BaseGeometry, extent: Polygon) -> float:
    """Return the share by which polygons exceed the land's area in the extent."""
    covered = shapely.area(shapely.intersection(polygons, extent)).sum()
    return float(covered / land.area - 1) if land.area else 0.0


def _margin_used(margin_m: float | None, accuracy_m: float) -> tuple[float, tuple[str, ...]]:
    """Return the margin, never below the accuracy, and a note where that is more than asked."""
    note = (
        f"chart.margin_m is {margin_m:g} m, below the {accuracy_m:g} m by which the coast may "
        f"be off: {accuracy_m:g} m were added"
        if margin_m is not None and margin_m < accuracy_m
        else ""
    )
    return max(margin_m or 0.0, accuracy_m), (note,) if note else ()


def _with_margin(
    original: Geometries, region_land: BaseGeometry, area: _Area, margin_m: float, thinning_m: float
) -> tuple[BaseGeometry, tuple[str, ...]]:
    """Grow land by the margin (true metres), and note where that disconnects start and goal."""
    planar_m = margin_m * area.stretch + _ROUNDING * area.diagonal_m
    land = grow_margin(original, planar_m, thinning_m, area.endpoints)
    if are_connected(land, area.extent, area.endpoints) or not are_connected(
        region_land, area.extent, area.endpoints
    ):
        return land, ()
    # The thinning only saves time: unlike the margin it may not close a harbour.
    land = grow_margin(original, planar_m, 0.0, area.endpoints)
    if are_connected(land, area.extent, area.endpoints):
        return land, ()
    note = (
        f"the margin of {margin_m:g} m closes every passage between start and goal: lower "
        "chart.margin_m"
    )
    return land, (note,)


def check(polygons: Geometries, land: BaseGeometry, endpoints: FloatArray) -> None:
    """Raise StageError unless polygons are valid, don't touch, cover the land and no endpoint.

    All are planar; endpoints (n, 2) that lie on land are left out.
    """
    faults = []
    invalid = polygons[~shapely.is_valid(polygons)]
    if len(invalid):
        reason = shapely.is_valid_reason(invalid[0])
        faults.append(f"{len(invalid)} polygons are invalid ({reason})")
    else:
        one, other = shapely.STRtree(polygons).query(polygons, predicate="intersects")
        if (one < other).any():
            faults.append(f"{int((one < other).sum())} pairs of polygons touch")
        uncovered = shapely.difference(land, shapely.union_all(polygons)).area
        if uncovered > _UNCOVERED_M2:
            faults.append(f"{uncovered:.0f} m² of land are uncovered")
        points = shapely.points(endpoints)
        points = points[~shapely.intersects(land, points)]
        covered = shapely.intersects(polygons[:, None], points).any(axis=0).sum()
        if covered:
            faults.append(f"{covered} of start and goal are covered by land")
    if faults:
        raise StageError(
            f"simplify: {' and '.join(faults)}: an error in the program; try another "
            "chart.close_gaps_m or chart.tolerance_m"
        )


@dataclass(frozen=True, slots=True)
class _Trial:
    """Polygons, the tolerance and the merging gap (m) that led to them, and their openings."""

    polygons: Geometries
    tolerance_m: float
    merge_m: float
    closed: ClosedLand


@dataclass(frozen=True, slots=True)
class _ToleranceSearch:
    """Searches the smallest tolerance that meets the vertex budget."""

    area: _Area
    gap_m: float

    def run(self, land: BaseGeometry, tolerance_m: float, budget: int) -> _Trial:
        """Return the first trial within the budget."""
        first = trial = self._trial(land, tolerance_m, 0.0)
        max_m = _MAX_TOLERANCE * self.area.diagonal_m
        # A tolerance of 0 has to grow from somewhere.
        tolerance = max(tolerance_m, max_m / 1000)
        max_m = max(max_m, tolerance_m)
        while (count := count_vertices(trial.polygons)) > budget:
            if tolerance >= max_m:
                # Trials in between depend on the budget: with another one their counts might not
                # be reached again.
                enough = min(count, count_vertices(first.polygons))
                fault = (
                    f"chart.vertex_budget is {budget}, but {enough} vertices are left at a "
                    f"tolerance of {tolerance / 1000:.1f} km, a fiftieth of the region: set it to "
                    f"{enough} or more, or choose a smaller region"
                )
                raise RequestError([fault])
            growth = min(max(count / budget, _MIN_GROWTH), _MAX_GROWTH)
            tolerance = min(tolerance * growth, max_m)
            # Every trial starts from the first one, so that errors don't accumulate.
            start = shapely.union_all(first.polygons)
            slack = tolerance - first.tolerance_m
            trial = self._trial(start, slack, _MERGE * tolerance, budget)
            trial = replace(trial, tolerance_m=tolerance)
        return trial

    def _trial(
        self, land: BaseGeometry, tolerance_m: float, merge_m: float, min_vertices: int = 0
    ) -> _Trial:
        """Close gaps, then remove vertices until `min_vertices` are left."""
        endpoints = self.area.endpoints
        closed = close_gaps(
            land, self.area.extent, self.gap_m, endpoints, self.area.overlap_m, merge_m
        )
        points = shapely.points(endpoints)
        room_m = shapely.distance(points, shapely.multipolygons(closed.polygons)) / 2
        widths_m = [min(o.width_m, max(self.gap_m, merge_m)) for o in closed.openings]
        protected = ProtectedWater(
            np.array([*points, *(opening.way for opening in closed.openings)], dtype=object),
            np.array(
                [
                    *np.minimum(room_m, _CLEARANCE * self.gap_m),
                    *(_CLEARANCE * width_m for width_m in widths_m),
                ]
            ),
        )
        polygons = covering_simplify(
            closed.polygons,
            closed.polygons,
            tolerance_m,
            max(self.gap_m, _MIN_DISTANCE_M),
            protected,
            min_vertices,
        )
        return _Trial(polygons, tolerance_m, merge_m, closed)


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


def _trial_notes(trial: _Trial, gap_m: float, plane: Projection) -> tuple[str, ...]:
    """Say in plain words what was done beyond the settings."""
    notes = []
    closed_m = max(gap_m, trial.merge_m)
    if reopened := [opening for opening in trial.closed.openings if opening.reopened]:
        narrowest = min(reopened, key=lambda opening: opening.width_m)
        lon, lat = plane.to_lonlat(narrowest.middle)
        notes.append(
            "start and goal are connected only by water narrower than "
            f"{closed_m:.0f} m, which was left open; the narrowest passage has "
            f"{narrowest.width_m:.0f} m between the margins, at {lon:.4f} E {lat:.4f} N"
        )
    if trial.merge_m > gap_m:
        notes.append(
            f"to meet the vertex budget, islets were merged across up to {trial.merge_m:.0f} m and "
            f"the coast lies up to {trial.tolerance_m:.0f} m off the merged land"
        )
    return tuple(notes)
