"""Third stage: project everything into the planner's plane, in metres divided by the scale.

Speeds are not scaled. Current vectors are rotated by the meridian convergence. Gaps in a current,
such as land, are filled from the water around them: a zero there would distort interpolated values
near the coast. A current's members come from its source, or are the current with eddies.
"""

import itertools
from dataclasses import replace

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.geo.projection import METRES_PER_DEGREE, Projection, rotated
from pipeline.machine.store import Artefact, Store
from pipeline.model import (
    Case,
    Current,
    CurrentGrid,
    Fetched,
    Land,
    MemberCurrents,
    SimplifiedLand,
    SpeedChoice,
    VoyageBefore,
    Water,
    planner_vessel,
)
from pipeline.model.inputs import bilinear
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import MembersSpec
from pipeline.sources.land.shapes import BEYOND_M, in_plane
from pipeline.sources.tide_stations import stations_of
from pipeline.stages import places
from pipeline.stages.lanes import kept_lanes
from pipeline.stages.limits import limited_fields, over_limits

# Maximum sag of the region's edges as a share of its diagonal: an edge that is straight in degrees
# is curved in the plane. An edge is halved only until it sags less, and at most _MAX_HALVINGS
# times, because each corner becomes a vertex of the triangulation. Nor may it sag as far as land is
# fetched beyond the region: in between, land would be water.
_MAX_SAG = 2e-3
_MAX_HALVINGS = 6
# Nodes of the planner's current per cell of the source, along each axis; see `planar_current`.
_NODES_PER_CELL = 2
# Node spacing is limited as if no cell were narrower than its height divided by this number,
# because cells become too narrow near a pole.
_MAX_ASPECT = 4


def projected(
    scenario: Scenario,
    fetched: Fetched,
    land: Artefact[SimplifiedLand],
    store: Store,
    before: VoyageBefore | None = None,
) -> Artefact[tuple[Case, ...]]:
    """Build a scenario's cases, or load them from the store.

    With a voyage `before`, the keys of the currents depend on it, too. Raises RequestError for the
    reasons of `project`, or if the no-go zone leaves no water.
    """

    def make() -> tuple[Case, ...]:
        try:
            made = project(scenario, fetched, land.value)
        except renew.PlanningError as error:
            raise RequestError(str(error)) from error
        return tuple(replace(case, before=before) for case in made)

    speeds = [SpeedChoice.of(season) for season in scenario.seasons]
    inputs = land.key, dict(fetched.current_keys), scene_inputs(scenario), speeds
    return store.artefact("project", tuple, inputs, make)


def scene_inputs(scenario: Scenario) -> dict[str, object]:
    """Return the scenario's values that its cases depend on, except chart, currents and speeds."""
    names = {"region", "plane", "vessel", "scale", "start", "goal", "via"}
    inputs = scenario.model_dump(mode="json", include=names)
    members = [season.members for season in scenario.seasons]
    if any(members):
        inputs |= {"members": members, "seed": scenario.planner.seed}
    if not scenario.avoid and scenario.tide is None and scenario.limits is None:
        return inputs
    clocks = {season.name: season.first_departure for season in scenario.seasons}
    tide = None if scenario.tide is None else (scenario.tide, stations_of(scenario.tide))
    datum = scenario.chart.datum
    avoid = [
        (one.model_dump(mode="json"), places.area_file(one).identity) for one in scenario.avoid
    ]
    return {**inputs, "avoid": avoid, "clocks": clocks, "tide": tide, "datum": datum}


def project(scenario: Scenario, fetched: Fetched, simplified: SimplifiedLand) -> tuple[Case, ...]:
    """Build a case for each season of the scenario that has a current.

    Raises RequestError if start or goal is on land, or they lie in different bodies of water; all
    faults are listed; renew.GeometryError if the no-go zone leaves no water.
    """
    water = water_of(scenario, fetched.land, simplified)
    grids = {grid.case: grid for grid in fetched.currents}
    shut = places.shut_polygons(scenario.avoid, fetched.land.zones, water.projection)
    tide = places.tidal_depth(scenario.tide, scenario.chart, fetched.land, simplified, water)
    has_hours = (
        scenario.tide is not None
        or scenario.limits is not None
        or any(area.has_hours for area in scenario.avoid)
    )
    stops = water.to_plane([*scenario.stops.values()])
    cases = []
    for season in scenario.seasons:
        grid = grids.get(season.name)
        if grid is None and not water.is_planar:
            continue
        if grid is None:
            current: Current = places.plane_current(season, water.chart.extent)
        else:
            current = planar_current(grid, water.projection, water.chart.bounds)
        grids_of = fetched.weather.get(season.name, {})
        weather = limited_fields(grids_of, scenario.weather_limits)
        leeway = None
        if wind := grids_of.get("leeway"):
            share = scenario.weather_limits.leeway or 0.0
            carried = replace(wind, u=share * wind.u, v=share * wind.v)
            leeway = planar_current(carried, water.projection, water.chart.bounds)
        vessel = planner_vessel(scenario.vessel_in(season))
        depends_on_date = season.is_changing or season.speed is not None or has_hours
        cases.append(
            Case(
                season.name,
                water,
                vessel,
                stops[0],
                stops[-1],
                current,
                via=stops[1:-1],
                current_cells=None if grid is None else grid.cells,
                departure=season.first_departure if depends_on_date else None,
                areas=(
                    *places.shut_areas(shut, season.first_departure),
                    *over_limits(weather, water.projection, water.chart.extent),
                ),
                weather=weather,
                leeway=leeway,
                tidal_depth=tide(season.first_departure),
                under_keel_clearance_m=scenario.chart.under_keel_clearance_m,
                speeds=SpeedChoice.of(season),
                lanes=kept_lanes(fetched.land.zones, scenario.planner, vessel.length),
                members=members_of(water, season.members, scenario.planner.seed, current, grid),
                power=scenario.vessel.power,
            )
        )
    return tuple(cases)


