"""The fields of a file, each looked at: speeds, directions, gaps, position.

They are read in a window wider than what is kept of them, one after the other, as all of them would
not fit in memory.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pipeline.sources.currents.cf.grid import read_field
from pipeline.sources.quality.field import Field
from pipeline.sources.quality.plausibility import (
    OFFSHORE_CELLS,
    Assessment,
    assess_directions,
    assess_position,
    assess_speeds,
    count_misplaced,
    dilated,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from pipeline.sources.currents.cf.contents import Contents
    from pipeline.sources.currents.cf.grid import Window
    from pipeline.sources.currents.cf.slices import SelectedSlices
    from pipeline.sources.quality.coverage import Bounds
    from pipeline.sources.quality.field import LandMask

    FloatArray = npt.NDArray[np.float64]
    BoolArray = npt.NDArray[np.bool_]

# Speed limit, m/s: tides in the narrowest straits come near it, no water is faster.
_SPEED_LIMIT_M_S = 10.0
# Share of the region's open water without data above which a file is refused; smaller gaps are
# filled from the water around.
_GAP_FAULT_SHARE = 0.2
# Share of the cells far inland with data, from which the field's gaps say nothing of its position.
_FILLED_LAND_SHARE = 0.5
# Zeros mean "no data" where at least this share of land and at most this share of water is zero.
_MIN_ZERO_LAND_SHARE, _MAX_ZERO_WATER_SHARE = 0.9, 0.01
# Largest number of times that a message names.
_MAX_TIMES = 3


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
    notes: tuple[str, ...]


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
    first = read_field(contents, slices.weights[0], window)
    last = read_field(contents, slices.weights[-1], window) if len(slices.weights) > 1 else first
    zeros, notes = _zeros_on_land((first, last), mask)
    first = _without(first, zeros)
    kept: list[Field] = []
    speeds: list[Assessment] = []
    directions: list[Assessment] = []
    changed: dict[str, int] = {}
    for label, weights in zip(slices.labels, slices.weights, strict=True):
        wide = _without(read_field(contents, weights, window), zeros) if kept else first
        speeds.append(assess_speeds(wide, _SPEED_LIMIT_M_S))
        directions.append(Assessment() if speeds[-1].faults else assess_directions(wide))
        if cells := int((wide.gap != first.gap).sum()):
            changed[label] = cells
        kept.append(_cropped(wide, bounds))
    assessment = _at_times(speeds, slices.labels)
    if not assessment.faults:
        assessment += assess_position(first, mask) + _at_most_times(directions)
    assessment += _assess_changed_gaps(changed, slices.labels[0])
    assessment += _assess_gaps(first, mask, region)
    if kept[0].gap.all():
        assessment += Assessment(("it has no data in the region",))
    u, v = (np.stack([getattr(field, name) for field in kept]) for name in "uv")
    return CheckedFields(kept[0].lon, kept[0].lat, u, v, first, assessment, notes)


def _at_times(each: Sequence[Assessment], labels: Sequence[str]) -> Assessment:
    """What is wrong at the times of some fields, each with its time."""
    if len(each) == 1:
        return each[0]
    times = list(zip(each, labels, strict=True))
    faults = [f"at {label} {fault}" for one, label in times for fault in one.faults]
    warnings = [f"at {label} {warning}" for one, label in times for warning in one.warnings]
    return Assessment(_first_few(faults), _first_few(warnings))


def _at_most_times(each: Sequence[Assessment]) -> Assessment:
    """What is wrong with the directions of some fields, if it is so at most of their times.

    Water that is just turning may look as if it ran the wrong way.
    """
    wrong = [one for one in each if one.faults]
    doubtful = [one for one in each if one.warnings]
    for some in (wrong, doubtful):
        if 2 * len(some) > len(each):
            return some[0]
    return Assessment()


def _first_few(messages: Sequence[str]) -> tuple[str, ...]:
    """The first messages, and how many more there are."""
    more = len(messages) - _MAX_TIMES
    return (*messages[:_MAX_TIMES], *([f"and so at {more} other times"] if more > 0 else []))


def _assess_changed_gaps(changed: dict[str, int], first: str) -> Assessment:
    """Whether all fields have data in the same cells; `changed` are cells that differ, by time."""
    faults = [
        f"{cells} cells have data either at {label} or at {first}, not at both: its land and its "
        "gaps must be the same at all times"
        for label, cells in changed.items()
    ]
    return Assessment(_first_few(faults))


def _cropped(field: Field, bounds: Bounds) -> Field:
    """Part of a field inside bounds."""
    west, south, east, north = bounds
    x = (field.lon >= west) & (field.lon <= east)
    y = (field.lat >= south) & (field.lat <= north)
    return Field(field.lon[x], field.lat[y], field.u[np.ix_(y, x)], field.v[np.ix_(y, x)])


def _zeros_on_land(
    fields: Sequence[Field], mask: LandMask
) -> tuple[BoolArray | None, tuple[str, ...]]:
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
    return zero, ("zeros in the file are treated as land",)


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
