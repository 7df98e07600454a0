"""The chart, an extent of water with its hard no-go zone L; and the vessel that sails there."""

import copy
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from renew._compiled import for_kernels
from renew._types import FloatArray
from renew.errors import GeometryError, ParameterError, as_floats, is_number, shown
from renew.kernels.current_table import TRUE_METRES, metres_at
from renew.kernels.fuel_law import FuelLaw, efforts, spline_nodes

# Coordinates closer than this share of the extent's diagonal are one point. Snapping to this grid
# avoids slivers between an island and an extent that it touches. It is far below anything that a
# vessel could notice: 1 mm on 1,000 km.
_PRECISION = 1e-9
# Error of the nodes that stand for the point scale, as a share: far below that of any fuel.
_SCALE_ERROR = 1e-6
# Number of nodes along each side of the first lattice, and of the finest one.
_FIRST_NODES, _MOST_NODES = 5, 257


class Chart:
    """Extent and hard no-go zone in planar metres.

    Islands may overlap, touch each other or the extent, stick out of it, and have lakes; holes
    in the extent are land. The extent's own edge is the end of the chart, not a hazard.

    Parameters
    ----------
    extent : Polygon
        Where routes may go at all (m).
    no_go : iterable of Polygon
        Land and shoals (m). MultiPolygons are taken apart.
    land : iterable of Polygon, optional
        The part of the no-go zone that no vessel can cross (m), if that is smaller: the land
        itself, where `no_go` is grown by a margin or simplified outwards. The lower bound on fuel
        holds for every route off this land; the plan keeps off `no_go`.
    point_scale : callable, optional
        Of a conformal plane: metres of the plane per true metre (...) at points (..., 2), m. Then
        times, fuel, bounds, turns and the lengths of routes are those of true metres; places,
        padding and clearances stay the plane's.

    Raises
    ------
    GeometryError
        Polygons that are invalid (the message says where and why, all at once), empty or not
        finite, or no water left.
    ParameterError
        A point scale that is not a positive number everywhere.
    """

    def __init__(
        self,
        extent: Polygon,
        no_go: Iterable[Polygon] = (),
        land: Iterable[Polygon] | None = None,
        *,
        point_scale: Callable[[FloatArray], FloatArray] | None = None,
    ) -> None:
        islands = _all_polygons("no_go", no_go)
        bare = None if land is None else _all_polygons("land", land)
        _check(extent, {"no_go": islands, "land": bare or []})
        # A hole in the extent holds no water, so it is land.
        islands += [Polygon(hole) for hole in extent.interiors]
        extent = Polygon(extent.exterior)
        minx, miny, maxx, maxy = extent.bounds
        self.precision = _PRECISION * float(np.hypot(maxx - minx, maxy - miny))
        """Grid on which the chart's coordinates are snapped (m)."""
        self.extent: Polygon = extent
        merged = shapely.union_all(np.array(islands, dtype=object), grid_size=self.precision)
        clipped = shapely.intersection(merged, extent, grid_size=self.precision)
        self.no_go: tuple[Polygon, ...] = tuple(_polygons(clipped))
        """The hard no-go zone inside the extent as disjoint polygons."""
        self.islands: tuple[tuple[Polygon, ...], ...] = (self.no_go,)
        """Islands that distinguish classes, by kind: land, then the areas of `without`; they are
        numbered in this order."""
        self._land = bare
        self.metres, self.metres_in = _metres(point_scale, self.bounds)
        if self.water.is_empty:
            raise GeometryError(
                "chart: the no-go zone covers the whole extent; no water is left"
                if self.no_go
                else f"chart: the extent is thinner than {self.precision:.3g} m, which is "
                f"{_PRECISION:g} of its diagonal; no water is left"
            )

    def without(self, areas: Iterable[Polygon], *, is_land: bool) -> "Chart":
        """Return the chart with areas (m) as no-go; land keeps its numbers in names of classes.

        If they are land, the lower bound on fuel keeps off them, too.
        """
        areas = list(areas)
        bare = list(self.no_go if self._land is None else self._land)
        other = self.with_no_go([*self.no_go, *areas], bare + areas if is_land else bare)
        # An area that touches land forms one obstacle with it, which keeps the land's number.
        merged = _polygons(shapely.union_all(np.array(areas, dtype=object)))
        land = shapely.union_all(np.array(sum(self.islands, ()), dtype=object))
        apart = tuple(island for island in merged if not shapely.intersects(island, land))
        other.islands = (*self.islands, apart)
        return other

    def true_metres(self, points: FloatArray) -> FloatArray:
        """Return true metres per metre of the plane (...) at points (..., 2), m."""
        if len(self.metres) == 1:
            return np.ones(points.shape[:-1])
        flat = for_kernels(points.reshape(-1, 2))
        return metres_at(self.metres, self.metres_in, flat).reshape(points.shape[:-1])

    def length(self, path: FloatArray) -> float:
        """Return the length of a path (n, 2) in true metres."""
        begin, end = path[:-1], path[1:]
        ends, middles = self.true_metres(path), self.true_metres((begin + end) / 2)
        # By Simpson's rule on each leg.
        metres = (ends[:-1] + 4 * middles + ends[1:]) / 6
        return float((metres * np.linalg.norm(end - begin, axis=1)).sum())

    def turning(self, vessel: "Vessel") -> "Vessel":
        """Return the vessel with turns as wide as they may be anywhere on the plane.

        Where the plane stretches them less, they are too wide: by as much as its scale varies.
        """
        return replace(vessel, turn_rate=vessel.turn_rate * float(self.metres.min()))

    def with_no_go(
        self,
        no_go: Iterable[Polygon],
        land: Iterable[Polygon] | None = None,
        extent: Polygon | None = None,
    ) -> "Chart":
        """Return a chart of other no-go and land (m), or of another extent, in the same plane."""
        other = Chart(extent or self.extent, no_go, land)
        other.metres, other.metres_in = self.metres, self.metres_in
        return other

    def with_open_water(self, water: shapely.Geometry) -> "Chart":
        """Return the chart with other water (m) for the bound on fuel."""
        other = copy.copy(self)
        other.open_water = water
        return other

    @cached_property
    def hard_no_go(self) -> MultiPolygon:
        """The hard no-go zone L as one geometry."""
        return MultiPolygon(self.no_go)

    @cached_property
    def shore(self) -> FloatArray:
        """The edges of L: their ends (2, e, 2), m."""
        return np.ascontiguousarray(edges_of(self.no_go).swapaxes(0, 1))

    @cached_property
    def water(self) -> shapely.Geometry:
        """The extent minus L: a Polygon, or a MultiPolygon where land parts it."""
        return self.less(self.extent, self.hard_no_go)

    @cached_property
    def open_water(self) -> shapely.Geometry:
        """The extent minus the land alone, at least the water."""
        if self._land is None:
            return self.water
        land = shapely.union_all(np.array(self._land, dtype=object), grid_size=self.precision)
        uncrossable = shapely.intersection(land, self.hard_no_go, grid_size=self.precision)
        return self.less(self.extent, uncrossable)

    def less(self, area: shapely.Geometry, other: shapely.Geometry) -> shapely.Geometry:
        """Return an area less another on the chart's grid: a Polygon or a MultiPolygon."""
        rest = shapely.difference(area, other, grid_size=self.precision)
        if isinstance(rest, Polygon | MultiPolygon):
            return rest
        # Where the two areas only touch, snapping leaves lines and points.
        return MultiPolygon(_polygons(rest))

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """The extent's (xmin, ymin, xmax, ymax) in metres."""
        xmin, ymin, xmax, ymax = self.extent.bounds
        return xmin, ymin, xmax, ymax


