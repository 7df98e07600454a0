"""Second stage: land of a hundred thousand vertices becomes some hundred, and none is uncovered.

In true metres, in the plane that is centred on the region:

1. *margin*: every coast grows by the margin (and by what the first thinning may cut);
2. *join* (:mod:`pipeline.geo.coast.close_gaps`): gaps that no route could pass, pools and lakes
   become land;
3. *outward* (:mod:`pipeline.geo.coast.covering_simplify`): vertices go, land is only ever added;
4. while there are more vertices than the budget allows, islets are merged with their neighbours and
   the tolerance grows;
5. what came out is checked: valid, no two polygons touch, all of the land is covered.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.errors import RequestError, StageError
from pipeline.geo.coast.close_gaps import Joined, join
from pipeline.geo.coast.covering_simplify import Keep, count_vertices, simplify_outward
from pipeline.geo.projection import Projection
from pipeline.model import Simplified

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt
    from shapely.geometry import Polygon
    from shapely.geometry.base import BaseGeometry

    FloatArray = npt.NDArray[np.float64]
    Geometries = npt.NDArray[np.object_]

# Long edges are cut to this before they are projected: what is straight in degrees is bent in the
# plane, by 1.3 m for 5 km at 70 degrees of latitude.
_EDGE_M = 5_000.0
# The first thinning cuts no more than this share of the tolerance and of the gap: it costs little
# water and spares the triangulation half of its vertices.
_THINNING = 1 / 20
# Land runs over the region's edge by this share of its diagonal: more than the edge can be off,
# whichever way another stage cuts a bent edge into straight ones.
_OVERRUN = 3e-3
# Added to the margin, as a share of the region's diagonal (1 m to 1,000 km), so that no rounding of
# coordinates on the way to degrees and back uncovers anything.
_ROUNDING = 1e-6
# From trial to trial the tolerance grows by as much as the vertices are too many (they fall a
# little slower than it grows), within these factors, up to this share of the region's diagonal.
_LEAST_GROWTH, _MOST_GROWTH = 1.2, 3.0
_LARGEST_TOLERANCE = 1 / 50
# Islets are merged across gaps up to this many times the tolerance: of the pairs that come to
# one budget about the least water is lost so (tried on Palawan).
_MERGE = 1.5
# A point to be kept has this share of the gap, or of an opening's width, to itself on every side.
_CLEAR = 1 / 4
# Corners of a buffer are mitred: one vertex instead of an arc, outside of the circle, by no more
# than the limit. GEOS first thins its line by some 1 % of the radius: that grows by twice as much.
_MITRE_LIMIT = 1.3
_RADIUS = 1.02
# Where no gap is asked for, polygons come no nearer to each other than this.
_LEAST_APART_M = 1.0
# Land that may seem uncovered where two polygons share an edge (m²): rounding.
_UNCOVERED_M2 = 1.0


@dataclass(frozen=True, slots=True)
class SimplifiedLand:
    """The stage's artefact, and what happened on the way.

    `added` is the share by which the land's area in the region grew; `notes` say in plain words
    which passages were left open for the start's and the goal's sake, and what merged.
    """

    simplified: Simplified
    added: float
    notes: tuple[str, ...]


def simplify_land(
    polygons: Sequence[Polygon],
    region: Polygon,
    *,
    margin_m: float | None,
    join_gap_m: float,
    tolerance_m: float,
    vertex_budget: int,
    accuracy_m: float = 0.0,
    keep_water: Sequence[tuple[float, float]] = (),
    projection: Projection | None = None,
) -> SimplifiedLand:
    """Cover land by few polygons of few vertices.

    Parameters
    ----------
    polygons
        Land near the region, lon/lat degrees; may overlap, and be invalid.
    region
        Lon/lat degrees. Land that meets its edge runs a little over it in the result.
    margin_m
        True metres added to every coast: no less than the land's accuracy, and just that by default
        (None).
    join_gap_m
        Gaps narrower than this (true metres) become land.
    tolerance_m
        How far the coast may stand off the joined land (true metres); grows while there are more
        vertices than `vertex_budget`.
    accuracy_m
        How far the coast may be off (true metres).
    keep_water
        Start, goal: points (lon, lat) that must stay in water, and joined if they are. The widest
        way between them is left open where it is narrower than the gap.
    projection
        The plane in which the planner will join the vertices by straight lines; by default the
        region's own.

    Returns
    -------
    SimplifiedLand
        Its polygons are valid, have no point in common, and cover all land inside the region.

    Raises
    ------
    RequestError
        The budget can't be met; the message says how many vertices would do.
    StageError
        The result failed a check.
    """
    notes = []
    if margin_m is not None and margin_m < accuracy_m:
        notes.append(
            f"chart.margin_m is {margin_m:g} m, below the {accuracy_m:g} m by which the coast may "
            f"be off: {accuracy_m:g} m were added"
        )
    margin_m = max(margin_m or 0.0, accuracy_m)
    plane = replace(projection or Projection.for_region(region), scale=1.0)
    extent = plane.geometry_to_plane(region, _EDGE_M)
    diagonal = math.hypot(extent.bounds[2] - extent.bounds[0], extent.bounds[3] - extent.bounds[1])
    overrun = max(_OVERRUN * diagonal, 2 * margin_m)
    original = _planar_land(polygons, plane, extent.buffer(overrun + 2 * margin_m + join_gap_m))
    keep = plane.to_plane(np.array(keep_water, dtype=np.float64).reshape(-1, 2))
    stretch = max(1.0, float(plane.point_scale(shapely.get_coordinates(region)).max()))
    whole = shapely.intersection(shapely.disjoint_subset_union_all(original), extent)
    margin = margin_m * stretch + _ROUNDING * diagonal
    thinning = _THINNING * (min(join_gap_m, tolerance_m) if join_gap_m > 0 else tolerance_m)
    land = grown(original, margin, thinning, keep)
    if not _meet(land, extent, keep) and _meet(whole, extent, keep):
        # The thinning is for speed only: it may not close a harbour. The margin may.
        land = grown(original, margin, 0.0, keep)
        if not _meet(land, extent, keep):
            notes.append(
                f"the margin of {margin_m:g} m closes every way between start and goal: lower "
                "chart.margin_m"
            )
    search = _Search(extent, keep, join_gap_m, overrun)
    trial = search.within(land, tolerance_m, vertex_budget, _LARGEST_TOLERANCE * diagonal)
    check(trial.polygons, whole, keep)
    vertices = count_vertices(trial.polygons)
    simplified = Simplified(
        polygons=tuple(plane.geometry_to_lonlat(trial.polygons).tolist()),
        original_vertices=count_vertices(original),
        vertices=vertices,
        tolerance_m=trial.tolerance_m,
        joined_gap_m=join_gap_m,
        margin_m=margin_m,
    )
    covered = shapely.area(shapely.intersection(trial.polygons, extent)).sum()
    added = float(covered / whole.area - 1) if whole.area else 0.0
    return SimplifiedLand(simplified, added, (*notes, *_notes(trial, join_gap_m, plane)))


def grown(
    polygons: Geometries, margin_m: float, thinning_m: float, keep: FloatArray
) -> BaseGeometry:
    """Grow land by a margin (planar metres), thinned by up to `thinning_m` that is covered again.

    Near a point to be kept that the margin would swallow, half of its distance from land is left.
    """
    # Half of the thinning before the buffer, whose time it saves, and half after it.
    radius = (margin_m + thinning_m) * _RADIUS
    thin = shapely.simplify(polygons, thinning_m / 2)
    land = shapely.disjoint_subset_union_all(
        shapely.buffer(thin, radius, join_style="mitre", mitre_limit=_MITRE_LIMIT)
    )
    if thinning_m > 0:
        thin = shapely.get_parts(shapely.simplify(land, thinning_m / 2))
        land = shapely.disjoint_subset_union_all(thin)
    tree = shapely.STRtree(polygons)
    for point in shapely.points(keep):
        if not shapely.intersects(land, point):
            continue
        around = shapely.buffer(point, 3 * radius)
        near = polygons[tree.query(around, predicate="intersects")]
        least = shapely.distance(near, point).min() / 2
        bare = shapely.union_all(shapely.buffer(shapely.intersection(near, around), least))
        land = shapely.union(shapely.difference(land, around), shapely.intersection(bare, around))
    return land


def _meet(land: BaseGeometry, extent: Polygon, keep: FloatArray) -> bool:
    """Say whether one water outside the land holds all points (n, 2) to be kept."""
    waters = shapely.get_parts(shapely.difference(extent, land))
    holds = shapely.intersects(waters[:, None], shapely.points(keep))
    return bool(len(keep) < 2 or holds.all(axis=1).any())


def check(polygons: Geometries, land: BaseGeometry, keep: FloatArray) -> None:
    """Raise StageError unless polygons (planar) are valid, apart, cover the land and leave `keep`.

    `land` is one geometry; `keep` (n, 2) points, those of them that are in the land left out.
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
        bare = shapely.difference(land, shapely.union_all(polygons)).area
        if bare > _UNCOVERED_M2:
            faults.append(f"{bare:.0f} m² of land are uncovered")
        points = shapely.points(keep)
        points = points[~shapely.intersects(land, points)]
        swallowed = shapely.intersects(polygons[:, None], points).any(axis=0).sum()
        if swallowed:
            faults.append(f"{swallowed} of start and goal are covered by land")
    if faults:
        raise StageError(
            f"simplify: {' and '.join(faults)}: a fault of the program; try another "
            "chart.join_gap_m or chart.tolerance_m"
        )


