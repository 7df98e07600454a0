"""Statistics of the fuel of classes over the members of an ensemble, and whether they differ.

CVaR is the mean of the worst share of the members: the largest mean over all weights that give no
member more than its own weight divided by that share (Rockafellar & Uryasev, 2000).

Whether one class is dearer than another is asked of a paired bootstrap (Efron & Tibshirani, 1993):
members are drawn again and again, and the difference is taken in each draw. It is drawn from one
member fewer than there are, so that the draws vary as much as ensembles of this size do.
"""

from typing import Literal, TypeAlias, get_args

import numpy as np

from renew._types import BoolArray, FloatArray

Statistic: TypeAlias = Literal["mean", "p90", "cvar90", "regret"]
STATISTICS: tuple[Statistic, ...] = get_args(Statistic)
QUANTILES = ("p90", "cvar90")
"""Statistics of the worst members: of few members they say little."""
FEWEST = 5
"""Least number of members for these."""

TAIL = 0.1
"""Share of the members, by weight, that P90 leaves out and that CVaR is the mean of."""
# Number of draws of the bootstrap.
_DRAWS = 2000
# Rounding error of sums of weights.
_ROUNDING = 1e-9


def statistic(
    name: Statistic, fuels: FloatArray, weights: FloatArray, tail: float = TAIL
) -> FloatArray:
    """Return a statistic (..., k) of fuels (k, m), by weights (..., m) whose sum is 1.

    Regret is the largest fuel above that of the member's best class. Infinite fuels count where
    they have a weight.
    """
    if name == "mean":
        return _mean(fuels, weights[..., None, :])
    if name == "regret":
        regrets = np.where(weights[..., None, :] > 0, _difference(fuels, fuels.min(axis=0)), 0.0)
        return np.asarray(regrets.max(axis=-1))
    order = np.argsort(-fuels, axis=1)
    falling, own = np.take_along_axis(fuels, order, axis=1), weights[..., order]
    beyond = np.cumsum(own, axis=-1)
    if name == "p90":
        # The smallest fuel that at most the tail of the members, by weight, exceeds.
        at = np.argmax(beyond > tail + _ROUNDING, axis=-1)
        return np.asarray(falling[np.arange(len(fuels)), at])
    return _mean(falling, np.clip(tail - (beyond - own), 0, own) / tail)


def worst_weights(fuels: FloatArray, weights: FloatArray, tail: float = TAIL) -> FloatArray:
    """Return the weights (m,) by which the mean of fuels (m,) is their CVaR."""
    order = np.argsort(-fuels)
    own = weights[order]
    found = np.empty(len(weights))
    found[order] = np.clip(tail - (np.cumsum(own) - own), 0, own) / tail
    return found


def surely_dearer(
    name: Statistic,
    fuels: FloatArray,
    weights: FloatArray,
    best: int,
    *,
    sure: float,
    seed: int,
) -> BoolArray:
    """Whether each class (k,) is dearer than the `best` one, beyond the chance of the members.

    That is so if an interval that holds the share `sure` of the bootstrap's differences lies
    above 0.
    """
    rng = np.random.default_rng(seed)
    count = len(weights) - 1
    drawn = rng.multinomial(count, weights, size=_DRAWS) / count
    found = statistic(name, fuels, drawn)
    more = _difference(found, found[:, [best]])
    return np.asarray((more > 0).mean(axis=0) >= (1 + sure) / 2)


def _mean(fuels: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the sums (..., k) of fuels (k, m) by weights (..., 1 or k, m)."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(weights > 0, weights * fuels, 0.0).sum(axis=-1))


def _difference(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return fuels less other fuels; 0 where both are infinite."""
    with np.errstate(invalid="ignore"):
        return np.where(np.isinf(one) & np.isinf(other), 0.0, one - other)
