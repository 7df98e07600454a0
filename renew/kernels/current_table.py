"""A current as a table of nodes, bilinear between them, for compiled code.

The search for paths needs the current millions of times, so it reads a table, made once per plan.
The figures that a plan reports are computed in the field itself. A changing current has one slice
of nodes per time, and is linear between slices; a steady current has one slice.

Overpowered spells are the hours when a current is too strong. Between two slices the velocity is
linear in time, so its square is a parabola. Between the parabola's two roots the current is weaker
than a given level.
"""

import math
from typing import NamedTuple

import numpy as np

from renew._compiled import for_kernels, kernel, small_kernel
from renew._types import FloatArray

# Largest error of a fine table in the middle of any cell, as a share of its strongest current. A
# path found with such a table needs little more than the least fuel: the excess is of second order.
_TOLERANCE = 1e-3
# Number of nodes per side above which a current has small eddies: about eight along the side.
_SMALL_EDDIES = 300
# More seconds than any voyage lasts, but finite, so that 0 times it is 0.
_EVER = 1e200
# Largest difference, by rounding, between the steps of an even axis, as a share of its largest
# coordinate.
_EVEN = 1e-12


class CurrentTable(NamedTuple):
    """Ascending nodes x (nx,), y (ny,) in metres and velocities uv (nt, ny, nx, 2) there in m/s.

    The slices are at ascending `times` (nt,), in seconds on the field's clock. Before the first and
    after the last the current is constant, or repeats itself if `period` (s) is finite. `error`
    (m/s) is the largest difference found between field and table. `per_x`, `per_y` are cells per
    metre and `per_second` slices per second, or 0 if unevenly spaced. `strongest` (m/s) is the
    strongest current, which occurs at a node. `metres` (my, mx) are true metres per metre of the
    plane at even nodes, for a chart whose plane stretches them; one node in a plane. `metres_in`
    (4,) are the first node's x, y (m), and the nodes' steps per metre along x and y.
    """

    x: FloatArray
    y: FloatArray
    times: FloatArray
    uv: FloatArray
    error: float
    period: float
    per_x: float
    per_y: float
    per_second: float
    strongest: float
    metres: FloatArray
    metres_in: FloatArray

    @property
    def is_steady(self) -> bool:
        """Whether it has one slice."""
        return len(self.times) == 1

    @property
    def has_small_eddies(self) -> bool:
        """Whether the current turns so often that its table needs many nodes."""
        return self.nodes_needed > _SMALL_EDDIES

    @property
    def nodes_needed(self) -> float:
        """Number of nodes per side with which the table's error is within _TOLERANCE."""
        nodes = float(max(len(self.x), len(self.y)))
        if self.error == 0.0:
            return nodes
        # The error of a table falls with the square of its spacing.
        return nodes * math.sqrt(self.error / (_TOLERANCE * self.strongest))

    @property
    def is_fine(self) -> bool:
        """Whether the table reproduces the field to within _TOLERANCE."""
        return self.error <= _TOLERANCE * self.strongest

    def extremes(self) -> "tuple[CurrentTable, CurrentTable, bool]":
        """Return steady tables of the least and the largest u and v, and whether they are equal."""
        if self.is_steady:
            return self, self, True
        least, largest = (
            table_of(self.x, self.y, uv)._replace(metres=self.metres, metres_in=self.metres_in)
            for uv in (self.uv.min(axis=0), self.uv.max(axis=0))
        )
        return least, largest, False


def table_of(
    x: FloatArray,
    y: FloatArray,
    uv: FloatArray,
    error: float = 0.0,
    times: FloatArray | None = None,
    period: float = math.inf,
) -> CurrentTable:
    """Return the table of velocities (ny, nx, 2) or (nt, ny, nx, 2); see :class:`CurrentTable`."""
    times = np.zeros(1) if times is None else times
    x, y, uv, times = (for_kernels(array) for array in (x, y, uv, times))
    slices = uv.reshape(len(times), len(y), len(x), 2)
    per_x, per_y, per_second = map(_density, (x, y, times))
    strongest = largest_speed(slices)
    steps = per_x, per_y, per_second
    return CurrentTable(x, y, times, slices, error, period, *steps, strongest, *TRUE_METRES)


def are_same(one: CurrentTable, other: CurrentTable) -> bool:
    """Whether two tables hold the same current."""
    return all(
        np.array_equal(np.asarray(a), np.asarray(b)) for a, b in zip(one, other, strict=True)
    )


@kernel
def largest_speed(uv: FloatArray) -> float:
    """Return the largest length (m/s) of velocities (..., 2)."""
    square = 0.0
    for u, v in uv.reshape(-1, 2):
        square = max(square, u * u + v * v)
    return math.sqrt(square)


