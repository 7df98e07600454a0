"""The chain found by looking at few legs, against one that looks at all of them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
import shapely

from pipeline._types import FloatArray
from pipeline.findings.route_profile import metres_along
from pipeline.formats.passage import thinning as module
from pipeline.formats.passage.safe_corridor import (
    Drawing,
    Obstacles,
    SafeCorridor,
    curve_for,
    safe_corridor,
)
from pipeline.formats.passage.thinning import Candidates, cheapest_chain, with_candidates
from tests.pipeline.formats import runs


def corridors() -> list[tuple[SafeCorridor, Drawing]]:
    """Give corridors of planned routes, among islands and with holes, wide and narrow."""
    found = []
    for seed in range(3):
        result = runs.random_run(seed)
        scene = result.planned[runs.SEASON]
        obstacles = Obstacles(scene)
        for ranked in result.routes[:3]:
            curve = curve_for(scene.projection.to_lonlat(ranked.route.path))
            for share in (4e-2, 1e-2, 2e-3):
                corridor = safe_corridor(ranked.route, obstacles, share * ranked.route.length)
                error_m = corridor.max_error * scene.projection.scale
                found.append((corridor, Drawing(scene.projection, curve, error_m)))
    return found


def cost_of(
    begin: FloatArray, end: FloatArray, length: float, corridor: SafeCorridor, drawing: Drawing
) -> FloatArray:
    """Cost of each leg (n, 2), by distances to all that is blocked; inf outside the corridor.

    The corridor's holes are not looked at.
    """
    lines = drawing.lines(drawing.lonlat(begin), drawing.lonlat(end))
    clearance = shapely.distance(corridor.blocked, lines)
    share = np.clip(clearance / corridor.wanted_clearance, 0.05, 1.0)
    cost = 1 + 0.5 * np.linalg.norm(end - begin, axis=1) / length + 1 / share - 1
    return np.where(shapely.covers(corridor.free, lines), cost, np.inf)


def cheapest_of_all(
    candidates: Candidates, own: npt.NDArray[np.int64], corridor: SafeCorridor, drawing: Drawing
) -> float:
    """Cost of the cheapest chain, from the cost of every pair of candidates."""
    length = candidates.along[own[-1]] - candidates.along[own[0]]
    begin, end = np.triu_indices(len(candidates), 1)
    onwards = candidates.along[end] > candidates.along[begin]
    begin, end = begin[onwards], end[onwards]
    pairs = np.stack([candidates.xy[begin], candidates.xy[end]], axis=1)
    cost = np.full((len(candidates),) * 2, np.inf)
    likely = np.ones(len(begin), dtype=bool)
    for share in (0.25, 0.5, 0.75):
        likely &= shapely.contains_xy(
            corridor.free, (1 - share) * pairs[:, 0] + share * pairs[:, 1]
        )
    legs = pairs[likely, 0], pairs[likely, 1]
    cost[begin[likely], end[likely]] = cost_of(*legs, length, corridor, drawing)
    least = np.full(len(candidates), np.inf)
    least[own[0]] = 0.0
    for node in range(int(own[0]) + 1, len(candidates)):
        least[node] = (least[:node] + cost[:node, node]).min()
    return float(least[own[-1]])


def test_no_chain_is_cheaper_and_few_legs_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    looked_at, pairs, compared = 0, 0, 0
    drawn = Drawing.lines

    def counted(self: Drawing, begin: FloatArray, end: FloatArray) -> npt.NDArray[np.object_]:
        nonlocal looked_at
        looked_at += len(begin)
        return drawn(self, begin, end)

    for corridor, drawing in corridors():
        path = Candidates(corridor.path, metres_along(corridor.path))
        candidates, own = with_candidates(path[corridor.first : corridor.last + 1], corridor)
        if len(own) < 3 or len(corridor.holes) or len(candidates) > 120:
            continue
        with monkeypatch.context() as patched:
            patched.setattr(Drawing, "lines", counted)
            chain = cheapest_chain(candidates, own, corridor, drawing).xy
        pairs += len(candidates) * (len(candidates) - 1) // 2
        length = candidates.along[own[-1]] - candidates.along[own[0]]
        cost = cost_of(chain[:-1], chain[1:], length, corridor, drawing).sum()
        if np.isfinite(cost):
            compared += 1
            expected = cheapest_of_all(candidates, own, corridor, drawing)
            assert cost == pytest.approx(expected, rel=1e-9)
    assert compared >= 5
    assert looked_at < 0.4 * pairs


def test_the_paths_through_an_edge_cost_what_the_cheapest_does() -> None:
    random = np.random.default_rng(1)
    cost = np.triu(random.uniform(1, 2, (9, 9)), 1)
    cost[cost == 0] = np.inf
    cost[0, 8] = np.inf
    path, through = module._shortest_path(cost, 0, 8)
    assert through[path[:-1], path[1:]] == pytest.approx(through.min())
    assert cost[path[:-1], path[1:]].sum() == pytest.approx(through.min())
