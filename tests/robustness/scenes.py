"""Odd scenes for the planner: geometry, currents, vessels and options at the edge of sense.

Run as a program, whose memory is limited, it plans some and prints the outcome as JSON.
"""

import collections
import json
import math
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from shapely import Point, Polygon, affinity, box

import renew
from renew._types import FloatArray
from tests.robustness.limits import TooSlowError, cpu_limit, failure, limit_memory

Rng = np.random.Generator

_SIDE = 100.0
"""Side of a scene before it is scaled, m."""


@dataclass(frozen=True)
class Scene:
    """The arguments of a plan; `chart` is made when the scene is planned, as it may be refused."""

    extent: Polygon
    islands: list[Polygon]
    current: Callable[[], renew.CurrentField | Callable[[FloatArray], FloatArray]]
    vessel: Callable[[], renew.Vessel]
    start: FloatArray
    goal: FloatArray
    options: dict[str, Any]

    def plan(self) -> tuple[renew.Chart, renew.Plan]:
        """Plan the scene."""
        chart = renew.Chart(self.extent, self.islands)
        plan = renew.plan(
            chart, self.current(), self.vessel(), self.start, self.goal, **self.options
        )
        return chart, plan


def odd_scene(seed: list[int]) -> Scene:
    """Make one scene."""
    rng = np.random.default_rng(seed)
    islands = _islands(rng)
    extent = _extent(rng)
    start, goal = _endpoints(rng, extent, islands)
    for _ in range(20 if rng.random() < 0.85 else 0):  # mostly in water, or nothing is planned
        wet = [not any(land.covers(Point(end)) for land in islands) for end in (start, goal)]
        if all(wet):
            break
        start, goal = _endpoints(rng, extent, islands)
    scale = 1.0 if rng.random() < 0.5 else 10.0 ** rng.uniform(-7, 7)
    shift = np.zeros(2) if rng.random() < 0.7 else scale * 10.0 ** rng.uniform(0, 7, 2)
    matrix = [scale, 0, 0, scale, *shift]
    speed = 10.0 ** (rng.uniform(-1, 1) if rng.random() < 0.9 else rng.uniform(-9, 6))
    if rng.random() < 0.8:
        speed *= min(scale, 1e4)
    return Scene(
        extent=affinity.affine_transform(extent, matrix),
        islands=[affinity.affine_transform(island, matrix) for island in islands],
        current=_current(rng, speed, scale, shift),
        vessel=_vessel(rng, speed, scale),
        start=start * scale + shift,
        goal=goal * scale + shift,
        options=_options(rng, scale),
    )


def _extent(rng: Rng) -> Polygon:
    """A square, mostly; a sliver, one with a hole, or one that is not convex."""
    match rng.integers(8):
        case 0:
            return box(0, 0, _SIDE, 10.0 ** rng.uniform(-6, 2))
        case 1:
            hole = box(40, 40, 60, rng.uniform(41, 99.9999))
            return Polygon(box(0, 0, _SIDE, _SIDE).exterior, [hole.exterior])
        case 2:
            corner = rng.uniform(1, 99, 2)
            return Polygon(
                np.array(
                    [[0, 0], [_SIDE, 0], [_SIDE, corner[1]], corner, [corner[0], _SIDE], [0, _SIDE]]
                )
            )
    return box(0, 0, _SIDE, _SIDE)


def _islands(rng: Rng) -> list[Polygon]:
    """Up to 30 islands of one kind, or of all."""
    count = int(rng.choice([0, 1, 2, 3, 5, 8, 15, 30]))
    kind = int(rng.integers(10))
    found: list[Polygon] = []
    for _ in range(count):
        shape = _island(rng, int(rng.integers(9)) if kind == 9 else kind, found)
        if rng.random() < 0.97:  # else it may be invalid, and has to be refused
            shape = shapely.make_valid(shape)
        found += [
            part
            for part in shapely.get_parts(shape)
            if isinstance(part, Polygon) and not part.is_empty
        ]
    return found


