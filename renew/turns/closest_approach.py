"""Where a route comes nearest to land, and how far hard-over turns reach there."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import shapely

from renew._types import FloatArray
from renew.errors import check_kind
from renew.inputs.chart_and_vessel import Vessel
from renew.inputs.current import CurrentLike, as_field
from renew.inputs.options import check_seed
from renew.results import Route
from renew.turns.turn_reach import TurnSampler, TurnsAtEdges, normals_away

# Number of draws: enough for a smooth picture.
_DRAWS = 4096


class Tightest(NamedTuple):
    """The place of a route that is nearest to a padded edge.

    Attributes
    ----------
    point : (2,) metres, on the route.
    edge : (2, 2) metres, the constrained edge nearest to it.
    heading : rad, of the route there.
    padding : of the edge (m).
    turns : the padding that hard-over turns need there (m); `padding` is wider by a clearance.
    gap : from the point to the edge (m).
    reaches : (n,) m, how far hard-over turns from there reach towards the edge, the worse of both
        sides, at the speed sailed there, in draws of the current in the triangle and of headings
        about this one.
    """

    point: FloatArray
    edge: FloatArray
    heading: float
    padding: float
    turns: float
    gap: float
    reaches: FloatArray


def tightest(
    route: Route, current: CurrentLike, vessel: Vessel, *, seed: int = 0
) -> Tightest | None:
    """Find where a route is nearest to land and draw the reach of turns there.

    Parameters
    ----------
    route : Route
        As planned.
    current : CurrentField or callable
        The current in which it was planned.
    vessel : Vessel
        The vessel for which it was planned.
    seed : int
        Seed of the draws.

    Returns
    -------
    Tightest or None
        Edges whose padding reaches over the start or the goal are left out, as harbours lie there.
        None where no other edge is padded.
    """
    check_kind("route", route, Route)
    check_kind("vessel", vessel, Vessel)
    check_seed(seed)
    field = as_field(current)
    edges, padding = route.padding_used[:, :4].reshape(-1, 2, 2), route.padding_used[:, 4]
    lines = shapely.linestrings(edges)
    endpoints = shapely.points(route.path[[0, -1]])
    padded = (padding > 0) & (shapely.distance(lines[:, None], endpoints) >= padding[:, None]).all(
        axis=1
    )
    if not padded.any():
        return None
    way = shapely.LineString(route.path)
    gaps = np.where(padded, shapely.distance(lines, way), np.inf)
    # Of an edge and its pieces, whose padding is for a clearance, the one with the widest padding.
    nearest = int(np.lexsort((-padding, np.round(gaps, 9)))[0])
    on_way = shapely.get_point(shapely.shortest_line(way, lines[nearest]), 0)
    along = float(shapely.line_locate_point(way, on_way))
    point = shapely.get_coordinates(shapely.line_interpolate_point(way, along))[0]
    passed = np.cumsum(np.linalg.norm(np.diff(route.path, axis=0), axis=1))
    leg = min(int(np.searchsorted(passed, along)), len(passed) - 1)
    east, north = route.path[leg + 1] - route.path[leg]
    course = np.arctan2(north, east)
    triangles = shapely.polygons(route.corners)
    inside = int(shapely.distance(triangles, shapely.Point(point)).argmin())
    when = np.interp(along, np.concatenate([[0.0], passed]), route.times)
    asked = TurnsAtEdges(
        field.statistics(route.corners[[inside]], np.array([[when, when + vessel.turn_period]])),
        np.array([course]),
        np.zeros(1, dtype=np.int64),
        normals_away(edges[[nearest]], point[None]),
        replace(vessel, speed=float(route.speeds[leg])),
    )
    return Tightest(
        point=point,
        edge=edges[nearest],
        heading=float(course),
        padding=float(padding[nearest]),
        turns=float(route.turn_padding[nearest]),
        gap=float(gaps[nearest]),
        reaches=TurnSampler(seed, _DRAWS).reaches(asked)[0],
    )
