"""Does a current lie where it should? Its gaps are held against the land, here and at offsets.

Gaps reach a little further than the land in many fields, ice and lakes make more of them, and
coarse cells blur the coast. None of that puts figures on dry land, and least of all on one side
only. So a field is shifted where cells that are wholly land have figures, and lose them at an
offset where the gaps fit the land better on the whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from pipeline.sources.quality.field import Field, Shore

    FloatArray = npt.NDArray[np.float64]
    BoolArray = npt.NDArray[np.bool_]

# Points of the land's raster a cell and side; offsets are tried at their step or coarser.
_PARTS = 4
# Offsets are looked for up to this far (degrees), and two cells at least, at so many steps a side.
_REACH_DEG = 1.5
_FEWEST_CELLS = 2
_STEPS = 8
# A region that is known no further than its edge can't be moved by more than this share of itself.
_LARGEST_SHARE = 1 / 6
# Cells with at least (most) this share of land are wholly land (water).
_LAND, _WATER = 0.95, 0.05
# Steps of an axis may differ by this share; on other grids an offset is no whole number of cells.
_IRREGULAR = 0.02


@dataclass(frozen=True, slots=True)
class Shift:
    """How far a field lies from its place: `east` and `north` in degrees, as it was moved.

    Of the `possible` cells of land that a move by so much would bring figures to, `explained` have
    figures that they have not once it is taken back.
    """

    east: float
    north: float
    explained: int
    possible: int

    @property
    def share(self) -> float:
        """Share of the figures on land that such a move would bring, up to 1."""
        return self.explained / max(self.possible, 1)


def shift(field: Field, shore: Shore) -> Shift | None:
    """Find the offset at which the field's gaps fit the land best; None where none does better."""
    window = _known(field, shore)
    if window is None:
        return None
    rows, columns, reach = window
    lon, lat, gap = field.lon[columns], field.lat[rows], field.gap[rows, columns]
    if gap.all() or not gap.any():
        return None
    ground = _Ground.around(lon, lat, field.cell, shore, reach)
    dry, wet = ground.wholly(0, 0)
    misplaced = int((dry & ~gap).sum() + (wet & gap).sum())
    best, found = misplaced, None
    stride = max(1, max(reach) // _STEPS)
    steps = [range(-most + most % stride, most + 1, stride) for most in reach]
    for east in steps[0]:
        for north in steps[1]:
            land, water = ground.wholly(east, north)
            left = int((land & ~gap).sum() + (water & gap).sum())
            if left < best:
                best = left
                explained = int((dry & ~gap).sum() - (land & ~gap).sum())
                found = (east, north, explained, int((dry & ~land).sum()))
    if found is None:
        return None
    east, north, explained, possible = found
    # The land fits at this offset: the field itself was moved the other way.
    return Shift(
        east=-east / _PARTS * field.cell[0],
        north=-north / _PARTS * field.cell[1],
        explained=explained,
        possible=possible,
    )


def _known(field: Field, shore: Shore) -> tuple[slice, slice, tuple[int, int]] | None:
    """Rows and columns that can be moved by a reach (raster points east, north) and stay known."""
    places, reaches = [], []
    sides = (shore.bounds[0::2], shore.bounds[1::2])
    for axis, cell, (low, high) in zip((field.lon, field.lat), field.cell, sides, strict=True):
        if np.abs(np.diff(axis) - cell).max() > _IRREGULAR * cell:
            return None
        span = min(float(axis[-1]), high) - max(float(axis[0]), low)
        furthest = max(_REACH_DEG, _FEWEST_CELLS * cell)
        if np.isfinite(high - low):
            furthest = min(furthest, _LARGEST_SHARE * span)
        cells = int(furthest / cell)
        margin = (cells + 0.5) * cell
        inside = np.flatnonzero((axis - margin >= low) & (axis + margin <= high))
        if cells < 1 or inside.size < 2:
            return None
        places.append(slice(int(inside[0]), int(inside[-1]) + 1))
        reaches.append(cells * _PARTS)
    return places[1], places[0], (reaches[0], reaches[1])


@dataclass(frozen=True, slots=True)
class _Ground:
    """Land under a grid as sums over a raster, so that any offset costs four look-ups a cell."""

    sums: FloatArray
    shape: tuple[int, int]
    reach: tuple[int, int]

    @classmethod
    def around(
        cls,
        lon: FloatArray,
        lat: FloatArray,
        cell: tuple[float, float],
        shore: Shore,
        reach: tuple[int, int],
    ) -> _Ground:
        """Sample the land in a grid's cells and `reach` raster points beyond them."""
        fine = [
            axis[0]
            - step / 2
            + step / _PARTS * (np.arange(axis.size * _PARTS + 2 * beyond) - beyond + 0.5)
            for axis, step, beyond in zip((lon, lat), cell, reach, strict=True)
        ]
        land = shore.cells(fine[0], fine[1])
        sums = np.zeros((land.shape[0] + 1, land.shape[1] + 1))
        sums[1:, 1:] = land.cumsum(axis=0).cumsum(axis=1)
        return cls(sums, (lat.size, lon.size), reach)

    def wholly(self, east: int, north: int) -> tuple[BoolArray, BoolArray]:
        """Cells (ny, nx) that are wholly land, and wholly water, so many raster points away."""
        ny, nx = self.shape
        row, column = self.reach[1] + north, self.reach[0] + east
        share = np.zeros(self.shape)
        for down, right, sign in ((_PARTS, _PARTS, 1), (0, 0, 1), (0, _PARTS, -1), (_PARTS, 0, -1)):
            begin_row, begin_column = row + down, column + right
            share += (
                sign
                * self.sums[
                    begin_row : begin_row + _PARTS * ny : _PARTS,
                    begin_column : begin_column + _PARTS * nx : _PARTS,
                ]
            )
        share /= _PARTS**2
        return share >= _LAND, share <= _WATER
