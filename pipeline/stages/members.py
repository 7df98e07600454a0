"""The members of a season's current in the plane: from its source, or the current with eddies."""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np

import renew
from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.model import Current, CurrentGrid, MemberCurrents
from pipeline.scenario.season import MembersSpec

Planar: TypeAlias = Callable[[CurrentGrid], renew.GriddedCurrent | renew.VaryingCurrent]
"""Brings a current into the plane."""

# Number of waves of the eddies of a member; number of nodes along a side for a current that has
# none of its own.
_WAVES, _NODES = 12, 101
# Wave numbers of the eddies, as shares of the one asked for; number of nodes to a wave; largest
# number of nodes along a side.
_SHARES, _NODES_A_WAVE, _MAX_NODES = (0.6, 1.4), 8, 600


def stirred(
    base: Current,
    spec: MembersSpec,
    bounds: tuple[float, float, float, float],
    scale: float,
    seed: int,
) -> MemberCurrents:
    """Return members around a planar current: the current, with eddies whose mean is zero.

    Each member's eddies are a seeded stream function of random waves. The rms speed of all is that
    of the `spread`, over (xmin, ymin, xmax, ymax), planar metres.
    """
    length = 1000 * spec.eddy_km / scale
    x, y = (_finer(axis, length / _NODES_A_WAVE) for axis in _nodes(base, bounds))
    if max(x.size, y.size) > _MAX_NODES:
        raise RequestError(
            f"members.eddy_km = {spec.eddy_km:g} is too short for a region of this size: it would "
            f"take {max(x.size, y.size):,} nodes along a side, more than {_MAX_NODES:,}; raise it"
        )
    points, rng = np.stack(np.meshgrid(x, y), axis=-1), np.random.default_rng(seed)
    eddies = np.empty((spec.count, *points.shape))
    for one in eddies:
        number = 2 * np.pi / length * rng.uniform(*_SHARES, _WAVES)
        course = rng.uniform(0, 2 * np.pi, _WAVES)
        waves = np.column_stack([np.cos(course), np.sin(course)]) * number[:, None]
        slope = np.cos(points @ waves.T + rng.uniform(0, 2 * np.pi, _WAVES))
        one[:] = np.stack([slope @ waves[:, 1], -(slope @ waves[:, 0])], axis=-1)
    eddies -= eddies.mean(axis=0)
    eddies *= (spec.spread or 0.0) / np.sqrt((eddies**2).sum(axis=-1).mean())
    names = tuple(f"eddies {number}" for number in range(1, spec.count + 1))
    return MemberCurrents(names, tuple(_plus(base, x, y, one) for one in eddies), None, spec.choose)


def _nodes(
    base: Current, bounds: tuple[float, float, float, float]
) -> tuple[FloatArray, FloatArray]:
    """Return the nodes (nx,) and (ny,) of a current, or some over the bounds."""
    slices = base.slices if isinstance(base, renew.VaryingCurrent) else (base,)
    if isinstance(slices[0], renew.GriddedCurrent):
        return slices[0].x, slices[0].y
    xmin, ymin, xmax, ymax = bounds
    return np.linspace(xmin, xmax, _NODES), np.linspace(ymin, ymax, _NODES)


def _finer(axis: FloatArray, step: float) -> FloatArray:
    """Divide the steps of an axis evenly, until none is longer than `step`.

    A current that is bilinear between the old nodes stays as it is.
    """
    parts = int(np.ceil(float(np.diff(axis).max()) / step))
    return np.interp(np.arange(parts * (axis.size - 1) + 1) / parts, np.arange(axis.size), axis)


def _plus(base: renew.CurrentField, x: FloatArray, y: FloatArray, eddies: FloatArray) -> Current:
    """Return a current with eddies (ny, nx, 2), m/s, added at nodes; they don't change."""
    if isinstance(base, renew.VaryingCurrent):
        slices = [_plus(one, x, y, eddies) for one in base.slices]
        return renew.VaryingCurrent(base.slice_times, slices)
    u, v = np.moveaxis(base(np.stack(np.meshgrid(x, y), axis=-1)) + eddies, -1, 0)
    return renew.GriddedCurrent(x, y, u, v)


def from_source(grid: CurrentGrid, spec: MembersSpec, planar: Planar) -> MemberCurrents | None:
    """Return the members that a source has, or None; `planar` brings a current into the plane."""
    if not grid.members:
        return None
    fields = [planar(replace(grid, u=one.u, v=one.v, members=())) for one in grid.members]
    weights = np.array([one.weight for one in grid.members])
    names = tuple(one.name for one in grid.members)
    return MemberCurrents(names, tuple(fields), weights, spec.choose)