@dataclass(frozen=True, slots=True)
class _Trial:
    """Polygons, the tolerance and the merging gap (m) that led to them, and what stayed open."""

    polygons: Geometries
    tolerance_m: float
    merge_m: float
    joined: Joined


@dataclass(frozen=True, slots=True)
class _Search:
    """Looks for the smallest tolerance that meets the budget."""

    extent: Polygon
    keep: FloatArray
    gap_m: float
    overrun_m: float

    def within(
        self, land: BaseGeometry, tolerance_m: float, budget: int, largest_m: float
    ) -> _Trial:
        """Return the first trial within the budget."""
        first = trial = self._trial(land, tolerance_m, 0.0)
        # A tolerance of nought has to grow from somewhere.
        tolerance = max(tolerance_m, largest_m / 1000)
        largest_m = max(largest_m, tolerance_m)
        while (count := count_vertices(trial.polygons)) > budget:
            if tolerance >= largest_m:
                # Trials between depend on the budget: another may not meet what one of them did.
                fewest = min(count, count_vertices(first.polygons))
                fault = (
                    f"chart.vertex_budget is {budget}, but {fewest} vertices are left at a "
                    f"tolerance of {tolerance / 1000:.1f} km, a fiftieth of the region: set it to "
                    f"{fewest} or more, or choose a smaller region"
                )
                raise RequestError([fault])
            growth = min(max(count / budget, _LEAST_GROWTH), _MOST_GROWTH)
            tolerance = min(tolerance * growth, largest_m)
            # Every trial starts from the first: errors don't add up from trial to trial.
            start = shapely.union_all(first.polygons)
            slack = tolerance - first.tolerance_m
            trial = self._trial(start, slack, _MERGE * tolerance, budget)
            trial = replace(trial, tolerance_m=tolerance)
        return trial

    def _trial(
        self, land: BaseGeometry, tolerance_m: float, merge_m: float, least: int = 0
    ) -> _Trial:
        """Join, then simplify outward down to `least` vertices."""
        joined = join(land, self.extent, self.gap_m, self.keep, self.overrun_m, merge_m)
        water = shapely.points(self.keep)
        room = shapely.distance(water, shapely.multipolygons(joined.polygons)) / 2
        keep = Keep(
            np.array([*water, *(opening.way for opening in joined.openings)], dtype=object),
            np.array(
                [
                    *np.minimum(room, _CLEAR * self.gap_m),
                    *(_CLEAR * min(o.width_m, max(self.gap_m, merge_m)) for o in joined.openings),
                ]
            ),
        )
        polygons = simplify_outward(
            joined.polygons,
            joined.polygons,
            tolerance_m,
            max(self.gap_m, _LEAST_APART_M),
            keep,
            least,
        )
        return _Trial(polygons, tolerance_m, merge_m, joined)


