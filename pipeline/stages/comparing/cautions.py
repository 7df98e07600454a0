"""Notes on doubtful routes: overpowering currents, a second shoreline, unresolved straits."""

import itertools
from collections.abc import Iterable, Iterator
from datetime import datetime, timedelta
from itertools import pairwise

import numpy as np
import shapely

import renew
from pipeline._types import BoolArray, FloatArray
from pipeline.formats.shared.result import RunResult
from pipeline.geo.lonlat import METRES_PER_DEGREE
from pipeline.model import CurrentGrid, Note, Place, Scene, SeasonPlan, ShoreCrossing

# Time step for the interpolation of a changing current, s.
_STEP_S = 300.0
# Minimum length of a crossing, true metres: a shorter one only grazes the shore.
_LEAST_M = 1.0
# Minimum number of cells across a strait for the grid to resolve its tide.
_MIN_CELLS = 2.0
# A point within this distance of a coast counts as on it, planar metres.
_ON_COAST = 1e-6


def overpowering_notes(
    grid: CurrentGrid, region: shapely.Polygon, speed_m_s: float, departure: datetime | None = None
) -> Iterator[Note]:
    """Yield notes on the share of a region's water with an overpowering current, and its maximum.

    The region is in lon/lat degrees, the vessel's speed through water in m/s. `departure` is the
    first departure, from which the current's times are counted. If a changing current overpowers
    the vessel only for some hours, the note lists them.
    """
    lon, lat = np.meshgrid(grid.lon, grid.lat)
    strength = np.hypot(grid.u, grid.v)
    is_water = np.isfinite(strength[0]) & shapely.contains_xy(region, lon, lat)
    always = is_water & (strength.min(axis=0) >= speed_m_s)
    sometimes = is_water & (strength.max(axis=0) >= speed_m_s) & ~always
    for kind, cells in (("water-shut", always), ("water-shut-for-hours", sometimes)):
        if not cells.any() or (cells is sometimes and departure is None):
            continue
        (row, column), most_m_s = _worst(grid, cells)
        yield Note.of(
            kind,
            share=_share(cells, is_water, lat),
            speed_m_s=speed_m_s,
            most_m_s=most_m_s,
            place=Place(float(grid.lon[column]), float(grid.lat[row])),
            hours=tuple(
                tuple(departure + timedelta(seconds=end) for end in spell)
                for spell in _spells(grid, (row, column), speed_m_s)
            )
            if departure
            else (),
        ).about(grid.season)


def waiting_notes(scene: Scene, plans: Iterable[SeasonPlan]) -> Iterator[Note]:
    """Yield notes on the hours when the current blocks ways of routes or of rejected classes."""
    for plan in plans:
        routes = {f"route {rank}": one for rank, one in enumerate(plan.ranked_routes, start=1)}
        rejected = plan.plan.rejected if plan.plan else ()
        classes = {f"class {one.homotopy}": one for one in rejected}
        for kind, ways in (("routes-shut-for-hours", routes), ("classes-shut-for-hours", classes)):
            shut = tuple(
                Note.of("way-shut", way=name, places=_places(one.overpowered, scene, plan.season))
                for name, one in ways.items()
                if one.overpowered
            )
            if shut:
                yield Note.of(kind, ways=shut).about(plan.season)


def _places(hours: Iterable[renew.OverpoweredHours], scene: Scene, season: str) -> tuple[Note, ...]:
    """Return the places where the current blocks a way, each with its hours."""
    return tuple(
        Note.of(
            "place-shut",
            place=scene.place(one.place),
            begin=scene.moment(season, one.begin),
            until=scene.moment(season, one.end),
        )
        for one in hours
    )


def _share(some: BoolArray, water: BoolArray, lat: FloatArray) -> float:
    """Return the share of the water's area in some cells; a cell's width scales with cos(lat)."""
    area = np.cos(np.radians(lat))
    return float(area[some].sum() / area[water].sum())


def _worst(grid: CurrentGrid, among: BoolArray) -> tuple[tuple[int, int], float]:
    """Return the node (row, column) in `among` with the strongest current, and its speed, m/s."""
    strongest = np.where(among, np.hypot(grid.u, grid.v).max(axis=0), -1.0)
    row, column = np.unravel_index(np.argmax(strongest), strongest.shape)
    return (int(row), int(column)), float(strongest[row, column])


