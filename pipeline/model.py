"""The typed artefacts that pass between the stages; each is frozen, and nothing else passes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    import numpy.typing as npt
    from shapely.geometry import Polygon
    from shapely.geometry.base import BaseGeometry

    import renew
    from pipeline.geo.projection import Projection

    FloatArray = npt.NDArray[np.float64]
    Current = renew.GriddedCurrent | renew.GyreCurrent | renew.UniformCurrent

RouteKey = tuple[str, int]
"""A route's name inside a scenario: (season, rank), rank 1 being the best."""


@dataclass(frozen=True, slots=True)
class Credit:
    """Which source was used, and the line its licence asks for."""

    name: str
    kind: Literal["land", "current"]
    text: str
    licence: str
    url: str = ""
    retrieved: str = ""


@dataclass(frozen=True, slots=True)
class Zone:
    """An area of a chart that a reader wants to see (lon/lat degrees).

    A `shoal` is too shallow for the vessel, and no source covers what is `uncharted`: both are
    no-go, so they are among the polygons of their Land as well. A `restricted` area and a `traffic`
    scheme may be entered; `rule` says what holds there for a passing vessel, where the chart does.
    """

    kind: Literal["shoal", "uncharted", "restricted", "traffic"]
    name: str
    rule: str
    area: BaseGeometry


@dataclass(frozen=True, slots=True)
class Land:
    """What no route may enter (lon/lat degrees), clipped to the region and a little beyond.

    Land; from charts with depths, also water that is too shallow, hazards, and what no chart
    covers. `accuracy_m` is how far the source's coast may lie from the true one, in metres;
    `credits` has one for each source, `notes` what a reader should know of the chart, and `zones`
    what the chart shows beside.
    """

    polygons: tuple[Polygon, ...]
    credits: tuple[Credit, ...]
    accuracy_m: float
    notes: tuple[str, ...] = ()
    zones: tuple[Zone, ...] = ()


@dataclass(frozen=True, slots=True)
class CurrentGrid:
    """A season's surface current on a lon/lat grid.

    `lon` (nx,) and `lat` (ny,) ascend, in degrees; `u` (east) and `v` (north) are (ny, nx) in m/s,
    NaN where the source has no water. `valid` says which time the figures stand for, `notes` what
    a reader should know of them, and `files` names those that they came from, with their hashes.
    """

    season: str
    lon: FloatArray
    lat: FloatArray
    u: FloatArray
    v: FloatArray
    valid: str
    credit: Credit
    notes: tuple[str, ...] = ()
    files: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Fetched:
    """What the sources gave: land, and one current grid a season.

    `currents` is empty for a planar scenario, whose current is given as figures in the scenario.
    `notes` says in plain words which preferred source was passed over and why, and what there is
    to know of those that were used.
    """

    land: Land
    currents: tuple[CurrentGrid, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Simplified:
    """What the planner treats as hard no-go (lon/lat degrees); it covers all of the land."""

    polygons: tuple[Polygon, ...]
    original_vertices: int
    vertices: int
    tolerance_m: float
    joined_gap_m: float
    margin_m: float


@dataclass(frozen=True, slots=True)
class Scene:
    """The planner's world: planar metres divided by the scenario's scale, speeds unscaled.

    `land` is the original, unsimplified land; `currents` is keyed by season; `start` and `goal`
    are (2,).
    """

    chart: renew.Chart
    land: tuple[Polygon, ...]
    currents: Mapping[str, Current]
    start: FloatArray
    goal: FloatArray
    projection: Projection
    vessel: renew.Vessel


@dataclass(frozen=True, slots=True)
class SeasonPlan:
    """One season's plan; `failure` is empty when it was planned, else the reason in one line."""

    season: str
    plan: renew.Plan | None
    failure: str
    seconds: float


@dataclass(frozen=True, slots=True)
class RouteMetrics:
    """One route's figures, judged against the original land.

    `length`, `fuel` and `fuel_per_distance` are the planner's own (scaled); `length_m` is true
    geodesic metres, `clearance_m` true metres to the original land, `duration_s` at true scale.
    `trials` and `collisions` count hard-over turns and those that met original land; `land_m` is
    metres over land. `side` is the side on which it passes the largest island between start and
    goal.
    """

    season: str
    rank: int
    homotopy: str
    fuel: float
    fuel_per_distance: float
    length: float
    length_m: float
    clearance_m: float
    duration_s: float
    optimality_gap: float
    trials: int
    collisions: int
    land_m: float
    side: str


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Every planned route's figures, and its hard-over turns by (season, rank).

    The turns are all counted; of the places where none met land some thousand are kept a route.
    """

    routes: tuple[RouteMetrics, ...]
    contingency: Mapping[RouteKey, renew.Contingency]
