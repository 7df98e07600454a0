"""The members of a forecast: fields that may each come true, with weights; their mean.

Also statistics of the fuel of classes over the members, and whether classes differ.

CVaR is the mean of the worst share of the members: the largest mean over all weights that give no
member more than its own weight divided by that share (Rockafellar & Uryasev, 2000).

Whether one class is dearer than another is asked of a paired bootstrap (Efron & Tibshirani, 1993):
members are drawn again and again, and the difference is taken in each draw. It is drawn from one
member fewer than there are, so that the draws vary as much as ensembles of this size do.
"""

from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from renew._types import BoolArray, FloatArray
from renew.errors import ParameterError, as_floats, shown
from renew.inputs.current import (
    CurrentField,
    CurrentLike,
    FunctionCurrent,
    GriddedCurrent,
    UniformCurrent,
    VaryingCurrent,
    as_field,
)
from renew.kernels.current_table import are_same, same_axes


class Members(NamedTuple):
    """Fields that may come true, one a member, with weights (m,) whose sum is 1, and names.

    Members that hold the same values share one field.
    """

    fields: tuple[CurrentField, ...]
    weights: FloatArray
    names: tuple[str, ...]

    @property
    def are_steady(self) -> bool:
        """Whether no member changes."""
        return self.fields[0].is_steady

    @property
    def distinct(self) -> tuple[CurrentField, ...]:
        """The fields, each once."""
        return tuple({id(field): field for field in self.fields}.values())

    def mean(self, weights: FloatArray) -> CurrentField:
        """Return the mean field by weights (m,), of sum 1; the field itself, if there is one."""
        return self.fields[0] if len(self.distinct) == 1 else mean_of(self.fields, weights)


def as_members(
    currents: Sequence[CurrentLike],
    weights: FloatArray | Sequence[float] | None,
    names: Sequence[str] | None,
) -> Members:
    """Check members, their weights and names; all faults are named at once."""
    if isinstance(currents, CurrentField) or not isinstance(currents, Sequence):
        raise ParameterError(f"currents = {shown(currents)} must be fields in a row, one a member")
    count = len(currents)
    if count < 2:
        raise ParameterError(
            f"currents has {count} member{'s' * (count != 1)}; an ensemble has two or more. Plan "
            "in a single current with renew.plan"
        )
    known = [f"member {at + 1}" for at in range(count)] if names is None else list(names)
    if len(known) != count or len(set(known)) != count:
        raise ParameterError(f"names = {shown(names)} must be {count} different names")
    fields = _shared(map(as_field, currents))
    share = np.full(count, 1 / count) if weights is None else as_floats("weights", weights)
    faults = _weight_faults(share, known) + _clock_faults(fields, known)
    if faults:
        raise ParameterError("; ".join(faults))
    return Members(fields, share / share.sum(), tuple(known))


def mean_of(fields: Sequence[CurrentField], weights: FloatArray) -> CurrentField:
    """Return the mean of fields by weights (m,) whose sum is 1: on their grid, if all have one."""
    first, clock = fields[0], fields[0].slice_times
    grids = [field for field in fields if isinstance(field, GriddedCurrent)]
    if len(grids) == len(fields) and all(same_axes(grids[0].nodes, field.nodes) for field in grids):
        u, v = np.moveaxis(np.einsum("m,mjik->jik", weights, [field.uv for field in grids]), -1, 0)
        return GriddedCurrent(grids[0].x, grids[0].y, u, v)
    uniform = [(field.u, field.v) for field in fields if isinstance(field, UniformCurrent)]
    if len(uniform) == len(fields):
        return UniformCurrent(*(weights @ np.array(uniform)).tolist())
    if first.is_steady:
        return FunctionCurrent(
            lambda points: _mean_velocity([field(points) for field in fields], weights)
        )
    sliced = [
        field.slices for field in fields if isinstance(field, VaryingCurrent) and field.slices
    ]
    if len(sliced) == len(fields) and all(
        np.array_equal(field.slice_times, clock) for field in fields
    ):
        at_times = zip(*sliced, strict=True)
        return VaryingCurrent(clock, [mean_of(then, weights) for then in at_times])

    def velocity(points: FloatArray, times: FloatArray) -> FloatArray:
        return _mean_velocity([field.velocity(points, times) for field in fields], weights)

    return VaryingCurrent(_all_times(fields), velocity)


