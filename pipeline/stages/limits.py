"""Water that wind or waves shut: cells and hours over a limit, worst values met, and notes on them.

A cell of a field is shut from one time step to the next if one of its four corners is over the
limit at either of the two: no value between them, linear in place and time, is then over the limit
in a cell that is open. The same cells and hours are shut early and late, like any area with hours.
After the last time step nothing is known, so all water is shut.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from datetime import timedelta
from typing import Any

import numpy as np
import shapely

import renew
from pipeline._types import BoolArray, FloatArray
from pipeline.geo.projection import Projection
from pipeline.model import Case, CaseResult, CurrentGrid, Note
from pipeline.model.inputs import LimitedField
from pipeline.scenario.catalogue import VesselLimits
from pipeline.scenario.model import Scenario
from renew.inputs.openings import OverLimit
from renew.inputs.options import Drift
from renew.voyage.fuel import passage

# Largest number of cells along either axis: cells of a finer field are joined, and a joined cell is
# shut while one of them is. It limits the number of areas to what a plan can look at.
_MOST_CELLS = 48
# Spacing of the points of a route at which the weather is looked up, as a share of its length.
_SPACING = 1 / 2_000


# What messages call the fields, by the keys of their limits; the unit of each.
_NAMES = {
    "wave_m": ("waves", "m"),
    "period_s": ("wave periods", "s"),
    "wind_m_s": ("wind", "m/s"),
    "gust_m_s": ("gusts", "m/s"),
}


def limited_fields(
    grids: Mapping[str, CurrentGrid], limits: VesselLimits
) -> tuple[LimitedField, ...]:
    """Return fields (by the keys of their limits) with the values that are held against these."""
    found = []
    for key in (name for name in _NAMES if name in grids):
        grid, limit = grids[key], getattr(limits, key)
        size = np.hypot(grid.u, grid.v)
        found.append(LimitedField(*_NAMES[key], limit, grid.lon, grid.lat, grid.times_s, size))
    return tuple(found)


def over_limits(
    fields: Sequence[LimitedField], projection: Projection, extent: shapely.Polygon
) -> Iterator[OverLimit]:
    """Yield the water in the plane that fields shut, with its hours."""
    for field in fields:
        lon, lat, values = _joined(field)
        corner = np.maximum(values[:, 1:], values[:, :-1])
        corner = np.maximum(corner[:, :, 1:], corner[:, :, :-1])
        worst = np.maximum(corner[1:], corner[:-1])
        nodes = projection.to_plane(np.stack(np.meshgrid(lon, lat), axis=-1))
        rings = np.stack([nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]], axis=2)
        for row, column, first, last in _spells(worst > field.limit):
            begin, end = field.times_s[[first, last]].tolist()
            if not first:
                begin = -math.inf
            cell = shapely.Polygon(rings[row, column])
            if cell.intersects(extent):
                most = float(worst[first:last, row, column].max())
                yield OverLimit(cell, begin, end, field.name, most, field.unit)
        end = float(field.times_s[-1])
        yield OverLimit(shapely.Polygon(extent.exterior), end, name=field.name, unit=field.unit)


def _joined(field: LimitedField) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the axes and values (nt, ny, nx) of a field on at most so many cells, from outside in.

    The outermost values count half a cell further, as far as the field's cells reach.
    """
    axes, values = [], field.values
    for axis, number in ((field.lon, 2), (field.lat, 1)):
        step = math.ceil((len(axis) - 1) / _MOST_CELLS)
        # The largest value of the nodes around each node that is kept, and the last node.
        kept = np.unique([*range(0, len(axis), step), len(axis) - 1])
        parts = [
            values.take(range(max(0, at - step), min(len(axis), at + step + 1)), number)
            for at in kept.tolist()
        ]
        if step > 1:
            values = np.stack([part.max(axis=number) for part in parts], axis=number)
        first, last = (axis[1] - axis[0]) / 2, (axis[-1] - axis[-2]) / 2
        axes.append(np.concatenate([[axis[0] - first], axis[kept], [axis[-1] + last]]))
        values = np.pad(values, [(int(k == number),) * 2 for k in range(3)], mode="edge")
    return axes[0], axes[1], values


def _spells(shut: BoolArray) -> Iterator[tuple[int, int, int, int]]:
    """Yield row, column, first and last time step of each spell of (nt - 1, ny, nx) shut steps."""
    closed = np.zeros((1, *shut.shape[1:]), dtype=np.int8)
    change = np.diff(shut.astype(np.int8), axis=0, prepend=closed, append=closed)
    begins = np.argwhere(np.moveaxis(change, 0, -1) == 1)
    ends = np.argwhere(np.moveaxis(change, 0, -1) == -1)
    for (row, column, first), last in zip(begins.tolist(), ends[:, 2].tolist(), strict=True):
        yield row, column, first, last


# Columns of a route's figures by a field's name: what begins them, and the unit that ends them.
_COLUMNS = {"waves": ("wave", "m"), "wind": ("wind", "m_s")}


def worst_met(case: Case, route: renew.Route, drift: Drift) -> dict[str, Any]:
    """Return the worst waves and wind on a route on time, when and where, and what is left.

    In members of the current it is the share of them, by weight, in which a limit is exceeded.
    """
    worst = dict[str, Any]()
    line = shapely.LineString(route.path)
    points = shapely.get_coordinates(shapely.segmentize(line, _SPACING * line.length))
    along = shapely.line_locate_point(line, shapely.points(points))
    passed = shapely.line_locate_point(line, shapely.points(route.path))
    times, lonlat = np.interp(along, passed, route.times), case.projection.to_lonlat(points)
    for field in case.weather:
        if field.name in _COLUMNS and case.departure is not None:
            name, unit = _COLUMNS[field.name]
            values = field.at(lonlat, times)
            at = int(values.argmax())
            worst |= {
                f"worst_{name}_{unit}": float(values[at]),
                f"worst_{name}_at": case.departure + timedelta(seconds=round(float(times[at]))),
                f"worst_{name}_lon": float(lonlat[at, 0]),
                f"worst_{name}_lat": float(lonlat[at, 1]),
                f"{name}_headroom_{unit}": field.limit - float(values[at]),
            }
    if case.members is not None and case.weather:
        over = list[bool]()
        for current in case.members.currents:
            taken = passage(points, current, case.vessel, drift=drift, chart=case.chart).durations
            when = np.append(0.0, np.cumsum(taken))
            over.append(any((one.at(lonlat, when) > one.limit).any() for one in case.weather))
        share = float(np.average(over, weights=case.members.weights))
        worst["members_over_limit_share"] = share
    return worst


def limit_notes(scenario: Scenario, planned: Sequence[tuple[Case, CaseResult]]) -> Iterator[Note]:
    """Yield notes on limits that bind, or that nothing was held against."""
    if scenario.limits is None and scenario.vessel.limits is not None:
        yield Note.of("limits-unchecked", vessel=scenario.vessel.label or "the vessel")
    for case, result in planned:
        met = () if result.plan is None else result.plan.shut
        known = [one for one in met if isinstance(one, OverLimit) and math.isfinite(one.most)]
        for field in case.weather:
            if own := [one for one in known if one.name == field.name]:
                yield Note.of(
                    "over-limit",
                    name=field.name,
                    limit=field.limit,
                    unit=field.unit,
                    most=max(area.most for area in own),
                    begin=case.moment(min(area.begin for area in own)),
                    until=case.moment(max(area.end for area in own)),
                ).about(case.name)