def water_of(scenario: Scenario, land: Land, simplified: SimplifiedLand) -> Water:
    """Build the chart in the plane; errors are those of `project`."""
    if scenario.plane is not None:
        return places.plane_water(scenario, scenario.plane)
    if scenario.region is None:
        raise ValueError("the region is chosen before")
    region = scenario.region.shape
    projection = Projection.for_region(region, scenario.scale)
    no_go, inner_land = (
        projection.geometry_to_plane(np.array(polygons, dtype=object))
        for polygons in (simplified.polygons, simplified.inner_polygons)
    )
    original, second_shore = (
        tuple(in_plane(polygons, projection)) for polygons in (land.polygons, land.second_shore)
    )
    extent = extent_polygon(region, projection)
    chart = renew.Chart(extent, no_go, land=inner_land, point_scale=projection.scale_at)
    water = Water(
        chart,
        original,
        projection,
        second_shore=second_shore,
        refused_m=land.refused_m,
        depths=land.depths,
        added_m=simplified.margin_m + simplified.tolerance_m,
    )
    places.check_endpoints(scenario, water)
    _ = chart.open_water  # worked out before it is stored: each case's bound needs it
    return water


def members_of(
    water: Water, spec: MembersSpec | None, seed: int, current: Current, grid: CurrentGrid | None
) -> MemberCurrents | None:
    """Return the members of a planar current, or None where it has none.

    `grid` is the current as its source has it; a plane has none.
    """
    bounds = water.chart.bounds
    if spec is None:
        return None
    if spec.spread is not None:
        return stirred(current, spec, bounds, water.projection.scale, seed)
    if grid is None or not grid.members:
        return None
    of_members = [replace(grid, u=one.u, v=one.v, members=()) for one in grid.members]
    fields = tuple(planar_current(one, water.projection, bounds) for one in of_members)
    weights = np.array([one.weight for one in grid.members])
    return MemberCurrents(tuple(one.name for one in grid.members), fields, weights, spec.choose)


def extent_polygon(region: shapely.Polygon, projection: Projection) -> shapely.Polygon:
    """Project a region, and divide the edges that would sag too much."""
    corners = shapely.get_coordinates(region.exterior)
    planar = projection.to_plane(corners)
    diagonal = float(np.hypot(*(planar.max(axis=0) - planar.min(axis=0))))
    allowed = min(_MAX_SAG * diagonal, BEYOND_M / 2 / projection.scale)
    ring: list[FloatArray] = []
    for begin, end in itertools.pairwise(corners):
        parts = 1
        while parts < 2**_MAX_HALVINGS and _sag(begin, end, parts, projection) > allowed:
            parts *= 2
        ring.append(projection.to_plane(_between(begin, end, parts)[:-1]))
    return shapely.Polygon(np.concatenate(ring))


def _between(begin: FloatArray, end: FloatArray, parts: int) -> FloatArray:
    """Return evenly spaced points (parts + 1, 2) from begin to end."""
    return begin + np.linspace(0, 1, parts + 1)[:, None] * (end - begin)


def _sag(begin: FloatArray, end: FloatArray, parts: int, projection: Projection) -> float:
    """Return the largest distance in the plane from the middle of an edge's part to its chord."""
    points = projection.to_plane(_between(begin, end, 2 * parts))
    return float(np.linalg.norm(points[1::2] - (points[:-1:2] + points[2::2]) / 2, axis=1).max())