def edges_of(polygons: Iterable[Polygon]) -> FloatArray:
    """Return the edges (e, 2, 2), m, of polygons."""
    rings = shapely.get_rings(np.array(list(polygons), dtype=object))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    return np.asarray(np.stack([points[:-1], points[1:]], axis=1)[np.diff(ring) == 0])


def _metres(
    point_scale: Callable[[FloatArray], FloatArray] | None,
    bounds: tuple[float, float, float, float],
) -> tuple[FloatArray, FloatArray]:
    """Return the nodes of a plane's metres, for a `CurrentTable`, as close as they must be."""
    if point_scale is None:
        return TRUE_METRES
    xmin, ymin, xmax, ymax = bounds
    count = _FIRST_NODES
    while True:
        nodes = np.stack(
            np.meshgrid(np.linspace(xmin, xmax, count), np.linspace(ymin, ymax, count)), axis=-1
        )
        scale = as_floats("point_scale: what it returned", point_scale(nodes.copy()))
        if scale.shape != (count, count) or not (np.isfinite(scale) & (scale > 0)).all():
            raise ParameterError(
                f"chart: point_scale must return a number above 0 for each point; for points of "
                f"shape {nodes.shape} it returned shape {scale.shape}, and {scale.min():.3g} at "
                "least"
            )
        metres = 1 / scale
        # Between nodes the error is an eighth of a second difference, along x and along y.
        bends = sum(np.abs(np.diff(metres, 2, axis=axis)).max() for axis in (0, 1)) / 8
        if bends <= _SCALE_ERROR or count >= _MOST_NODES:
            steps = (count - 1) / (xmax - xmin), (count - 1) / (ymax - ymin)
            return for_kernels(metres), np.array([xmin, ymin, *steps])
        count = 2 * count - 1