def same_axes(one: CurrentTable, other: CurrentTable) -> bool:
    """Whether two tables have the same nodes."""
    return np.array_equal(one.x, other.x) and np.array_equal(one.y, other.y)


@kernel
def weakest_and_strongest(table: CurrentTable) -> tuple[FloatArray, FloatArray]:
    """Return the least and the largest speed (m/s) of all slices at each node (ny, nx)."""
    shape = table.uv.shape[1:3]
    least, largest = np.full(shape, np.inf), np.zeros(shape)
    for velocities_then in table.uv:
        for row in range(shape[0]):
            for column in range(shape[1]):
                u, v = velocities_then[row, column]
                square = u * u + v * v
                least[row, column] = min(least[row, column], square)
                largest[row, column] = max(largest[row, column], square)
    return np.sqrt(least), np.sqrt(largest)


@kernel
def changes(table: CurrentTable) -> FloatArray:
    """Return the largest change of the current per second at any node between slices, m/s²."""
    most = np.zeros(max(1, len(table.times) - 1))
    for k in range(len(table.times) - 1):
        lasts = table.times[k + 1] - table.times[k]
        before, after = table.uv[k].reshape(-1, 2), table.uv[k + 1].reshape(-1, 2)
        square = 0.0
        for i in range(len(before)):
            u, v = after[i, 0] - before[i, 0], after[i, 1] - before[i, 1]
            square = max(square, u * u + v * v)
        most[k] = math.sqrt(square) / lasts
    return most


def _density(axis: FloatArray) -> float:
    """Return cells per unit of an even axis (n,); 0 if it is uneven by more than rounding."""
    steps = np.diff(axis)
    if not len(steps):
        return 0.0
    even = np.ptp(steps) <= _EVEN * np.abs(axis).max()
    return float(len(steps) / (axis[-1] - axis[0])) if even else 0.0


TRUE_METRES = np.ones((1, 1)), np.zeros(4)
"""`metres` and `metres_in` of a plane."""
_FAR = np.array([0.0, 1e12])
# Made without a kernel, because an import must not compile or load one.
STILL_WATER = CurrentTable(
    _FAR,
    _FAR,
    np.zeros(1),
    np.zeros((1, 2, 2, 2)),
    0.0,
    math.inf,
    1e-12,
    1e-12,
    0.0,
    0.0,
    *TRUE_METRES,
)
"""No current anywhere."""


@small_kernel
def _metre_at(metres: FloatArray, metres_in: FloatArray, px: float, py: float) -> float:
    """Return true metres per metre of the plane at a point; constant outside the nodes."""
    rows, columns = metres.shape
    if rows == 1:
        return 1.0
    along = min(max((px - metres_in[0]) * metres_in[2], 0.0), columns - 1.0)
    up = min(max((py - metres_in[1]) * metres_in[3], 0.0), rows - 1.0)
    i, j = min(int(along), columns - 2), min(int(up), rows - 2)
    s, t = along - i, up - j
    low = (1 - s) * metres[j, i] + s * metres[j, i + 1]
    return float((1 - t) * low + t * ((1 - s) * metres[j + 1, i] + s * metres[j + 1, i + 1]))


@small_kernel
def metre_at(table: CurrentTable, px: float, py: float) -> float:
    """Return true metres per metre of the plane at a point."""
    return _metre_at(table.metres, table.metres_in, px, py)


@small_kernel
def mean_metre(table: CurrentTable, ax: float, ay: float, bx: float, by: float) -> float:
    """Return true metres per metre of the plane, the mean of a straight leg, by Simpson's rule."""
    if len(table.metres) == 1:
        return 1.0
    middle = metre_at(table, (ax + bx) / 2, (ay + by) / 2)
    return (metre_at(table, ax, ay) + 4.0 * middle + metre_at(table, bx, by)) / 6.0


@kernel
def metres_at(metres: FloatArray, metres_in: FloatArray, points: FloatArray) -> FloatArray:
    """Return true metres per metre of the plane (n,) at points (n, 2)."""
    result = np.empty(len(points))
    for k in range(len(points)):
        result[k] = _metre_at(metres, metres_in, points[k, 0], points[k, 1])
    return result


class Site(NamedTuple):
    """A point of a table: its cell, and its place in the cell, in [0, 1] along x and y.

    With a site the point need not be looked up again for each time.
    """

    column: int
    row: int
    along_x: float
    along_y: float