def _island(rng: Rng, kind: int, before: list[Polygon]) -> shapely.Geometry:  # noqa: PLR0911 - one for each kind
    """One island: round, on a grid, a sliver, touching, nested, ragged, doubled, a ring, a wall."""
    centre = rng.uniform(0, _SIDE, 2)
    if kind == 0:
        return Point(centre).buffer(10.0 ** rng.uniform(-6, 1.3), quad_segs=int(rng.integers(1, 9)))
    if kind == 1:
        x, y = np.round(centre / 10) * 10
        return box(x, y, x + 10 * rng.integers(1, 4), y + 10 * rng.integers(1, 4))
    if kind == 2:
        along = rng.normal(0, 25, 2)
        across = np.array([-along[1], along[0]]) * 10.0 ** rng.uniform(-12, -1)
        return Polygon([centre, centre + along, centre + along / 2 + across])
    if kind == 3 and before:
        _, south, east, north = before[-1].bounds
        gap = float(rng.choice([0, 10.0 ** rng.uniform(-12, 0)]))
        return box(east + gap, south, east + gap + rng.uniform(0.1, 20), north + rng.choice([0, 5]))
    if kind == 4 and before:
        return affinity.scale(before[-1], *rng.uniform(0.3, 1.5, 2))
    if kind == 5:
        angle = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 60))))
        radii = rng.uniform(0.5, 25, len(angle))
        return Polygon(centre + radii[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))
    if kind == 6 and before:
        return before[int(rng.integers(len(before)))]
    if kind == 7:
        radius = rng.uniform(5, 40)
        ring = Point(centre).buffer(radius) - Point(centre).buffer(
            radius * rng.uniform(0.3, 0.9999)
        )
        slit = 10.0 ** rng.uniform(-9, 0.5)
        return ring - box(centre[0], centre[1] - slit, centre[0] + radius + 1, centre[1] + slit)
    if kind == 8:
        x = centre[0]
        gap = rng.uniform(0, _SIDE)
        return box(x, -5, x + 10.0 ** rng.uniform(-9, 0.5), gap)
    return Point(centre).buffer(rng.uniform(1, 15))


def _endpoints(rng: Rng, extent: Polygon, islands: list[Polygon]) -> tuple[FloatArray, FloatArray]:
    """A start and a goal: in the corners, on edges and vertices, close together, or anywhere."""
    bounds = np.array(extent.bounds).reshape(2, 2)

    def place() -> FloatArray:
        kind = rng.integers(6)
        edge = rng.choice([0.0, 1.0])
        if kind == 0:
            return np.array(bounds[[int(rng.integers(2)), int(rng.integers(2))], [0, 1]])
        if kind == 1:
            return np.asarray(bounds[0] + np.array([edge, rng.uniform()]) * (bounds[1] - bounds[0]))
        if kind == 2 and islands:
            island = islands[int(rng.integers(len(islands)))]
            corners = shapely.get_coordinates(island)
            return np.asarray(corners[int(rng.integers(len(corners)))])
        if kind == 3 and islands:
            ring = islands[int(rng.integers(len(islands)))].exterior
            point = ring.interpolate(rng.uniform(), normalized=True)
            return np.array([point.x, point.y]) + rng.normal(0, 10.0 ** rng.uniform(-12, -1), 2)
        return np.asarray(rng.uniform(bounds[0], bounds[1]))

    start = place()
    if rng.random() < 0.1:
        return start, start + rng.normal(0, 10.0 ** rng.uniform(-12, 0), 2)
    if rng.random() < 0.3:
        return bounds[0] + 0.05 * (bounds[1] - bounds[0]), place()
    return start, place()