def _all_polygons(name: str, geometries: object) -> list[Polygon]:
    """Return the polygons in geometries; refuse anything else."""
    is_text = isinstance(geometries, str | bytes)
    # A 0-dimensional array claims to be iterable, but is not.
    if is_text or not isinstance(geometries, Iterable) or not np.iterable(geometries):
        raise GeometryError(f"chart: {name} must be polygons in a row, not {shown(geometries)}")
    given = list(geometries)
    for at, geometry in enumerate(given):
        if not isinstance(geometry, shapely.Geometry):
            raise GeometryError(f"chart: {name}[{at}] must be a Polygon, not {shown(geometry)}")
    return [part for geometry in given for part in _polygons(geometry)]


def _polygons(geometry: shapely.Geometry) -> list[Polygon]:
    """Return the polygons in any geometry; points and lines have no area to keep out of."""
    return [
        part
        for part in shapely.get_parts(geometry, return_index=False).tolist()
        if isinstance(part, Polygon) and not part.is_empty
    ]


def _check(extent: Polygon, kinds: Mapping[str, list[Polygon]]) -> None:
    """Raise one GeometryError that names every bad polygon."""
    if not isinstance(extent, Polygon) or extent.is_empty:
        raise GeometryError(f"chart: the extent must be a non-empty Polygon, not {shown(extent)}")
    faults = []
    named = ((f"{kind}[{i}]", p) for kind, of in kinds.items() for i, p in enumerate(of))
    for name, polygon in (("extent", extent), *named):
        if not np.isfinite(shapely.get_coordinates(polygon)).all():
            faults.append(f"{name} has coordinates that are not finite")
        elif not polygon.is_valid:
            faults.append(f"{name} is not valid: {shapely.is_valid_reason(polygon)}")
    if faults:
        raise GeometryError("chart: " + "; ".join(faults) + ". Mend with shapely.make_valid.")


MAX_SPEED = 1e6
"""Highest speed through water (m/s); a higher one is taken for a typing error."""

# Bend of a curve of power below which it counts as a line, as a share of its end.
_ROUNDING = 1e-9
# Largest figures (m/s, rad/s, m, ...); larger ones are typing errors, and their powers overflow.
_MOST_FUEL = 1e12
_LIMITS = {
    "speed": MAX_SPEED,
    "turn_rate": 1e6,
    "length": 1e6,
    "fuel_coefficient": _MOST_FUEL,
    "fuel_exponent": 20.0,
}