@small_kernel
def site_of(table: CurrentTable, px: float, py: float) -> Site:
    """Return site of a point; one outside the table has the nearest place on its edge."""
    column, along_x = _cell(table.x, table.per_x, px)
    row, along_y = _cell(table.y, table.per_y, py)
    return Site(column, row, along_x, along_y)


@small_kernel
def velocity_there(table: CurrentTable, site: Site, time: float) -> tuple[float, float]:
    """Return the velocity (m/s) at a site at some time (s)."""
    at, share = _slice(table, time)
    u, v = _in_slice(table.uv, at, site)
    if share > 0.0:
        later_u, later_v = _in_slice(table.uv, at + 1, site)
        u += share * (later_u - u)
        v += share * (later_v - v)
    return u, v


class Bend(NamedTuple):
    """The current at a site around the `time` (s) of a slice; linear before and after it.

    u, v (m/s) are its velocity at that time. `u_before` and so on are its change (m/s²) in the
    `before` seconds up to that time, and in the `after` seconds from then.
    """

    time: float
    u: float
    v: float
    before: float
    u_before: float
    v_before: float
    after: float
    u_after: float
    v_after: float


@small_kernel
def bend_near(table: CurrentTable, site: Site, time: float) -> Bend:
    """Return the current at a site around the slice that is nearest to a time (s)."""
    times, last, repeats = table.times, len(table.times) - 1, table.period < math.inf
    at, share = _slice(table, time)
    k = at + 1 if share > 0.5 else at
    u, v = _in_slice(table.uv, k, site)
    before, u_before, v_before = after, u_after, v_after = _EVER, 0.0, 0.0
    if k > 0 or repeats:
        at_before = k if k > 0 else last
        before = times[at_before] - times[at_before - 1]
        other_u, other_v = _in_slice(table.uv, at_before - 1, site)
        u_before, v_before = (u - other_u) / before, (v - other_v) / before
    if k < last or repeats:
        at_after = k if k < last else 0
        after = times[at_after + 1] - times[at_after]
        other_u, other_v = _in_slice(table.uv, at_after + 1, site)
        u_after, v_after = (other_u - u) / after, (other_v - v) / after
    nearest = times[k]
    if repeats:
        nearest = time - share * after if k == at else time + (1.0 - share) * before
    return Bend(nearest, u, v, before, u_before, v_before, after, u_after, v_after)


@small_kernel
def node_velocity(table: CurrentTable, row: int, column: int, time: float) -> tuple[float, float]:
    """Return the velocity (m/s) at a node at some time (s)."""
    at, share = _slice(table, time)
    u, v = table.uv[at, row, column]
    if share > 0.0:
        later_u, later_v = table.uv[at + 1, row, column]
        u += share * (later_u - u)
        v += share * (later_v - v)
    return u, v


@kernel
def next_slice(table: CurrentTable, time: float) -> float:
    """Return the time (s) of the first slice after a time; infinite where there is none."""
    times = table.times
    last = len(times) - 1
    if last == 0:
        return math.inf
    begin = 0.0
    if table.period < math.inf:
        begin = math.floor((time - times[0]) / table.period) * table.period
    for _ in range(2):
        at = number_up_to(times, time - begin)
        # By rounding, the search may find the slice at this very time again.
        while at <= last and begin + times[at] <= time:
            at += 1
        if at <= last:
            # The next period's first slice is at the time of this period's last one.
            return float(begin + times[at])
        if table.period == math.inf:
            break
        begin += table.period
    return math.inf


@small_kernel
def _slice(table: CurrentTable, time: float) -> tuple[int, float]:
    """Return the slice before a time, and the share of the time to the next slice, in [0, 1)."""
    times = table.times
    last = len(times) - 1
    if last == 0:
        return 0, 0.0
    if table.period < math.inf:
        time = times[0] + (time - times[0]) % table.period
    # Where the vessel makes no headway, times are infinite or NaN and give no valid index.
    if not time < times[last]:
        return last, 0.0
    return _cell(times, table.per_second, time)