def _current(
    rng: Rng, speed: float, scale: float, shift: FloatArray
) -> Callable[[], renew.CurrentField | Callable[[FloatArray], FloatArray]]:
    """A current: none, uniform, a gyre, a grid, a strong one, or a function with bad answers."""
    kind = rng.integers(8)
    share = float(
        rng.choice([0.0, 0.3, 0.9, 0.999, 1.0, 1.5, 30.0], p=[0.1, 0.4, 0.2, 0.1, 0.05, 0.1, 0.05])
    )
    towards = rng.uniform(-np.pi, np.pi)
    u, v = share * speed * math.cos(towards), share * speed * math.sin(towards)
    if kind == 0:
        return lambda: renew.UniformCurrent(0.0, 0.0)
    if kind <= 2:
        return lambda: renew.UniformCurrent(u, v)
    if kind <= 4:
        columns, rows = (int(n) for n in rng.integers(1, 5, 2))
        side = _SIDE * scale
        gyre = renew.GyreCurrent(share * speed, side, side, columns, rows)
        return lambda: gyre if not shift.any() else (lambda points: gyre(points - shift))
    if kind <= 6:
        n = int(rng.choice([2, 3, 20]))
        axis = np.linspace(-0.1, 1.1, n) * _SIDE * scale
        field = rng.normal(0, share * speed / 2, (2, n, n))
        if rng.random() < 0.1:
            field[0, 0, 0] = rng.choice([np.nan, np.inf, 1e200])
        return lambda: renew.GriddedCurrent(axis + shift[0], axis + shift[1], *field)
    bad = rng.integers(4)
    edge = rng.uniform(0, _SIDE) * scale + shift[0]

    def function(points: FloatArray) -> FloatArray:
        velocity = np.zeros(np.shape(points) if bad else (3,))
        if bad:
            worst = (0.0, np.nan, share * speed, 1e12)[bad]
            velocity[..., 0] = np.where(points[..., 0] > edge, worst, 0.1 * speed)
        return velocity

    return lambda: function


def _vessel(rng: Rng, speed: float, scale: float) -> Callable[[], renew.Vessel]:
    """A vessel whose turning circle is small beside the scene; or any vessel at all."""
    radius = _SIDE * scale * 10.0 ** rng.uniform(-4, -1)
    rate = min(speed / radius, 1e6)
    if rng.random() < 0.1:
        rate = 10.0 ** rng.uniform(-9, 6)
    length, coefficient, exponent = 2.0, 1.0, 2.0
    if rng.random() < 0.2:
        length, coefficient = 10.0 ** rng.uniform(-6, 6), 10.0 ** rng.uniform(-12, 12)
        exponent = rng.uniform(1e-3, 20)
    if rng.random() < 0.03:
        rate = float(rng.choice([0.0, -1.0, np.nan, np.inf, 1e300]))
    return lambda: renew.Vessel(speed, rate, length, coefficient, exponent)


def _options(rng: Rng, scale: float) -> dict[str, Any]:
    """Options of a plan; some of them out of range."""
    metres = _SIDE * scale
    options: dict[str, Any] = {
        "classes": int(rng.choice([1, 2, 4, 8, 16, 100])),
        "method": str(rng.choice(["optimal", "optimal", "sampled"])),
        "drift": str(rng.choice(["projected", "crab"])),
        "order": str(rng.choice(["fuel", "fuel", "length", "depth-first"])),
        "samples": int(rng.choice([1, 10, 100])),
        "seed": int(rng.choice([0, 1, 2**63 - 1])),
    }
    if rng.random() < 0.4:
        options["risk"] = float(rng.choice([1e-9, 1e-6, 0.5, 1 - 1e-12]))
    if rng.random() < 0.4:
        widths = ["none", 0.0, 1e-300, metres * 10.0 ** rng.uniform(-6, 1)]
        options["padding"] = widths[int(rng.integers(len(widths)))]
    if rng.random() < 0.2:
        options["clearance"] = metres * 10.0 ** rng.uniform(-6, 0)
    if rng.random() < 0.3:
        options["distinct_by"] = metres * 10.0 ** rng.uniform(-3, 1)
    if rng.random() < 0.05:
        name = str(
            rng.choice(["classes", "risk", "padding", "clearance", "distinct_by", "samples"])
        )
        bad: list[object] = [-1, math.nan, math.inf, "x", None, True, 10**30, [1]]
        options[name] = bad[int(rng.integers(len(bad)))]
    return options


