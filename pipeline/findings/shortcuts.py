"""Ways through shut straits with all padding left out, and how much time each would save.

They are searched for on the planner's roadmap (:mod:`renew.classes.roadmap`) over the original
land, where every gap has legs. A way through shut straits is compared with the quickest way that
passes none, on the same roadmap: neither has padding, and both have the roadmap's error.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from scipy.sparse import csgraph, csr_array

from pipeline._types import FloatArray, IndexArray
from pipeline.findings.result import NO_SHARE
from pipeline.geo.coast import mesh_in_tiles
from pipeline.model import Case, CaseResult
from renew.classes.roadmap import GOAL, START, Resolution, Roadmap, roadmap
from renew.inputs.current import as_field
from renew.inputs.options import Drift
from renew.voyage.voyage import Voyage, Waters

# Nodes of the roadmap in open water: those in straits do not depend on it.
_RESOLUTION = Resolution(10_000, 3)
# What a shut strait of the width needed would cost in the search, as a share of the best route's
# time; a narrower one costs more in proportion, up to a factor. Without it, a way would pass
# between all rocks beside it, for a few metres each.
_PRICE = 1e-3
_DEAREST = 10.0
# Legs from which a way takes this much longer than the best route are left out. The quickest way
# round on the roadmap is hardly longer, because the best route has padding.
_LONGER = 1.05


class Shortcut(NamedTuple):
    """A way through some shut straits, by their numbers, and the share of time that it saves.

    `worth` is that share less the price of its straits.
    """

    saves: float
    worth: float
    straits: frozenset[int]


def shortcuts(
    planned: Sequence[tuple[Case, CaseResult]],
    area: shapely.Polygon,
    lines: FloatArray,
    share: FloatArray,
    drift: Drift,
) -> list[Shortcut]:
    """Return ways through shut straits that would be quicker in some case, the best first.

    They are searched in an area of the chart. `lines` (g, 2, 2) are the straits from shore to
    shore, planar metres, which no route passes; `share` (g,) is how wide each is of the width
    needed. Times are at full speed, and in a changing current the least at any time.
    """
    stops = np.concatenate([case.stops for case, _ in planned])
    land = np.array(planned[0][0].water.land, dtype=object)
    near = land[shapely.intersects(area, land)]
    mesh = mesh_in_tiles(near, area, stops) if len(lines) else None
    if mesh is None:
        return []
    ways = list[Shortcut]()
    for case, result in planned:
        best_s = result.routes[0].duration
        waters = Waters(case.chart, as_field(case.current))
        voyage = Voyage(waters, case.vessel, case.start, case.goal, drift, via=case.via)
        parts = [voyage.part(at, voyage.departure) for at in range(len(voyage.stops) - 1)]
        found = [
            _through(
                roadmap(one, mesh, one.table, clearance=0.0, resolution=_RESOLUTION),
                lines,
                share,
                best_s,
            )
            for one in parts
        ]
        whole = sum(around for around, _ in found)
        if not math.isfinite(whole):
            continue
        ways += [
            Shortcut(one.saves / whole, one.worth / whole, one.straits)
            for _, of_part in found
            for one in of_part
            if one.worth > NO_SHARE * whole
        ]
    return undominated(ways, share)


def undominated(ways: Iterable[Shortcut], share: FloatArray) -> list[Shortcut]:
    """Return ways in the order of what they are worth.

    A way is left out where another is worth as much, and passes only some of its straits; or passes
    one of them, and is at its narrowest as wide, by the share (g,) of the width needed.
    """
    kept = list[tuple[Shortcut, float]]()
    widths = [(way, float(share[list(way.straits)].min())) for way in ways]
    for way, narrowest in sorted(widths, key=lambda one: (-one[0].worth, -one[1])):
        if not any(
            other.straits <= way.straits or (other.straits & way.straits and least >= narrowest)
            for other, least in kept
        ):
            kept.append((way, narrowest))
    return [way for way, _ in kept]


def _through(
    graph: Roadmap, gaps: FloatArray, share: FloatArray, best_s: float
) -> tuple[float, list[Shortcut]]:
    """Return the time (s) of the quickest way round all gaps (g, 2, 2), and ways through.

    What a way saves and is worth are times here (s). The best route takes `best_s` (s).
    """
    head, time = graph.head, graph.time
    tail = np.repeat(np.arange(len(graph.points)), np.diff(graph.first))

    def quickest(cost: FloatArray, to: int) -> tuple[FloatArray, IndexArray]:
        """Return the least cost between a node and each other, and the node after the other."""
        ends = (head, tail) if to == GOAL else (tail, head)
        legs = csr_array((cost, ends), shape=(len(graph.points),) * 2)
        found: tuple[FloatArray, IndexArray] = csgraph.dijkstra(
            legs, indices=to, return_predecessors=True
        )
        return found

    onwards = quickest(time, GOAL)[0][head]
    near = quickest(time, START)[0][tail] + time + onwards < _LONGER * best_s
    head, tail, time = head[near], tail[near], time[near]
    price = 1 / np.maximum(share, 1 / _DEAREST) * _PRICE * best_s
    legs = shapely.linestrings(graph.points[np.stack([tail, head], axis=1)])
    leg, gap = shapely.STRtree(shapely.linestrings(gaps)).query(legs, predicate="intersects")
    crossed = np.bincount(leg, price[gap], minlength=len(legs))
    around = float(quickest(np.where(crossed, math.inf, time), START)[0][GOAL])
    if not math.isfinite(around):
        return math.inf, []
    cost = time + crossed
    (there, before), (onwards, after) = quickest(cost, START), quickest(cost, GOAL)
    whole = there[tail[leg]] + cost[leg] + onwards[head[leg]]
    # The quickest leg through each gap.
    order = np.argsort(whole, kind="stable")
    order = order[np.sort(np.unique(gap[order], return_index=True)[1])]
    passed = dict[tuple[int, int], frozenset[int]]()
    for one, other, at in zip(tail[leg].tolist(), head[leg].tolist(), gap.tolist(), strict=True):
        passed[one, other] = passed[other, one] = passed.get((one, other), frozenset()) | {at}
    first, last = {START: frozenset[int]()}, {GOAL: frozenset[int]()}
    ways = list[Shortcut]()
    for at in order[whole[order] < around].tolist():
        one, other = int(tail[leg[at]]), int(head[leg[at]])
        straits = passed[one, other] | _straits_from(one, before, passed, first)
        straits |= _straits_from(other, after, passed, last)
        worth = around - float(whole[at])
        ways.append(Shortcut(worth + float(price[list(straits)].sum()), worth, straits))
    return around, ways


def _straits_from(
    node: int,
    after: IndexArray,
    passed: Mapping[tuple[int, int], frozenset[int]],
    known: dict[int, frozenset[int]],
) -> frozenset[int]:
    """Return the gaps on the way from a node to an end, by the node after each and their legs."""
    way = list[int]()
    while node not in known:
        way.append(node)
        node = int(after[node])
    for at in reversed(way):
        known[at] = known[node] | passed.get((node, at), frozenset())
        node = at
    return known[node]
