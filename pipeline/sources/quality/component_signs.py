"""Whether a component of a current has the wrong sign, or the two are swapped.

At the scales of a grid the sea rotates far more than it diverges: it is nearly in geostrophic
balance, and water does not pile up for long. With one sign wrong, or with the components swapped,
shear and strain appear as divergence, and divergence as shear and strain. So among the field as it
is and its variants, the right one diverges least. The four combinations of derivatives are those
of Okubo (1970); the standard error is that of a delete-one jackknife over blocks (Efron and Stein
1981).

With both signs wrong the divergence has the same size, so that this can't be detected. A quarter
turn is never certain either, as waves and tides diverge more than they rotate.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pipeline._types import FloatArray
from pipeline.geo.earth import EARTH_RADIUS_M
from pipeline.sources.quality.field import Field

# Blocks per side that the grid is divided into for the standard error.
_BLOCKS_PER_SIDE = 6
# Least number of blocks with moving water: with fewer the standard error means nothing.
_MIN_BLOCKS = 8
# Least number of corners between four cells of moving water.
_MIN_CORNERS = 40


@dataclass(frozen=True, slots=True)
class Variant:
    """A way in which the components may be mixed up, and how strongly the data say so.

    `contrast` is (own - variant) / (own + variant) of the mean squared divergences, -1 to 1;
    `certainty` is the contrast in its standard errors. Above 0 the variant diverges less than the
    field as it is.
    """

    name: str
    contrast: float
    certainty: float


FLIPPED = "one component has the wrong sign"
SWAPPED = "the components are swapped"
ROTATED = "the components are swapped and one has the wrong sign"


def likeliest_variant(field: Field) -> Variant | None:
    """Return the variant that diverges least; None where the field itself does, or too few data."""
    own = _divergence(field, field.u, field.v) ** 2
    moving = np.isfinite(own) & (_variation(field) > 0)
    if np.count_nonzero(moving) < _MIN_CORNERS:
        return None
    block = _block_numbers(own.shape)[moving]
    candidates = {
        FLIPPED: (-field.u, field.v),
        SWAPPED: (field.v, field.u),
        ROTATED: (field.v, -field.u),
    }
    sums = {
        name: _block_sums(block, (_divergence(field, *uv) ** 2)[moving])
        for name, uv in candidates.items()
    }
    own_sums = _block_sums(block, own[moving])
    name = min(sums, key=lambda name: float(sums[name].sum()))
    if sums[name].sum() >= own_sums.sum():
        return None
    return _variant(name, own_sums, sums[name])


def _variant(name: str, own: FloatArray, other: FloatArray) -> Variant | None:
    """Contrast and certainty from block sums (n,); None where too few blocks have moving water."""
    used = own + other > 0
    difference, total = (own - other)[used], (own + other)[used]
    count = len(total)
    if count < _MIN_BLOCKS:
        return None
    contrast = float(difference.sum() / total.sum())
    without_one = (difference.sum() - difference) / (total.sum() - total)
    error = np.sqrt((count - 1) / count * np.square(without_one - without_one.mean()).sum())
    return Variant(name, contrast, contrast / max(float(error), 1e-9))


def _divergence(field: Field, u: FloatArray, v: FloatArray) -> FloatArray:
    """Divergence (ny - 1, nx - 1) in 1/s at the corners between four cells; NaN beside land."""
    cosine = np.cos(np.radians(field.lat))[:, None]
    middle = (cosine[1:] + cosine[:-1]) / 2
    east = (u[1:, 1:] + u[:-1, 1:] - u[1:, :-1] - u[:-1, :-1]) / 2
    through = v * cosine
    north = (through[1:, 1:] + through[1:, :-1] - through[:-1, 1:] - through[:-1, :-1]) / 2
    dx = np.radians(np.diff(field.lon))[None, :]
    dy = np.radians(np.diff(field.lat))[:, None]
    return np.asarray((east / dx + north / dy) / (EARTH_RADIUS_M * middle))


def _block_sums(block: npt.NDArray[np.intp], values: FloatArray) -> FloatArray:
    """Sum of the values in each block (n,)."""
    return np.asarray(np.bincount(block, values, _BLOCKS_PER_SIDE**2), dtype=float)


def _variation(field: Field) -> FloatArray:
    """Squared differences (ny - 1, nx - 1) between the cells around a corner: 0 in still water."""
    total = np.zeros((field.lat.size - 1, field.lon.size - 1))
    for part in (field.u, field.v):
        for other in (part[1:, 1:], part[1:, :-1], part[:-1, 1:]):
            total += (other - part[:-1, :-1]) ** 2
    return total


def _block_numbers(shape: tuple[int, int]) -> npt.NDArray[np.intp]:
    """Number of the block that each corner lies in: (ny, nx)."""
    row, column = (np.arange(size) * _BLOCKS_PER_SIDE // size for size in shape)
    return np.asarray(row[:, None] * _BLOCKS_PER_SIDE + column[None, :])
