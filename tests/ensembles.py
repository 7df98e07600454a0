"""Ensembles of steady currents, and exact optima over the edges of one lattice."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from shapely import Polygon, box

import renew
from renew._types import FloatArray
from renew.inputs.options import Drift
from tests.oracles import grid_graph
from tests.strategies import PAPER_VESSEL, SINGLE_GYRE_ISLANDS

# Number of waves of a stream function.
_WAVES = 8
SIDE = np.linspace(0, 100, 65)
"""Nodes along a side of the published scenes, m."""


def stirred(
    base: renew.CurrentField,
    count: int,
    spread: float,
    seed: int | list[int],
    axes: tuple[FloatArray, FloatArray] = (SIDE, SIDE),
    wave: float = 50.0,
) -> list[renew.GriddedCurrent]:
    """Return members around a current at nodes x and y, m: its strength ± 15 %, and random eddies.

    `spread` is the rms speed (m/s) of the eddies, seeded stream functions of waves about `wave`
    metres long.
    """
    rng, points = np.random.default_rng(seed), np.stack(np.meshgrid(*axes), axis=-1)
    mean, found = base(points), []
    for _ in range(count):
        waves = rng.normal(0, 2 * np.pi / wave, (_WAVES, 2))
        slope = np.cos(points @ waves.T + rng.uniform(0, 2 * np.pi, _WAVES))
        eddies = np.stack([slope @ waves[:, 1], -(slope @ waves[:, 0])], axis=-1)
        eddies *= spread / np.sqrt((eddies**2).sum(axis=-1).mean())
        u, v = np.moveaxis(mean * rng.uniform(0.85, 1.15) + eddies, -1, 0)
        found.append(renew.GriddedCurrent(*axes, u, v))
    return found


def gyre_chart() -> renew.Chart:
    """Return the chart of the published single gyre."""
    return renew.Chart(box(0, 0, 100, 100), [Polygon(corners) for corners in SINGLE_GYRE_ISLANDS])


class Lattice(NamedTuple):
    """Times (m, e), s, of a lattice's edges in each member; `graph` holds their places.

    The fuel of a path is the sum of its edges', so the path of least mean fuel is Dijkstra's.
    """

    points: FloatArray
    graph: csr_array
    times: FloatArray

    @classmethod
    def of(
        cls,
        chart: renew.Chart,
        members: list[renew.GriddedCurrent],
        ends: tuple[FloatArray, FloatArray],
        spacing: float,
        drift: Drift,
        radius: int = 4,
    ) -> Lattice:
        """Return the lattice of nodes `spacing` metres apart."""
        found = [
            grid_graph(chart, one, PAPER_VESSEL, *ends, spacing, drift=drift, radius=radius)
            for one in members
        ]
        return cls(*found[0], np.array([graph.data for _, graph in found]))

    def fuels(self, weights: FloatArray) -> FloatArray:
        """Return the fuel (m,) in each member of the path of least mean by weights (m,)."""
        count, first, last = (len(self.points) - shift for shift in (0, 2, 1))
        counted = weights > 0
        data = weights[counted] @ self.times[counted]
        graph = csr_array((data, self.graph.indices, self.graph.indptr), shape=(count, count))
        time, before = dijkstra(graph, indices=first, return_predecessors=True)
        if not np.isfinite(time[last]):
            return np.full(len(weights), np.inf)
        fuels, node = np.zeros(len(weights)), last
        while node != first:
            tail = before[node]
            row = slice(self.graph.indptr[tail], self.graph.indptr[tail + 1])
            edge = row.start + int(np.flatnonzero(self.graph.indices[row] == node)[0])
            fuels += self.times[:, edge]
            node = tail
        return PAPER_VESSEL.fuel_rate * fuels


def evened(member: renew.GriddedCurrent) -> renew.GriddedCurrent:
    """Return the mean of a member on a square and of its mirror image about the middle, along y."""
    u, v = np.moveaxis(member.uv, -1, 0)
    return renew.GriddedCurrent(member.x, member.y, (u + u[::-1]) / 2, (v - v[::-1]) / 2)


def island_between(off: float = 0.0) -> renew.Chart:
    """Return a square of water with an island `off` metres above its middle: two ways past it."""
    island = shapely.Point(50, 50 + off).buffer(15, quad_segs=4)
    return renew.Chart(box(0, 0, 100, 100), [island])
