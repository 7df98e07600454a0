"""Far sides of islands that a chosen region leaves out: their names, and what a way there needs.

A best route passes such an island on its near side. In a wider region with all of the island, the
near side is shut by a strip of land. The lower bound on fuel then holds for ways on the far side
(see :mod:`pipeline.stages.comparing.other_ways`). Islets are left out of the wider region's land:
that makes the bound no higher.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray
from pipeline.errors import PipelineError
from pipeline.formats.shared.result import RunResult
from pipeline.geo.lonlat import Bounds
from pipeline.geo.projection import Projection
from pipeline.machine.store import Made, Store
from pipeline.model import Note, Place, Scene, SeasonPlan
from pipeline.scenario.region import Region
from pipeline.sources.land.shapes import extract_polygons, repaired
from pipeline.stages.choosing.region_choice import FarSide
from pipeline.stages.choosing.water_grid import LonLat
from pipeline.stages.comparing.islands import island_places
from pipeline.stages.comparing.other_ways import fuel_elsewhere, strip_across
from pipeline.stages.fetch import fetch
from pipeline.stages.project import extent_polygon, planar_current
from renew.inputs.current import as_field

# Number of cells of the bound's grid, and width of the strip as a share of the square root of the
# region's area: three cells.
_CELLS = 16_000
_WIDTH = 3 / math.sqrt(_CELLS)


@dataclass(frozen=True, slots=True)
class BoundedSide:
    """A far side, the island's name or "", and a lower bound on fuel there.

    `fuel_ratio` is the bound in terms of the best route's fuel: the least of all seasons, NaN if
    there is no bound. Below 1 it is of no use to a reader.
    """

    side: FarSide
    name: str
    fuel_ratio: float

    @property
    def note(self) -> Note:
        """The note on it for a reader."""
        has_bound = self.fuel_ratio >= 1.0
        return Note.of(
            "side-left-out",
            island=self.name,
            place=Place(self.side.lon, self.side.lat),
            ratio=self.fuel_ratio if has_bound else self.side.ratio,
            of="fuel" if has_bound else "length",
        )


def bounded_sides(
    sides: Sequence[FarSide], made: Made[RunResult], store: Store
) -> tuple[BoundedSide, ...]:
    """Find names and lower bounds of far sides, in the currents that are on this machine."""
    if not sides:
        return ()

    def make() -> tuple[BoundedSide, ...]:
        # As a rule all sides were found in one search.
        scenes = {
            bounds: _wide_scene(bounds, made.value, store)
            for bounds in {side.searched for side in sides}
        }
        return tuple(_bounded(side, scenes[side.searched], made.value) for side in sides)

    return store.made("far-sides", tuple, (made.key, list(sides)), make).value


def are_on_both_sides(paths: Sequence[FloatArray], place: LonLat) -> bool:
    """Whether paths (n, 2) with the same ends pass a place on both sides, lon/lat degrees."""
    bearings = [np.unwrap(np.arctan2(*(path - place).T)) for path in paths]
    return bool(np.ptp([bearing[-1] - bearing[0] for bearing in bearings]) > math.pi)


def _bounded(side: FarSide, scene: Scene | None, result: RunResult) -> BoundedSide:
    """Find a far side's name and bound in a wide scene; neither without a scene."""
    if scene is None:
        return BoundedSide(side, "", math.nan)
    island = shapely.Point(scene.projection.to_plane(np.array([side.lon, side.lat])))
    ratios = [
        ratio for plan in result.plans for ratio in _fuel_ratio(side, island, plan, scene, result)
    ]
    return BoundedSide(side, _name(island, scene), min(ratios, default=math.nan))


def _wide_scene(bounds: Bounds, result: RunResult, store: Store) -> Scene | None:
    """Build a scene of the bounds in which far sides were found; None without their currents."""
    region = Region(bbox=bounds)
    wide = result.scenario.model_copy(update={"region": region})
    try:
        # A bound is no reason for a download.
        fetched = fetch(wide, store, offline=True).fetched
    except PipelineError:
        return None
    grids, used = fetched.currents, result.fetched.currents
    if {(one.season, one.credit) for one in grids} != {(one.season, one.credit) for one in used}:
        return None
    projection = Projection.for_region(region.shape, wide.scale)
    polygons = np.array(fetched.land.polygons, dtype=object)
    large = polygons[shapely.area(polygons) >= region.shape.area / _CELLS]
    land = extract_polygons(repaired(projection.geometry_to_plane(large))[0])
    chart = renew.Chart(extent_polygon(region.shape, projection), land)
    return replace(
        result.scene,
        chart=chart,
        land=tuple(land),
        currents={one.season: planar_current(one, projection, chart.bounds) for one in grids},
        start=projection.to_plane(wide.start),
        goal=projection.to_plane(wide.goal),
        projection=projection,
    )


def _name(island: shapely.Point, scene: Scene) -> str:
    """Return the catalogue's name of the island that holds a point, or ""."""
    outlines = [outline for outline in scene.land if outline.intersects(island)]
    for place in island_places(scene):
        point = shapely.Point(scene.projection.to_plane(np.array([place.lon, place.lat])))
        if shapely.intersects(outlines, point).any():
            return place.name
    return ""


def _fuel_ratio(
    side: FarSide, island: shapely.Point, plan: SeasonPlan, scene: Scene, result: RunResult
) -> Iterator[float]:
    """Yield a bound on fuel on an island's far side, in fuel of a season's best route.

    At one speed, no way takes less time than its length with the strongest current behind.
    """
    if not plan.ranked_routes or len(scene.via):
        return
    best = plan.ranked_routes[0]
    path = scene.projection.to_plane(result.scene.projection.to_lonlat(best.path))
    strip = strip_across(island, shapely.LineString(path), [], scene, _WIDTH)
    if strip is not None:
        fuel = fuel_elsewhere(strip, scene, plan, result.scenario.planner, (_CELLS,), math.inf)
        table = as_field(scene.currents[plan.season]).table(scene.chart.bounds)
        fastest = scene.vessel.speed + table.strongest
        seconds = side.length_m / scene.projection.scale / fastest
        is_at_one_speed = plan.season not in scene.speeds
        yield max(fuel / best.fuel, is_at_one_speed * seconds / best.duration)