def planar_current(
    grid: CurrentGrid, projection: Projection, bounds: tuple[float, float, float, float]
) -> renew.GriddedCurrent | renew.VaryingCurrent:
    """Resample a lon/lat current to a planar grid over bounds (xmin, ymin, xmax, ymax), metres.

    Times of a changing current are seconds since departure. Vectors (m/s) are rotated to the
    plane's axes. The node spacing is half a cell of the source, so that the variation of the
    current within a triangle equals that of the source to within 10 % on real fields.
    """
    xmin, ymin, xmax, ymax = bounds
    step = _cell_m(grid) / _NODES_PER_CELL / projection.scale
    x = np.linspace(xmin, xmax, max(2, int(np.ceil((xmax - xmin) / step)) + 1))
    y = np.linspace(ymin, ymax, max(2, int(np.ceil((ymax - ymin) / step)) + 1))
    lonlat = projection.to_lonlat(np.stack(np.meshgrid(x, y), axis=-1))
    rotation_rad = projection.rotation_rad(lonlat)
    slices = []
    for step in range(len(grid.times_s)):
        uv = rotated(bilinear(grid, lonlat, step), rotation_rad)
        slices.append(renew.GriddedCurrent(x, y, uv[..., 0], uv[..., 1]))
    return renew.VaryingCurrent(grid.times_s, slices) if grid.changes else slices[0]


def _cell_m(grid: CurrentGrid) -> float:
    """Return the shorter side of a source's cell in true metres, limited by _MAX_ASPECT."""
    up = float(np.diff(grid.lat).min())
    across = float(np.diff(grid.lon).min() * np.cos(np.radians(grid.lat.mean())))
    return max(min(up, across), up / _MAX_ASPECT) * METRES_PER_DEGREE


# Number of waves of the eddies of a member.
_WAVES = 12
# Number of nodes along a side for a current that has none of its own.
_NODES = 101
# Least and largest wave number of the eddies, as shares of the one asked for.
_SHARES = (0.6, 1.4)
# Number of nodes to a wave.
_NODES_A_WAVE = 8
# Largest number of nodes along a side.
_MAX_NODES = 600


def stirred(
    base: Current,
    spec: MembersSpec,
    bounds: tuple[float, float, float, float],
    scale: float,
    seed: int,
) -> MemberCurrents:
    """Return members around a planar current: the current, with eddies whose mean is zero.

    Each member's eddies are a seeded stream function of random waves. The rms speed of all is that
    of the `spread`, over (xmin, ymin, xmax, ymax), planar metres.
    """
    length = 1000 * spec.eddy_km / scale
    x, y = (_finer(axis, length / _NODES_A_WAVE) for axis in _nodes(base, bounds))
    if max(x.size, y.size) > _MAX_NODES:
        raise RequestError(
            f"members.eddy_km = {spec.eddy_km:g} is too short for a region of this size: it would "
            f"take {max(x.size, y.size):,} nodes along a side, more than {_MAX_NODES:,}; raise it"
        )
    points, rng = np.stack(np.meshgrid(x, y), axis=-1), np.random.default_rng(seed)
    eddies = np.empty((spec.count, *points.shape))
    for one in eddies:
        number = 2 * np.pi / length * rng.uniform(*_SHARES, _WAVES)
        course = rng.uniform(0, 2 * np.pi, _WAVES)
        waves = np.column_stack([np.cos(course), np.sin(course)]) * number[:, None]
        slope = np.cos(points @ waves.T + rng.uniform(0, 2 * np.pi, _WAVES))
        one[:] = np.stack([slope @ waves[:, 1], -(slope @ waves[:, 0])], axis=-1)
    eddies -= eddies.mean(axis=0)
    eddies *= (spec.spread or 0.0) / np.sqrt((eddies**2).sum(axis=-1).mean())
    names = tuple(f"eddies {number}" for number in range(1, spec.count + 1))
    return MemberCurrents(names, tuple(_plus(base, x, y, one) for one in eddies), None, spec.choose)


def _nodes(
    base: Current, bounds: tuple[float, float, float, float]
) -> tuple[FloatArray, FloatArray]:
    """Return the nodes (nx,) and (ny,) of a current, or some over the bounds."""
    slices = base.slices if isinstance(base, renew.VaryingCurrent) else (base,)
    if isinstance(slices[0], renew.GriddedCurrent):
        return slices[0].x, slices[0].y
    xmin, ymin, xmax, ymax = bounds
    return np.linspace(xmin, xmax, _NODES), np.linspace(ymin, ymax, _NODES)


def _finer(axis: FloatArray, step: float) -> FloatArray:
    """Divide the steps of an axis evenly, until none is longer than `step`.

    A current that is bilinear between the old nodes stays as it is.
    """
    parts = int(np.ceil(float(np.diff(axis).max()) / step))
    return np.interp(np.arange(parts * (axis.size - 1) + 1) / parts, np.arange(axis.size), axis)


def _plus(base: renew.CurrentField, x: FloatArray, y: FloatArray, eddies: FloatArray) -> Current:
    """Return a current with eddies (ny, nx, 2), m/s, added at nodes; they don't change."""
    if isinstance(base, renew.VaryingCurrent):
        slices = [_plus(one, x, y, eddies) for one in base.slices]
        return renew.VaryingCurrent(base.slice_times, slices)
    u, v = np.moveaxis(base(np.stack(np.meshgrid(x, y), axis=-1)) + eddies, -1, 0)
    return renew.GriddedCurrent(x, y, u, v)
