"""Whether a component of a current has the wrong sign, or the two are swapped.

At the scales of a grid the sea turns far more than it diverges: it is nearly in geostrophic
balance, and water is not piled up for long. With one sign wrong, or with the components swapped,
what was shear and stretching is taken for divergence, and the other way round. So of the field as
it is and of its twins, the right one diverges least (Okubo 1970, for the four combinations of
derivatives; the error is that of a delete-one jackknife over blocks, Efron & Stein 1981).

With both signs wrong all four are the same in size: that can't be told from the figures. Nor is a
quarter turn told for sure, as waves and tides diverge more than they turn.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from pipeline.sources.quality.field import Field

    FloatArray = npt.NDArray[np.float64]

_EARTH_RADIUS_M = 6_371_000.0
# The grid is parted into this many blocks a side: what they agree on is no chance.
_BLOCKS = 6
_FEWEST_BLOCKS = 8
# Corners between four cells of water that some current passes.
_FEWEST_CORNERS = 40


@dataclass(frozen=True, slots=True)
class Twin:
    """A way in which the field may be turned, and how strongly the figures say so.

    `contrast` is (own - twin) / (own + twin) of the mean squared divergences, -1 to 1; `certainty`
    is that in its standard errors. Above 0 the twin diverges less than the field as it is.
    """

    name: str
    contrast: float
    certainty: float


FLIPPED = "one component has the wrong sign"
SWAPPED = "the components are swapped"
QUARTER = "the components are swapped and one has the wrong sign"


def likeliest(field: Field) -> Twin | None:
    """Return the twin that diverges least; None where the field itself does, or nothing is told."""
    own = _divergence(field, field.u, field.v) ** 2
    moving = np.isfinite(own) & (_turning(field) > 0)
    if np.count_nonzero(moving) < _FEWEST_CORNERS:
        return None
    block = _blocks(own.shape)[moving]
    candidates = {
        FLIPPED: (-field.u, field.v),
        SWAPPED: (field.v, field.u),
        QUARTER: (field.v, -field.u),
    }
    sums = {
        name: _summed(block, (_divergence(field, *uv) ** 2)[moving])
        for name, uv in candidates.items()
    }
    mine = _summed(block, own[moving])
    name = min(sums, key=lambda name: float(sums[name].sum()))
    if sums[name].sum() >= mine.sum():
        return None
    return _twin(name, mine, sums[name])


def _twin(name: str, own: FloatArray, twin: FloatArray) -> Twin | None:
    """Weigh a twin by blocks (n,); None where too few of them say anything."""
    used = own + twin > 0
    difference, total = (own - twin)[used], (own + twin)[used]
    count = len(total)
    if count < _FEWEST_BLOCKS:
        return None
    contrast = float(difference.sum() / total.sum())
    without = (difference.sum() - difference) / (total.sum() - total)
    error = np.sqrt((count - 1) / count * np.square(without - without.mean()).sum())
    return Twin(name, contrast, contrast / max(float(error), 1e-9))


def _divergence(field: Field, u: FloatArray, v: FloatArray) -> FloatArray:
    """Divergence (ny - 1, nx - 1) in 1/s between four cells each; NaN beside land."""
    cosine = np.cos(np.radians(field.lat))[:, None]
    middle = (cosine[1:] + cosine[:-1]) / 2
    east = (u[1:, 1:] + u[:-1, 1:] - u[1:, :-1] - u[:-1, :-1]) / 2
    through = v * cosine
    north = (through[1:, 1:] + through[1:, :-1] - through[:-1, 1:] - through[:-1, :-1]) / 2
    dx = np.radians(np.diff(field.lon))[None, :]
    dy = np.radians(np.diff(field.lat))[:, None]
    return np.asarray((east / dx + north / dy) / (_EARTH_RADIUS_M * middle))


def _summed(block: npt.NDArray[np.intp], values: FloatArray) -> FloatArray:
    """Sum of the values in each block (n,)."""
    return np.asarray(np.bincount(block, values, _BLOCKS**2), dtype=float)


def _turning(field: Field) -> FloatArray:
    """Squared differences (ny - 1, nx - 1) between the cells around a corner: 0 in still water."""
    total = np.zeros((field.lat.size - 1, field.lon.size - 1))
    for part in (field.u, field.v):
        for other in (part[1:, 1:], part[1:, :-1], part[:-1, 1:]):
            total += (other - part[:-1, :-1]) ** 2
    return total


def _blocks(shape: tuple[int, int]) -> npt.NDArray[np.intp]:
    """Number of the block that each corner lies in: (ny, nx)."""
    row, column = (np.arange(size) * _BLOCKS // size for size in shape)
    return np.asarray(row[:, None] * _BLOCKS + column[None, :])
