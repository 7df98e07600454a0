"""Find important straits of the original land that are shut by margin, tolerance or padding.

A strait is important on two conditions. The land on both sides is larger than a hundredth of the
distance between start and goal, so that a detour is longer by about as much. And the straight lines
from start and goal to the strait are together hardly longer than a season's best route. Wider
straits are added if adaptive padding fills them, so that the planner rejected classes.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely

from pipeline._types import FloatArray
from pipeline.geo.narrow_gaps import narrow_gaps
from pipeline.model import Scene, SeasonPlan, ShutStrait, Simplified, plan_options
from pipeline.scenario.model import PlannerOptions
from renew.errors import Strait

# Minimum size of the land on either side, as a share of the distance between start and goal.
_PART_SHARE = 0.01
# Largest length of the straight lines through a strait, in lengths of the best route: a much longer
# way would not need less fuel.
_LONGER = 1.05
# Largest distance of a bank from the original land, in sums of margin and tolerance.
_AT_LAND = 1.1
# Open width below which a gap is an artefact of rounding and not a way, true metres.
_NO_WATER_M = 1.0


def shut_straits(
    scene: Scene, simplified: Simplified, plans: Sequence[SeasonPlan], options: PlannerOptions
) -> tuple[ShutStrait, ...]:
    """Return the important shut straits, the widest first; a plane scenario has none."""
    best = [plan.ranked_routes[0].length for plan in plans if plan.ranked_routes]
    if scene.is_planar or not best:
        return ()
    radius = max(scene.vessel_in(plan.season).turning_radius for plan in plans)
    padding = plan_options(options).likely_width(radius)
    finder = _StraitFinder(scene, simplified, padding)
    found = [*finder.rejected(plans), *finder.shut(_LONGER * max(best))]
    return tuple(sorted(found, key=lambda strait: -strait.width_m))


@dataclass(frozen=True)
class _StraitFinder:
    """Finds the straits of one chart; lengths are planar metres, or true metres if named `_m`.

    `padding` is the width that nearly all paddings exceed.
    """

    scene: Scene
    simplified: Simplified
    padding: float

    @cached_property
    def _no_go(self) -> npt.NDArray[np.object_]:
        """The hard no-go zone: disjoint polygons."""
        return np.array(self.scene.chart.no_go, dtype=object)

    @cached_property
    def _tree(self) -> shapely.STRtree:
        """A spatial index of the hard no-go zone."""
        return shapely.STRtree(self._no_go)

    @property
    def margins_m(self) -> float:
        """The largest width that margin and tolerance take from a strait, true metres."""
        return 2 * (self.simplified.margin_m + self.simplified.tolerance_m)

    @property
    def needed_m(self) -> float:
        """The width above which a strait is open, true metres, unless its padding is very wide."""
        return self.margins_m + 2 * self.padding * self.scene.projection.scale

    def shut(self, longest: float) -> Iterator[ShutStrait]:
        """Yield the important shut straits that a route of at most this length can reach."""
        scene, scale = self.scene, self.scene.projection.scale
        land = np.array(scene.land, dtype=object)
        near = land[shapely.intersects(scene.chart.extent, land)]
        least = _PART_SHARE * float(np.linalg.norm(scene.goal - scene.start))
        for gap in narrow_gaps(near, self.needed_m / scale, self._is_shut):
            middle = gap.line.mean(axis=0)
            way = sum(np.linalg.norm(middle - end) for end in (scene.start, scene.goal))
            is_inside = shapely.intersects_xy(scene.chart.extent, *middle)
            if gap.part_m < least or way > longest or not is_inside:
                continue
            by_margin = self._open_water(gap.line) * scale <= _NO_WATER_M
            yield self._strait(
                middle,
                scene.projection.geodesic_length_m(gap.line),
                self.margins_m if by_margin else self.needed_m,
                is_margin=by_margin,
            )

    def rejected(self, plans: Iterable[SeasonPlan]) -> list[ShutStrait]:
        """Return the straits at which classes were rejected, each once with all its seasons.

        Only straits wider than `needed_m` are returned, as `shut` finds the narrower ones.
        """
        found: list[ShutStrait] = []
        for plan in plans:
            for one in plan.plan.rejected if plan.plan else ():
                strait = self._padded(one.strait, plan.season) if one.strait else None
                if strait is None or strait.width_m <= self.needed_m:
                    continue
                same = next(
                    (i for i, other in enumerate(found) if self._is_same(strait, other)), None
                )
                if same is None:
                    found.append(strait)
                else:
                    found[same] = _combined(found[same], strait)
        return found

    def _is_same(self, one: ShutStrait, other: ShutStrait) -> bool:
        """Whether two straits are nearer to each other than the larger width that they need."""
        apart_m = self.scene.projection.geodesic_length_m(
            self.scene.projection.to_plane([(one.lon, one.lat), (other.lon, other.lat)])
        )
        return apart_m <= max(one.needed_m, other.needed_m)

    def _padded(self, strait: Strait, season: str) -> ShutStrait | None:
        """Return the strait at which a season's class was rejected; None if a bank is not land.

        A planner's gap may end at a corner of its channel that has water beyond it.
        """
        land, projection = np.array(self.scene.land, dtype=object), self.scene.projection
        ends = shapely.points(strait.gap)
        _, to_land = shapely.STRtree(land).query_nearest(
            ends, return_distance=True, all_matches=False
        )
        if to_land.max() * projection.scale > _AT_LAND * self.margins_m / 2:
            return None
        taken_m = (strait.padding_left + strait.padding_right) * projection.scale
        width_m = projection.geodesic_length_m(strait.gap) + to_land.sum() * projection.scale
        return self._strait(
            strait.gap.mean(axis=0), width_m, self.margins_m + taken_m, is_margin=False,
            seasons=(season,),
        )  # fmt: skip

    def _strait(
        self,
        middle: FloatArray,
        width_m: float,
        needed_m: float,
        *,
        is_margin: bool,
        seasons: tuple[str, ...] = (),
    ) -> ShutStrait:
        """Return a strait whose middle is a planar point (2,)."""
        lon, lat = self.scene.projection.to_lonlat(middle).tolist()
        return ShutStrait(
            lon, lat, float(width_m), float(needed_m), "margin" if is_margin else "padding", seasons
        )

    def _is_shut(self, line: FloatArray) -> bool:
        """Whether margin, tolerance and padding leave no way through a gap (2, 2)."""
        scale = self.scene.projection.scale
        width = float(np.linalg.norm(line[1] - line[0]))
        # A gap narrower than margins and padding is shut; any other needs a test on the zone.
        if width * scale < 2 * self.simplified.margin_m + 2 * self.padding * scale:
            return True
        return self._open_water(line) <= max(2 * self.padding, _NO_WATER_M / scale)

    def _open_water(self, line: FloatArray) -> float:
        """Return the length of a line (2, 2) that is outside the hard no-go zone."""
        gap, no_go = shapely.LineString(line), self._no_go
        taken = [shapely.intersection(gap, no_go[i]).length for i in self._tree.query(gap)]
        return float(gap.length - sum(taken))


def _combined(one: ShutStrait, other: ShutStrait) -> ShutStrait:
    """Combine two records of one strait: the larger needed width, and the seasons of both."""
    seasons = tuple(dict.fromkeys((*one.seasons, *other.seasons)))
    return replace(max(one, other, key=lambda strait: strait.needed_m), seasons=seasons)