@dataclass(frozen=True, slots=True)
class Vessel:
    """A vessel at constant thrust.

    Parameters
    ----------
    speed : float
        Speed through water, v (m/s).
    turn_rate : float
        Turn rate with the rudder hard over, ω (rad/s).
    length : float
        Length overall (m).
    fuel_coefficient, fuel_exponent : float
        Fuel law: fuel a second is α vᵏ (paper, Eq. 4; α = 1 and k = 2 there). With α in W/(m/s)ᵏ
        fuel is in joules.
    hotel : float
        Fuel a second in addition, whatever the speed (W): instruments and computers on board.
    power : sequence of (float, float), optional
        Power P (W) at some speeds v (m/s), in place of α vᵏ; convex, and rising. Between them it is
        interpolated (:mod:`renew.kernels.fuel_law`); beyond them no speed is allowed.

    Raises
    ------
    ParameterError
        A figure that is not positive, or larger than any vessel's; a power that isn't convex.
    """

    speed: float
    turn_rate: float
    length: float = 2.0
    fuel_coefficient: float = 1.0
    fuel_exponent: float = 2.0
    hotel: float = 0.0
    power: tuple[tuple[float, float], ...] | None = None

    def __post_init__(self) -> None:
        """Refuse figures that no vessel has; the error names all faults."""
        faults = [
            f"{name} = {shown(value)} must be a number above 0 and at most {most:g}"
            for name, most in _LIMITS.items()
            if not (is_number(value := getattr(self, name)) and 0 < value <= most)
        ]
        if not (is_number(self.hotel) and 0 <= self.hotel <= _MOST_FUEL):
            faults.append(
                f"hotel = {shown(self.hotel)} W must be a number from 0 to {_MOST_FUEL:g}"
            )
        if self.power is not None:
            faults += self._power_faults()
        if faults:
            raise ParameterError("vessel: " + "; ".join(faults))
        # As floats, because every kernel would be compiled again for ints.
        for name in _LIMITS:
            object.__setattr__(self, name, float(getattr(self, name)))
        object.__setattr__(self, "hotel", float(self.hotel))
        if self.power is not None:
            points = tuple((float(v), float(watts)) for v, watts in self.power)
            object.__setattr__(self, "power", points)

    def _power_faults(self) -> list[str]:
        """Return the faults of the power at given speeds, and of the speed that it has to hold."""
        try:
            points = as_floats("power", self.power)
        except ParameterError as error:
            return [str(error)]
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
            return [f"power has shape {points.shape}; it must be (n, 2), (m/s, W), with n >= 2"]
        speeds, watts = points.T
        if (
            not ((points > 0) & np.isfinite(points)).all()
            or not (np.diff(points, axis=0) > 0).all()
        ):
            return ["power must rise with speed, from above 0 m/s and 0 W; hotel is the power at 0"]
        bends = np.diff(np.diff(watts) / np.diff(speeds))
        # Points on a line may be off it by rounding.
        faults = [
            f"power isn't convex: {watts[k + 1]:g} W at {speeds[k + 1]:g} m/s lie above the line "
            "between the points beside it; leave that point out, or fit K v^n to all"
            for k in np.flatnonzero(bends < -_ROUNDING * watts[-1] / speeds[-1])
        ]
        if (self.fuel_coefficient, self.fuel_exponent) != (1.0, 2.0):
            faults.append("power stands in place of fuel_coefficient and fuel_exponent: leave out")
        return faults + self.speed_faults("speed", self.speed)

    def speed_faults(self, name: str, speed: float) -> list[str]:
        """Return the fault of a speed (m/s) with a `name` for which no power is known."""
        if self.power is None or not is_number(speed):
            return []
        least, most = self.power[0][0], self.power[-1][0]
        if least <= speed <= most:
            return []
        side = "above" if speed > most else "below"
        given = f"the speeds at which power is given, {least:g} to {most:g} m/s"
        return [f"{name} = {speed:g} m/s is {side} {given}: give the power there, or another speed"]

    @property
    def turning_radius(self) -> float:
        """Radius of a hard-over turn in still water, v/ω (m)."""
        return self.speed / self.turn_rate

    @property
    def turn_period(self) -> float:
        """Time of one full hard-over turn, 2π/ω (s)."""
        return 2 * math.pi / self.turn_rate

    @property
    def fuel_rate(self) -> float:
        """Fuel a second at the vessel's speed, α vᵏ as a rule (fuel units per second)."""
        return float(self.rates(self.speed))

    def rates(self, speeds: float | FloatArray) -> FloatArray:
        """Return fuel a second (...) at speeds through water (...), m/s (fuel units per second)."""
        return np.asarray(self.fuel_coefficient * efforts(speeds, self.law))

    @property
    def law(self) -> FuelLaw:
        """Fuel a second over α, for kernels."""
        hotel = self.hotel / self.fuel_coefficient
        if self.power is None:
            return FuelLaw(self.fuel_exponent, hotel)
        return FuelLaw(math.nan, hotel, spline_nodes(self.power))
