"""Fuel along a polyline at constant thrust (paper, Eq. 4), under both drift models.

A vessel that burns α vᵏ a second spends F = α vᵏ ∫ ds / g(s), where g is its speed over ground
along the unit tangent T in the current c:

- ``"projected"``, as published: g = v + c·T;
- ``"crab"``, exact: the vessel heads into the cross-current to stay on its course, so
  g = c·T + √(v² - |c - (c·T)T|²).
"""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

import numpy as np

from renew._compiled import for_kernels
from renew._types import FloatArray
from renew.errors import ParameterError
from renew.inputs.current import CurrentLike, as_field
from renew.inputs.vessel import Vessel
from renew.kernels.ground_speed import Polar, ground_speeds

Drift: TypeAlias = Literal["projected", "crab"]

# Composite Gauss-Legendre: four nodes on pieces of at most 1/256 of the path. On the published
# single gyre the error is below 1e-9 of the fuel.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_PIECES = 256


def check_drift(drift: str) -> None:
    """Refuse a drift model that is not one of the two."""
    if drift not in get_args(Drift):
        raise ParameterError(f"drift = {drift!r} is not one of {', '.join(get_args(Drift))}")


def ground_speed(
    velocity: FloatArray, tangent: FloatArray, speed: float, drift: Drift
) -> FloatArray:
    """Speed over ground (...) along unit tangents (..., 2) in currents (..., 2), m/s.

    Not positive, or NaN, where the vessel can't make way in that direction.
    """
    velocity, tangent = np.broadcast_arrays(velocity, tangent)
    flat = ground_speeds(
        for_kernels(velocity.reshape(-1, 2)),
        for_kernels(tangent.reshape(-1, 2)),
        Polar(speed, drift == "crab"),
    )
    return flat.reshape(velocity.shape[:-1])


def passage_times(
    path: FloatArray, current: CurrentLike, vessel: Vessel, *, drift: Drift = "projected"
) -> FloatArray:
    """Time over each leg of a path (n, 2): shape (n - 1,), s; inf where no way can be made."""
    path = np.asarray(path, dtype=float)
    if path.ndim != 2 or path.shape[1] != 2 or len(path) < 2:
        raise ParameterError(f"path has shape {path.shape}; it must be (n, 2) with n >= 2")
    check_drift(drift)
    legs = np.diff(path, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    tangents = legs / np.where(lengths > 0, lengths, 1.0)[:, None]
    pieces = np.maximum(1, np.ceil(_PIECES * lengths / max(lengths.sum(), 1e-300))).astype(int)
    leg = np.repeat(np.arange(len(legs)), pieces)
    piece = np.arange(len(leg)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    place = (piece[:, None] + (_NODES + 1) / 2) / pieces[leg][:, None]
    points = path[leg][:, None] + place[..., None] * legs[leg][:, None]
    speed = ground_speed(as_field(current)(points), tangents[leg][:, None], vessel.speed, drift)
    with np.errstate(divide="ignore", invalid="ignore"):
        slowness = np.where(speed > 0, 1 / speed, np.inf)
    times = (slowness * (_WEIGHTS / 2)).sum(axis=1) * lengths[leg] / pieces[leg]
    total = np.zeros(len(legs))
    np.add.at(total, leg, np.where(lengths[leg] > 0, times, 0.0))
    return total


def fuel(
    path: FloatArray, current: CurrentLike, vessel: Vessel, *, drift: Drift = "projected"
) -> float:
    """Fuel to follow a path at constant thrust (paper, Eq. 4).

    Parameters
    ----------
    path : array_like
        Polyline (n, 2) in metres, n >= 2.
    current : CurrentField or callable
        Velocity (..., 2) m/s at points (..., 2) m.
    vessel : Vessel
        Gives v, α and the exponent.
    drift : {"projected", "crab"}
        Drift model; see the module.

    Returns
    -------
    float
        α vᵏ times the time under way; ``inf`` where the vessel can't make way along the path.

    Raises
    ------
    ParameterError
        A path of another shape, or an unknown drift model.
    """
    return float(vessel.fuel_rate * passage_times(path, current, vessel, drift=drift).sum())
