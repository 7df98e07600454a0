"""A case's current as GRIB 1, which plotter programs such as OpenCPN draw over the chart.

Written here and not by a library: the format is a few bytes, all values have 16 bits, and whoever
takes a route to a plotter need not install ecCodes, of 175 MB. Source: the WMO's Manual on Codes
(I.2: FM 92 GRIB, edition 1). OpenCPN needs the components as 49 and 50, and takes fields that are
packed in no bits, as libraries write those of one value, for noise.
"""

import math
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from pipeline._types import BoolArray, FloatArray, IndexArray
from pipeline.findings.result import RunCase
from pipeline.formats.records import valid_period
from pipeline.model import CurrentGrid
from renew.inputs.current import as_field

# Nodes per cell of the source along each axis, as of the planner's grid, and their largest number:
# more make the overlay of a plotter slow.
_NODES_PER_CELL, _MAX_NODES = 2, 250_000
# Difference below which a coordinate counts as a whole number of steps, millidegrees.
_ROUNDING = 1e-6
# The components in version 2 of table 2.
_TABLE, _PARAMETERS = 2, (49, 50)
# Codes: a missing centre, process or grid; a level; a unit of time; flags.
_NONE, _SURFACE, _HOURS = 255, 1, 1
_HAS_GRID_AND_BITMAP, _HAS_STEPS, _NORTHWARDS, _PADDED = 0xC0, 0x80, 0x40, 0x08
# Bits of a packed value, and the least span that they cover, m/s.
_BITS, _LEAST_SPAN_M_S = 16, 1e-6


def fields_from(case: RunCase) -> datetime | None:
    """Return when a case's current begins: the zero of its clock, or when a steady one is given.

    A steady current is given for the departure, or without one for the middle of the period that
    its values represent; None where neither is known.
    """
    departure = case.case.departure or case.spec.departure
    if departure is not None:
        return departure.astimezone(UTC)
    valid = valid_period(case.source_grid)
    return valid.begin + (valid.end - valid.begin) / 2 if valid else None


def write_grib(case: RunCase, path: Path) -> None:
    """Write the current of a case that has a grid, and a time, to a new file at `path`.

    The nodes are a regular grid in degrees, with the planner's current there; those outside its
    chart, and those for which the source has no figure, have no value.
    """
    begin, grid, planned = fields_from(case), case.source_grid, case.case
    if begin is None:
        raise ValueError(f"the current of {case.name!r} has no time")
    projection = planned.projection
    lon, lat = _axes_mdeg(grid)
    lonlat = np.stack(np.meshgrid(lon / 1000, lat / 1000), axis=-1)
    xy = projection.to_plane(lonlat)
    xmin, ymin, xmax, ymax = planned.chart.bounds
    known = grid.cells.at(lonlat.reshape(-1, 2)).reshape(lonlat.shape[:2])
    known &= ((xy >= (xmin, ymin)) & (xy <= (xmax, ymax))).all(axis=-1)
    field = as_field(planned.current)
    with path.open("wb") as file:
        for seconds in field.slice_times:
            planar = field.velocity(xy, float(seconds))
            east_north = projection.rotate_to_lonlat(lonlat, planar)
            time = begin + timedelta(minutes=round(float(seconds) / 60))
            for number, values in zip(_PARAMETERS, np.moveaxis(east_north, -1, 0), strict=True):
                file.write(_message(number, time, lon, lat, values, known))


def _axes_mdeg(grid: CurrentGrid) -> tuple[IndexArray, IndexArray]:
    """Return a grid of nodes, whole millidegrees, over that of the source."""
    spans = [(float(axis[0]), float(axis[-1]), axis.size) for axis in (grid.lon, grid.lat)]
    nodes = [_NODES_PER_CELL * (count - 1) for _, _, count in spans]
    fewer = max(1.0, math.sqrt(math.prod(nodes) / _MAX_NODES))
    axes = []
    for (first, last, _), count in zip(spans, nodes, strict=True):
        step = math.ceil(1000 * (last - first) / count * fewer - _ROUNDING)
        begin = step * math.ceil(1000 * first / step - _ROUNDING)
        axes.append(np.arange(begin, 1000 * last + _ROUNDING, step).astype(np.intp))
    return axes[0], axes[1]