def _planar_land(polygons: Sequence[Polygon], plane: Projection, window: Polygon) -> Geometries:
    """Project the land, mend it, and leave out what lies outside the window."""
    # Mended before long edges are cut (that alone would drop half of a figure of eight), and after.
    degrees = _mended(np.array(polygons, dtype=object))
    planar = shapely.get_parts(_mended(plane.geometry_to_plane(degrees, _EDGE_M)))
    shapely.prepare(window)
    planar = planar[shapely.intersects(window, planar)]
    crossing = ~shapely.covers(window, planar)
    planar[crossing] = shapely.intersection(planar[crossing], window)
    parts = shapely.get_parts(planar)
    kind = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    return np.asarray(parts[kind & ~shapely.is_empty(parts)])


def _mended(polygons: Geometries) -> Geometries:
    """Make invalid polygons valid; they may become several."""
    unsound = ~shapely.is_valid(polygons)
    mended = polygons.copy()
    mended[unsound] = shapely.make_valid(
        polygons[unsound], method="structure", keep_collapsed=False
    )
    return mended


def _notes(trial: _Trial, gap_m: float, plane: Projection) -> tuple[str, ...]:
    """Say in plain words what the settings alone don't."""
    notes = []
    closed_m = max(gap_m, trial.merge_m)
    if reopened := [opening for opening in trial.joined.openings if opening.reopened]:
        narrowest = min(reopened, key=lambda opening: opening.width_m)
        lon, lat = plane.to_lonlat(narrowest.middle)
        notes.append(
            "start and goal meet only through water narrower than "
            f"{closed_m:.0f} m, which was left open; the narrowest passage has "
            f"{narrowest.width_m:.0f} m between the margins, at {lon:.4f} E {lat:.4f} N"
        )
    if trial.merge_m > gap_m:
        notes.append(
            f"to meet the vertex budget, islets were merged across up to {trial.merge_m:.0f} m and "
            f"the coast stands off the joined land by up to {trial.tolerance_m:.0f} m"
        )
    return tuple(notes)