@small_kernel
def _in_slice(uv: FloatArray, k: int, site: Site) -> tuple[float, float]:
    """Return the velocity (m/s) at a site in one slice."""
    i, j, s, t = site
    sw, se, nw, ne = (1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t
    return (
        sw * uv[k, j, i, 0]
        + se * uv[k, j, i + 1, 0]
        + nw * uv[k, j + 1, i, 0]
        + ne * uv[k, j + 1, i + 1, 0],
        sw * uv[k, j, i, 1]
        + se * uv[k, j, i + 1, 1]
        + nw * uv[k, j + 1, i, 1]
        + ne * uv[k, j + 1, i + 1, 1],
    )


@small_kernel
def velocity(table: CurrentTable, px: float, py: float, time: float) -> tuple[float, float]:
    """Return the velocity (m/s) at a point and time, held constant outside the table."""
    return velocity_there(table, site_of(table, px, py), time)


@small_kernel
def _cell(axis: FloatArray, density: float, value: float) -> tuple[int, float]:
    """Return the index of the cell that contains a value, and the place in it in [0, 1]."""
    last = len(axis) - 2
    if density > 0.0:
        along = min(max((value - axis[0]) * density, 0.0), last + 1.0)
        i = min(int(along), last)
        return i, along - i
    i = min(max(number_up_to(axis, value) - 1, 0), last)
    place = (value - axis[i]) / (axis[i + 1] - axis[i])
    return i, min(max(place, 0.0), 1.0)


@small_kernel
def number_up_to(axis: FloatArray, value: float) -> int:
    """Return how many of some ascending numbers are at most a value; NaN is above all.

    Numba takes several times as long to compile NumPy's search.
    """
    first, last = 0, len(axis)
    while first < last:
        middle = (first + last) >> 1
        if value < axis[middle]:
            last = middle
        else:
            first = middle + 1
    return first


@small_kernel
def number_below(axis: FloatArray, value: float) -> int:
    """Return how many of some ascending numbers are less than a value."""
    first, last = 0, len(axis)
    while first < last:
        middle = (first + last) >> 1
        if axis[middle] < value:
            first = middle + 1
        else:
            last = middle
    return first


@kernel
def velocities(table: CurrentTable, points: FloatArray, times: FloatArray) -> FloatArray:
    """Return velocities (n, 2) at points (n, 2) and times (n,)."""
    result = np.empty(points.shape)
    for k in range(len(points)):
        result[k, 0], result[k, 1] = velocity(table, points[k, 0], points[k, 1], times[k])
    return result


def overpowered_spells(
    table: CurrentTable, place: FloatArray, level: float, begin: float, end: float
) -> FloatArray:
    """Return the spells (n, 2), s, ascending, when the current at a place is `level` (m/s) or more.

    Only spells that overlap the time from `begin` to `end` are returned, each complete.
    A spell is infinite if the current is held before its first or after its last time.
    """
    times = table.times
    at = np.broadcast_to(place, (len(times), 2)).copy()
    # A periodic table's last slice equals its first, so the time just before the last is used.
    last = np.nextafter(times[-1], -math.inf) if math.isfinite(table.period) else times[-1]
    velocity = velocities(table, at, np.minimum(times, last))
    weak = _weaker(times, velocity, level)
    if math.isfinite(table.period) and len(weak):
        first, final = (math.floor((time - times[0]) / table.period) for time in (begin, end))
        begun = table.period * np.arange(first - 1, final + 2)
        weak = (weak[None] + begun[:, None, None]).reshape(-1, 2)
    elif len(weak):
        weak[weak == times[0]] = -math.inf
        weak[weak == times[-1]] = math.inf
    # The times between the weaker spells, and before and after them.
    edges = np.concatenate([[-math.inf], weak.ravel(), [math.inf]]).reshape(-1, 2)
    tolerance = 1e-9 * (times[-1] - times[0])
    strong = edges[edges[:, 1] > edges[:, 0] + tolerance]
    return np.asarray(strong[(strong[:, 0] <= end) & (strong[:, 1] >= begin)])


def _weaker(times: FloatArray, velocity: FloatArray, level: float) -> FloatArray:
    """Return the spells (n, 2), s, ascending, when velocities (nt, 2) are weaker; they may touch.

    Velocities are linear between times.
    """
    if len(times) == 1:
        weak = np.array([[-math.inf, math.inf]])
        return weak if np.linalg.norm(velocity[0]) < level else weak[:0]
    change = np.diff(velocity, axis=0)
    # |c + s d|² = level², for the share s of the time between two slices.
    square = (change**2).sum(axis=1)
    slope = (velocity[:-1] * change).sum(axis=1)
    excess = (velocity[:-1] ** 2).sum(axis=1) - level**2
    root = np.sqrt(np.maximum(slope**2 - square * excess, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.stack([-slope - root, -slope + root], axis=1) / square[:, None]
    always = np.where(excess < 0, 1.0, 0.0)
    shares[square == 0] = np.stack([0 * always, always], axis=1)[square == 0]
    shares = np.clip(shares, 0.0, 1.0)
    weak = shares[:, 1] > shares[:, 0]
    lasts = np.diff(times)[:, None]
    # At the share 1 the spell ends exactly where the next begins.
    found = np.where(shares == 1.0, times[1:, None], times[:-1, None] + shares * lasts)
    return np.asarray(found[weak])