def _shared(fields: Iterable[CurrentField]) -> tuple[CurrentField, ...]:
    """Return the fields; each that equals an earlier one is replaced by that one."""
    shared: list[CurrentField] = []
    for field in fields:
        shared.append(next((known for known in shared if _are_equal(field, known)), field))
    return tuple(shared)


def _mean_velocity(velocities: Sequence[FloatArray], weights: FloatArray) -> FloatArray:
    """Return the mean (..., 2) of velocities, m/s, by weights (m,)."""
    return np.asarray(np.tensordot(weights, np.array(velocities), axes=1))


def _all_times(fields: Sequence[CurrentField]) -> FloatArray:
    """Return the times (nt,), s, of all fields within the span that all know."""
    begin, end = (
        max(field.slice_times[0] for field in fields),
        min(field.slice_times[-1] for field in fields),
    )
    times = np.unique(np.concatenate([field.slice_times for field in fields]))
    return np.asarray(times[(times >= begin) & (times <= end)])


def _weight_faults(weights: FloatArray, names: Sequence[str]) -> list[str]:
    """Faults of the weights of members."""
    if weights.shape != (len(names),):
        return [f"weights has shape {weights.shape}; there must be {len(names)}, one a member"]
    bad = [
        f"{name} {weight:g}"
        for name, weight in zip(names, weights.tolist(), strict=True)
        if not (np.isfinite(weight) and weight >= 0)
    ]
    if bad:
        return [f"weights must be finite, 0 or more: {', '.join(bad)}"]
    if (weights > 0).sum() > 1:
        return []
    held = [name for name, weight in zip(names, weights.tolist(), strict=True) if weight > 0]
    whose = f"only {held[0]} has" if held else "no member has"
    return [f"weights: {whose} a weight above 0; give it to two members or more"]


def _clock_faults(fields: Sequence[CurrentField], names: Sequence[str]) -> list[str]:
    """Faults of members some of which change while others don't, or of different times."""
    first = fields[0]
    for field, name in zip(fields, names, strict=True):
        if field.is_steady != first.is_steady:
            steady, changing = (name, names[0]) if field.is_steady else (names[0], name)
            fault = (
                f"{steady} is steady, and {changing} changes with time: give all as field or other"
            )
            return [fault]
    begin, end = max(field.span[0] for field in fields), min(field.span[1] for field in fields)
    if begin < end:
        return []
    late, early = max(fields, key=lambda f: f.span[0]), min(fields, key=lambda f: f.span[1])
    later, earlier = names[fields.index(late)], names[fields.index(early)]
    fault = f"{later} begins at {begin:g} s, and {earlier} has ended at {end:g} s"
    return [f"{fault}: members need times in common"]


def _are_equal(field: CurrentField, other: CurrentField) -> bool:
    """Whether two fields are the same field, or hold the same values."""
    if field is other or (type(field) is type(other) and field == other):
        return True
    if isinstance(field, GriddedCurrent) and isinstance(other, GriddedCurrent):
        return are_same(field.nodes, other.nodes)
    if isinstance(field, VaryingCurrent) and isinstance(other, VaryingCurrent):
        return (
            len(field.slices) == len(other.slices) > 0
            and np.array_equal(field.slice_times, other.slice_times)
            and all(map(_are_equal, field.slices, other.slices))
        )
    return False


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
    worst = np.empty(len(weights))
    worst[order] = np.clip(tail - (np.cumsum(own) - own), 0, own) / tail
    return worst


def surely_dearer(
    name: Statistic,
    fuels: FloatArray,
    weights: FloatArray,
    best: int,
    *,
    sure: float,
    seed: int,
) -> BoolArray:
    """Whether each class (k,) is dearer than the `best` one by more than chance.

    Chance is which members the ensemble happens to have: an interval that holds the share `sure` of
    the bootstrap's differences has to lie above 0.
    """
    rng = np.random.default_rng(seed)
    count = len(weights) - 1
    drawn = rng.multinomial(count, weights, size=_DRAWS) / count
    values = statistic(name, fuels, drawn)
    more = _difference(values, values[:, [best]])
    return np.asarray((more > 0).mean(axis=0) >= (1 + sure) / 2)


def _mean(fuels: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the sums (..., k) of fuels (k, m) by weights (..., 1 or k, m)."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(weights > 0, weights * fuels, 0.0).sum(axis=-1))


def _difference(fuels: FloatArray, other: FloatArray) -> FloatArray:
    """Return fuels less other fuels; 0 where both are infinite."""
    with np.errstate(invalid="ignore"):
        return np.where(np.isinf(fuels) & np.isinf(other), 0.0, fuels - other)
