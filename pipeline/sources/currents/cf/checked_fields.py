"""The fields of a file, each looked at: speeds, directions, gaps, position.

They are read in a window wider than what is kept of them, one after the other, as all of them would
not fit in memory.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline._types import BoolArray, FloatArray
from pipeline.model.notes import Note
from pipeline.sources.currents.cf.contents import Contents
from pipeline.sources.currents.cf.grid import FieldReader, Window
from pipeline.sources.currents.cf.slices import SelectedSlices
from pipeline.sources.quality.coverage import Bounds
from pipeline.sources.quality.field import Field, LandMask
from pipeline.sources.quality.plausibility import (
    OFFSHORE_CELLS,
    Assessment,
    count_misplaced,
    dilated,
)
from pipeline.sources.quality.series import assess_series

# Speed limit, m/s: tides in the narrowest straits come near it, no water is faster.
_SPEED_LIMIT_M_S = 10.0
# Share of the region's open water without data above which a file is refused; smaller gaps are
# filled from the water around.
_GAP_FAULT_SHARE = 0.2
# Share of the cells far inland with data, from which the field's gaps say nothing of its position.
_FILLED_LAND_SHARE = 0.5
# Zeros mean "no data" where at least this share of land and at most this share of water is zero.
_MIN_ZERO_LAND_SHARE, _MAX_ZERO_WATER_SHARE = 0.9, 0.01


@dataclass(frozen=True)
class CheckedFields:
    """The fields on the kept part of the grid, what was found, and the first one in the window.

    `lon` (nx,) and `lat` (ny,) are in degrees, `u` and `v` (nt, ny, nx) in m/s.
    """

    lon: FloatArray
    lat: FloatArray
    u: FloatArray
    v: FloatArray
    wide: Field
    assessment: Assessment
    notes: tuple[Note, ...]


def read_checked_fields(
    contents: Contents,
    slices: SelectedSlices,
    window: Window,
    mask: LandMask,
    bounds: Bounds,
    region: Bounds,
) -> CheckedFields:
    """Read fields in a window, look at each, and keep what lies inside `bounds`.

    Raises
    ------
    ValueError
        The file is damaged.
    """
    kept: list[Field] = []
    with FieldReader(contents, window) as reader:
        first = reader.field(slices.weights[0])
        last = reader.field(slices.weights[-1]) if len(slices.weights) > 1 else first
        zeros, notes = _zeros_on_land((first, last), mask)
        first = _without(first, zeros)

        def fields() -> Iterator[Field]:
            for weights in slices.weights:
                wide = _without(reader.field(weights), zeros) if kept else first
                kept.append(_cropped(wide, bounds))
                yield wide

        assessment = assess_series(fields(), slices.labels, mask, _SPEED_LIMIT_M_S)
    assessment += _assess_gaps(first, mask, region)
    if kept[0].gap.all():
        assessment += Assessment(("it has no data in the region",))
    u, v = (np.stack([getattr(field, name) for field in kept]) for name in "uv")
    return CheckedFields(kept[0].lon, kept[0].lat, u, v, first, assessment, notes)


def _cropped(field: Field, bounds: Bounds) -> Field:
    """Part of a field inside bounds."""
    west, south, east, north = bounds
    x = (field.lon >= west) & (field.lon <= east)
    y = (field.lat >= south) & (field.lat <= north)
    return Field(field.lon[x], field.lat[y], field.u[np.ix_(y, x)], field.v[np.ix_(y, x)])


def _zeros_on_land(
    fields: Sequence[Field], mask: LandMask
) -> tuple[BoolArray | None, tuple[Note, ...]]:
    """Cells (ny, nx) whose zeros stand for land, as they would slow the water beside it; a note.

    Those that are zero in each of some fields: where the water turns it stands still for a while.
    """
    zero = np.logical_and.reduce([(field.u == 0) & (field.v == 0) for field in fields])
    if not zero.any():
        return None, ()
    is_land = mask.on_grid(fields[0].lon, fields[0].lat)
    water = ~dilated(is_land, OFFSHORE_CELLS)
    if not is_land.any() or zero[is_land].mean() < _MIN_ZERO_LAND_SHARE or not water.any():
        return None, ()
    if zero[water].mean() > _MAX_ZERO_WATER_SHARE:
        return None, ()
    return zero, (Note.of("zeros-are-land"),)


def _without(field: Field, cells: BoolArray | None) -> Field:
    """A field with gaps in place of some cells (ny, nx)."""
    if cells is None:
        return field
    u, v = (np.where(cells, np.nan, part) for part in (field.u, field.v))
    return Field(field.lon, field.lat, u, v)


def _assess_gaps(field: Field, mask: LandMask, region: Bounds) -> Assessment:
    """Whether the region's open water has data, and its land has none."""
    (gaps, water), (inland, dry) = count_misplaced(field, mask, region)
    warnings: tuple[str, ...] = ()
    if inland > _FILLED_LAND_SHARE * max(dry, 1):
        warnings = ("it has data on land, so that a shift can't be detected",)
    share = gaps / max(water, 1)
    if share <= _GAP_FAULT_SHARE:
        return Assessment((), warnings)
    message = f"{share:.0%} of the region's open water has no data, which is too much to fill"
    return Assessment((message,), warnings)