def _spells(
    grid: CurrentGrid, where: tuple[int, int], speed_m_s: float
) -> Iterator[tuple[float, float]]:
    """Yield begin and end, s since departure, of periods when the node's current is too fast."""
    times = np.arange(max(0.0, grid.times_s[0]), grid.times_s[-1] + _STEP_S / 2, _STEP_S)
    row, column = where
    u, v = (np.interp(times, grid.times_s, part[:, row, column]) for part in (grid.u, grid.v))
    is_shut = np.concatenate([[False], np.hypot(u, v) >= speed_m_s, [False]])
    turns = np.flatnonzero(np.diff(is_shut)).tolist()
    last = len(times) - 1
    for first, end in list(pairwise(turns))[::2]:
        yield float(times[first]), float(times[min(end, last)])


class SecondShoreline:
    """The land of a scene's second shoreline, with a spatial index.

    This shoreline, GSHHG, is older and in places coarser. A route that crosses its land may be
    right, but the crossing is a reason to check an official chart.
    """

    def __init__(self, scene: Scene) -> None:
        self._projection = scene.projection
        self._shore = np.array(scene.second_shore, dtype=object)
        self._tree = shapely.STRtree(self._shore)

    def crossings(self, path: FloatArray, season: str, rank: int) -> tuple[ShoreCrossing, ...]:
        """Return where a path (n, 2), planar metres, crosses the second shoreline's land."""
        line = shapely.LineString(path)
        # Polygons that are valid in degrees may be invalid in the plane.
        crossed = shapely.make_valid(self._shore[self._tree.query(line, predicate="intersects")])
        over = shapely.get_parts(shapely.intersection(line, shapely.union_all(crossed)))
        found = []
        for part in over:
            length_m = self._projection.geodesic_length_m(shapely.get_coordinates(part))
            if length_m >= _LEAST_M:
                middle = shapely.line_interpolate_point(part, 0.5, normalized=True)
                lon, lat = self._projection.to_lonlat(shapely.get_coordinates(middle)[0])
                found.append(ShoreCrossing(season, rank, float(lon), float(lat), length_m))
        return tuple(found)


def unresolved_strait_notes(result: RunResult) -> Iterator[Note]:
    """Yield a note for each season's best route on the worst strait with an unresolved tide."""
    for grid in result.fetched.currents:
        if not grid.changes:
            continue
        for best in result.season_routes(grid.season)[:1]:
            straits = [
                (width_m * _MIN_CELLS / cell, width_m, cell, middle)
                for width_m, middle in straits_of(best.route, result.scene)
                if (cell := _cell_m(grid, middle[1])) * _MIN_CELLS > width_m
            ]
            if straits:
                _, width_m, cell, middle = min(straits, key=lambda one: one[0])
                yield Note.of(
                    "strait-unresolved", place=Place(*middle), width_m=width_m, cell_m=cell
                ).about(grid.season)


def straits_of(route: renew.Route, scene: Scene) -> Iterator[tuple[float, tuple[float, float]]]:
    """Yield the straits on a route: true width (m), and the middle (lon, lat), degrees.

    A strait is a triangle's side that the route crosses and that joins two islands.
    """
    if not scene.chart.no_go:
        return
    coasts = shapely.STRtree(scene.chart.no_go)
    channel = route.channel
    for here, ahead in itertools.pairwise(channel):
        side = here[(here[:, None] == ahead[None]).all(axis=-1).any(axis=1)]
        if len(side) != 2:
            continue
        end, coast = coasts.query(shapely.points(side), predicate="dwithin", distance=_ON_COAST)
        one, other = (set(coast[end == i].tolist()) for i in (0, 1))
        if one and other and not one & other:
            lon, lat = scene.projection.to_lonlat(side.mean(axis=0)).tolist()
            yield scene.projection.geodesic_length_m(side), (lon, lat)


def _cell_m(grid: CurrentGrid, lat: float) -> float:
    """Return the longer side of a cell at a latitude, true metres."""
    across = float(np.median(np.diff(grid.lon)) * np.cos(np.radians(lat)))
    return max(across, float(np.median(np.diff(grid.lat)))) * METRES_PER_DEGREE
