"""A lower bound on the fuel of every route, over all classes and whatever clearance.

Proof. Let φ be continuous on the water, linear on each triangle of a grid. Along a route with unit
tangent T and ground speed g(x, T) > 0, φ grows by ∇φ·T a metre and time by 1/g. So if

    (∇φ·T) g(x, T) <= 1 for every T, at every x of every triangle that holds water,            (1)

then time >= φ(goal) - φ(start) for every route, and fuel is α vᵏ times that. (Along an edge of the
grid φ's slope is that of the triangles on either side, so (1) covers routes along edges, too.)

φ = f∘u, where u is the vessel's travel time from the start on a grid (`travel_time.py`), each
of whose cells is cut into two triangles. u is only nearly right, and (1) is then *made* true. Each
triangle gets the ratio λ = max (∇u·T) g(x, T) over all T and x in it, never underrated:

- in a triangle the current is within a radius r of the linear interpolant of its corners' currents
  (`interpolation_error.py`); the maximum is convex in the current, so it is taken at a corner;
- crab: g T runs over the disc of radius v about c, so max over T is v |∇u| + ∇u·c;
- projected: max (∇u·T)(v + c·T) over the unit circle is the maximum of a quadratic, bounded by any
  Lagrange multiplier (`growth_rate.py`);
- both grow by at most |δ| |∇u| when c changes by δ, whence the term r |∇u|.

f has slope 1/Λ(u) between start and goal and 0 beyond, where Λ(s) is the largest λ of the cells
through which the level set u = s runs. So (1) holds for φ: ∇φ = ∇u/Λ. Cells of nothing but land
hold no route and don't count; cells that a shore crosses are treated as water. Where λ > 1 (fans
around the start and corners), the cell's slowness is lowered by λ and u is solved again: every
round gives a bound, and the best is returned.

Cells that no better route can cross don't count either. Let U be any time, φₐ such a φ, and φᵦ one
from the goal in the opposite current. A route that takes less than U is at x no earlier than φₐ,
and needs at least φᵦ from there on. So it keeps to the places where

    φₐ(x) + φᵦ(x) < U,                                                                           (2)

and (1) need hold only there. Then no route takes less than min(U, φₐ(goal)), or than
min(U, φᵦ(start)): one that leaves these cells takes U, any other what φ says. Cells that are left
are cut in four, on that finer grid more are dropped by (2), and so on (`refinement.py`). Within a
cell φ is no less than f at u's least corner, and rises with u no more slowly than f does anywhere
between the cell's corners; (2) is asked of that. U is the time of the front in the mean current,
and a little more. It need not be the time of any route: where it is too small, the bound is U.

Where the current changes, c is read at the front's own arrival. (1) is asked of the velocities at
x at the time t₀ + φ(x) alone, t₀ being the departure: along a route put m = φ - (t - t₀), which is
0 at the start. Where m > 0 the current differs from that at t₀ + φ by at most κ m, κ bounding its
change with time; so m' <= κ |∇φ| m, and by Grönwall's lemma m <= 0 for ever: nobody is anywhere
before t₀ + φ. (A barrier: it is enough to hold the line on the line.) In a triangle φ runs over
an interval of time, and the current over it is in the hull of those at its ends and at the slices
between, from which λ is taken. λ depends on f, which depends on λ of no later times: f is worked
out from the start on. Λ counts as no less than _LEAST_RATE there (raising it is on the safe side),
so that f rises by no more than the inverse of that: from where a triangle's lowest corner is
reached, that bounds the time at its highest.

φᵦ is such a φ, too, with the clock running backwards from t₀ + U: a route that takes less than U is
at the goal by then, m = φᵦ - (t₀ + U - t) is at most 0 there, and, by the same lemma, all along the
way back. So the route is at x no later than t₀ + U - φᵦ(x), which is (2). It meets no current after
t₀ + U, so none is read.

What is proven for which current: everything for `UniformCurrent`, `GyreCurrent` and
`GriddedCurrent`, whose deviation r is bounded in closed form. Any other field is known by its
values alone: r is four times the error that the second differences between neighbouring nodes
suggest, so the bound holds for fields that the grid resolves (a cell is under 1 % of a square
extent's side). Of a current that changes r is the largest of all its slices; where it is not linear
between them, the deviation that second differences in time suggest is added.

Where the vessel chooses its speed v, and has to arrive by a deadline D, let λ be a price of time.
(1) is then asked of (∇φ·T) g(x, T, v) <= α vᵏ + λ for every v as well: φ bounds fuel + λ time from
below, and no route that arrives by D needs less fuel than φ(goal) - φ(start) - λ (D - t₀), whatever
λ >= 0 (weak duality). It is taken at the λ of the best route found. In a current that changes φ
does not tell when the vessel is where: (1) is asked, in each cell, of the currents of all hours at
which a vessel may be there that has left at t₀ and arrives by D, as fast as v and the strongest
current together. That is looser, and a little less than the price at the route's end is better.

Currents above v are no obstacle here: such water may be crossed, at no less than its true cost.
"""

import math

from renew.bounds.refinement import least_time
from renew.voyage.voyage import Voyage

# Number of cells of the finest grid, were it to cover the whole extent.
_CELLS = 64_000
# Number where speeds are chosen in a current that changes: that bound is loose, but not for the
# grid.
_CELLS_AT_CHOICE = 4_000
# Price of time there, as a share of the route's own: where all hours count time is worth less.
_SHARE_OF_PRICE = 0.9


def fuel_lower_bound(voyage: Voyage, cells: int = 0, enough: float = math.inf) -> float:
    """Fuel below which no route from start to goal can stay, over all homotopy classes.

    Infinite if no water joins them. See the module for the proof and for which currents it holds.
    The grid has at least `cells` cells, as far as a changing current's slices leave room: where
    narrow land matters, a coarse one lets the front through. A bound above `enough` (fuel units) is
    made no better.

    With via points the bounds of the parts add up. Each holds for a part begun no earlier than the
    bounds before it say, as a later start brings no earlier end (FIFO). Where
    the current changes, and is as strong as the vessel in places, that may fail: then a part after
    a via point takes no less than the straight way with the strongest current behind.
    """
    fewest = _CELLS
    if voyage.has_price and voyage.waters.current_change > 0:
        voyage = voyage.at_price(_SHARE_OF_PRICE * voyage.choice.price)
        fewest = _CELLS_AT_CHOICE
    time, vessel = 0.0, voyage.vessel
    wanted = (enough + voyage.price_of_all_time) / voyage.cost_rate
    knows_order = voyage.current.is_steady or voyage.table.strongest < vessel.speed
    for at in range(len(voyage.via) + 1):
        # At a price of time `time` is a cost, and the hours of each part may be any.
        begin = voyage.departure if voyage.has_price else voyage.departure + time
        part = voyage.part(at, begin)
        if at == 0 or knows_order or voyage.has_price:
            time += least_time(part, max(cells, fewest), wanted - time)
        else:
            fastest = vessel.speed + voyage.table.strongest
            time += math.dist(part.start, part.goal) / fastest
    return voyage.cost_rate * time - voyage.price_of_all_time
