"""PRM (Kavraki et al., 1996): one shortest path a homotopy class on a random roadmap.

The plain roadmap is OMPL's. OMPL makes undirected edges in its Dubins space, where there and back
differ, so the roadmap of poses is made here, from directed Dubins paths between OMPL's samples.
"""

from __future__ import annotations

import itertools
import math
import time

import numpy as np
import ompl.base as ob
import ompl.geometric as og
from scipy.spatial import cKDTree

from experiments.baselines.candidate import Candidate, NoPathError, Task
from experiments.baselines.class_search import Graph, best_of_classes
from experiments.baselines.spaces import Space, seed_ompl, smoothed, with_smoothed
from experiments.kernels.dubins import dubins_motions, dubins_path
from experiments.kernels.water import PaddedWater
from renew._types import FloatArray, IntArray
from renew.classes.h_signature import Rays

NEIGHBOURS = 15
"""Neighbours that a node is joined to; the paper does not say how many."""


def prm(task: Task) -> list[Candidate]:
    """The shortest path of each class on OMPL's roadmap, and each simplified."""
    seed_ompl(task.seed)
    started = time.process_time()
    voyage, budget, space = task.voyage, task.budget, Space(task.water)
    ends = voyage.start, voyage.goal
    points, pairs = roadmap(og.PRM(space.information), space, budget.nodes, ends)
    cost = np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=1)
    rays = Rays.of(voyage.chart)
    paths = best_of_classes(Graph(points, pairs, cost), rays, budget.classes)
    if not paths:
        raise NoPathError(f"no path on a roadmap of {budget.nodes} nodes")
    seconds = time.process_time() - started
    found = (with_smoothed(space, path, rays, len(points), seconds) for path in paths)
    return list(itertools.chain.from_iterable(found))


def roadmap(
    planner: object, space: Space, nodes: int, ends: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, IntArray]:
    """Grow a roadmap of OMPL to a number of nodes, or until the calls of the space are used up.

    Returns points (n, 2), start and goal first, and directed edges (m, 2), each both ways.
    """
    prm: og.PRM = planner
    if hasattr(prm, "setMaxNearestNeighbors") and not isinstance(prm, og.PRMstar):
        prm.setMaxNearestNeighbors(NEIGHBOURS)
    problem = space.problem(*ends)
    prm.setProblemDefinition(problem)
    prm.setup()
    prm.growRoadmapPtc(
        ob.PlannerTerminationCondition(
            lambda: prm.milestoneCount() >= nodes or space.calls.are_used_up()
        )
    )
    data = ob.PlannerData(space.information)
    prm.getPlannerData(data)
    count = data.numVertices()
    grown = np.array([space.place(data.getVertex(i).getState()) for i in range(count)])
    leaving = [data.getEdges(i) for i in range(count)]
    tails = np.repeat(np.arange(count), [len(heads) for heads in leaving])
    heads = np.fromiter(itertools.chain.from_iterable(leaving), dtype=np.int64)
    points = np.vstack([*ends, grown])
    # Start and goal are joined to the nearest visible nodes, as many as any node has.
    tree = cKDTree(grown)
    joined = []
    for end in (0, 1):
        near = tree.query(points[end], k=min(4 * NEIGHBOURS, count))[1]
        seen = near[space.water.clear(np.broadcast_to(points[end], (len(near), 2)), grown[near])]
        joined += [(end, 2 + i) for i in seen[:NEIGHBOURS].tolist()]
    inner = 2 + np.column_stack([tails, heads])
    pairs = np.concatenate([np.array(joined, dtype=np.int64).reshape(-1, 2), inner])
    both = np.concatenate([pairs, pairs[:, ::-1]])
    # As one number each, pairs are sorted 20 times as fast.
    numbers = np.unique(both @ [len(points), 1])
    return points, np.column_stack(np.divmod(numbers, len(points)))


def prm_dubins(task: Task) -> list[Candidate]:
    """The shortest path of each class on a roadmap of poses, and each simplified."""
    seed_ompl(task.seed)
    started = time.process_time()
    voyage, budget = task.voyage, task.budget
    radius = voyage.vessel.turning_radius
    space = Space(task.water, radius)
    poses = _poses(space, voyage.start, voyage.goal, budget.nodes)
    pairs, cost = _dubins_edges(poses, task.water, radius)
    shapes = {
        edge: dubins_path(poses[i], poses[j], radius) for edge, (i, j) in enumerate(pairs.tolist())
    }
    rays = Rays.of(voyage.chart)
    paths = best_of_classes(Graph(poses[:, :2].copy(), pairs, cost, shapes), rays, budget.classes)
    if not paths:
        raise NoPathError(f"no path on a roadmap of {budget.nodes} poses")
    seconds = time.process_time() - started
    size, found = len(poses), []
    by_place = {
        (float(x), float(y)): pose for x, y, pose in zip(*poses[:, :2].T, poses, strict=True)
    }
    for path in paths:
        on_way = [by_place[place] for place in map(tuple, path.tolist()) if place in by_place]
        states = [space.state(pose[:2], float(pose[2])) for pose in on_way]
        found += [Candidate(path, size, seconds=seconds), smoothed(space, states, rays, size)]
    return found


def _poses(space: Space, start: FloatArray, goal: FloatArray, nodes: int) -> FloatArray:
    """Start, goal, and poses (n, 3) in the water from OMPL's sampler."""
    course = math.atan2(goal[1] - start[1], goal[0] - start[0])
    poses = [np.array([*start, course]), np.array([*goal, course])]
    sampler, state = space.space.allocDefaultStateSampler(), space.space.allocState()
    while len(poses) < nodes + 2:
        sampler.sampleUniform(state)
        if space.water.holds_one(*space.place(state)):
            poses.append(space.pose(state))
    return np.array(poses)


def _dubins_edges(
    poses: FloatArray, water: PaddedWater, radius: float
) -> tuple[IntArray, FloatArray]:
    """Clear Dubins paths (m, 2) from each pose to the poses nearest by path; lengths (m,)."""
    near = cKDTree(poses[:, :2]).query(poses[:, :2], k=min(4 * NEIGHBOURS, len(poses)))[1]
    pairs = np.column_stack([np.repeat(np.arange(len(poses)), near.shape[1]), near.ravel()])
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    lengths, clear = dubins_motions(poses, pairs, radius, water.buckets)
    pairs, lengths = pairs[clear], lengths[clear]
    order = np.lexsort((lengths, pairs[:, 0]))
    pairs, lengths = pairs[order], lengths[order]
    begin = np.searchsorted(pairs[:, 0], pairs[:, 0], side="left")
    keep = np.arange(len(pairs)) - begin < NEIGHBOURS
    # Edges to the goal are kept even where poses have nearer neighbours.
    keep |= pairs[:, 1] == 1
    return pairs[keep], lengths[keep]