def broken_promises(scene: Scene, chart: renew.Chart, plan: renew.Plan) -> list[str]:
    """List the promises of `renew.plan` that the routes of a plan break."""
    names = [route.homotopy for route in plan.routes]
    names += [rejected.homotopy for rejected in plan.rejected]
    fuels = [route.fuel for route in plan.routes]
    bound = plan.best.fuel_bound.value
    found = [
        (len(set(names)) < len(names), f"a class twice: {sorted(names)}"),
        (sorted(fuels) != fuels, f"not sorted by fuel: {fuels}"),
        (bound > plan.best.fuel * (1 + 1e-9), f"fuel {plan.best.fuel} below the bound {bound}"),
        *(one for route in plan.routes for one in _checks(scene, chart, route)),
    ]
    return [what for is_broken, what in found if is_broken]


def _checks(scene: Scene, chart: renew.Chart, route: renew.Route) -> Iterator[tuple[bool, str]]:
    """Check a route: whether a promise is broken, and in what way."""
    name, line = route.homotopy, shapely.LineString(route.path)
    is_finite = np.isfinite(route.path).all() and np.isfinite(route.trajectory).all()
    yield not is_finite, f"{name}: not finite"
    if not is_finite:
        return
    # Places differ by rounding: far from the origin, by the rounding of their coordinates.
    near = 8 * chart.precision + 1e-12 * float(np.abs(chart.bounds).max())
    ends = np.array([scene.start, scene.goal])
    off = float(np.abs(route.path[[0, -1]] - ends).max())
    yield off > near, f"{name}: its path ends {off:.3g} m off"
    off = float(np.abs(route.trajectory[[0, -1], 1:3] - ends).max())
    yield off > near + 1e-6 * route.length, f"{name}: its trajectory ends {off:.3g} m off"
    outside = line.difference(shapely.buffer(chart.extent, near, join_style="mitre")).length
    yield outside > 0, f"{name}: {outside:.3g} m outside the extent"
    inside = line.intersection(shapely.buffer(chart.hard_no_go, -near, join_style="mitre")).length
    yield inside > 0, f"{name}: {inside:.3g} m on land"
    figures = (route.fuel, route.length, route.duration)
    yield not all(0 < figure < math.inf for figure in figures), f"{name}: figures {figures}"
    is_long = math.isclose(line.length, route.length, rel_tol=1e-9, abs_tol=near)
    yield not is_long, f"{name}: length {route.length}, not {line.length}"
    drift = scene.options["drift"]
    fuel = renew.fuel(route.path, scene.current(), scene.vessel(), drift=drift)
    is_fuel = math.isclose(fuel, route.fuel, rel_tol=1e-6)
    yield not is_fuel, f"{name}: fuel {route.fuel}, by Eq. 4 {fuel}"


SEED = 20_260_111


def outcomes(cases: range) -> tuple[list[str], dict[str, int]]:
    """Plan scenes: descriptions of failures, and how often each outcome was met."""
    failures: list[str] = []
    met: collections.Counter[str] = collections.Counter()
    for case in cases:
        try:
            with cpu_limit():
                scene = odd_scene([SEED, case])
                chart, plan = scene.plan()
                broken = broken_promises(scene, chart, plan)
            failures += [f"case {case}: {promise}" for promise in broken]
            met["plan"] += 1
        except renew.PlanningError as error:
            met[type(error).__name__] += 1
            if not str(error).strip():
                failures.append(f"case {case}: a {type(error).__name__} without words")
        except (Exception, TooSlowError) as error:  # noqa: BLE001 - what must not happen
            failures.append(failure(case, error))
    return failures, met


if __name__ == "__main__":
    warnings.simplefilter("error")
    limit_memory()
    found, counts = outcomes(range(int(sys.argv[1]), int(sys.argv[2])))
    sys.stdout.write(json.dumps({"failures": found, "met": counts}))