def _message(
    number: int,
    time: datetime,
    lon_mdeg: IndexArray,
    lat_mdeg: IndexArray,
    values: FloatArray,
    known: BoolArray,
) -> bytes:
    """Encode a component (ny, nx), m/s, whose values are known at some nodes."""
    sections = b"".join(
        [
            _product(number, time),
            _grid_section(lon_mdeg, lat_mdeg),
            _bitmap(known),
            _data(values[known]),
            b"7777",
        ]
    )
    return b"GRIB" + _whole(8 + len(sections), 3) + b"\1" + sections


def _product(number: int, time: datetime) -> bytes:
    """Encode what a field is: a component at the surface, at a time."""
    century, year = divmod(time.year - 1, 100)
    fields = [_TABLE, _NONE, _NONE, _NONE, _HAS_GRID_AND_BITMAP, number, _SURFACE, 0, 0]
    fields += [year + 1, time.month, time.day, time.hour, time.minute, _HOURS, 0, 0, 0, 0, 0, 0]
    return _section(bytes([*fields, century + 1, 0, 0, 0]))


def _grid_section(lon_mdeg: IndexArray, lat_mdeg: IndexArray) -> bytes:
    """Encode a regular grid whose rows run to the east, and from south to north."""
    first, last = (
        b"".join(_signed(int(axis[end]), 3) for axis in (lat_mdeg, lon_mdeg)) for end in (0, -1)
    )
    sizes, steps = (
        b"".join(_whole(int(one), 2) for one in pair)
        for pair in ((lon_mdeg.size, lat_mdeg.size), (np.diff(lon_mdeg)[0], np.diff(lat_mdeg)[0]))
    )
    plain = bytes([0, _NONE, 0]) + sizes + first + bytes([_HAS_STEPS]) + last + steps
    return _section(plain + bytes([_NORTHWARDS, 0, 0, 0, 0]))


def _bitmap(known: BoolArray) -> bytes:
    """Encode which nodes have a value."""
    bits = np.packbits(known.reshape(-1)).tobytes()
    padding = len(bits) % 2
    return _section(bytes([8 * (len(bits) + padding) - known.size, 0, 0]) + bits + b"\0" * padding)


def _data(values: FloatArray) -> bytes:
    """Pack values (n,) as multiples of a power of two above a reference."""
    least, reference = _ibm_below(float(values.min()))
    span = max(float(values.max()) - least, _LEAST_SPAN_M_S)
    power = math.ceil(math.log2(span / (2**_BITS - 1)))
    packed = np.rint((values - least) / 2.0**power).astype(">u2").tobytes()
    # A byte makes the section's length even.
    return _section(
        bytes([_PADDED]) + _signed(power, 2) + reference + bytes([_BITS]) + packed + b"\0"
    )


def _ibm_below(value: float) -> tuple[float, bytes]:
    """Return the largest IBM number of 32 bits up to a value, and its bytes."""
    power = max(math.floor(math.log(abs(value), 16)) + 1, -64) if value else 0
    fraction = math.floor(value / 16.0**power * 2**24)
    if fraction == -(2**24):
        power, fraction = power + 1, -(2**20)
    sign = 0x80 * (fraction < 0)
    return fraction / 2**24 * 16.0**power, bytes([sign + power + 64]) + _whole(abs(fraction), 3)


def _section(content: bytes) -> bytes:
    """Return a section: its length, then its content."""
    return _whole(3 + len(content), 3) + content


def _whole(number: int, size: int) -> bytes:
    """Encode a whole number that is not negative."""
    return number.to_bytes(size, "big")


def _signed(number: int, size: int) -> bytes:
    """Encode a whole number as its sign and its size."""
    sign = (number < 0) << (8 * size - 1)
    return _whole(abs(number) + sign, size)
