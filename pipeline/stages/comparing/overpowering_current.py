"""Report water where the current is at least as fast as the vessel, always or for some hours.

One report covers the whole region, at the nodes of the currents' grid. The other covers the ways of
a plan's classes, during the hours when the vessel may be there.
"""

from collections.abc import Iterable, Iterator
from datetime import datetime, timedelta
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry import Polygon

import renew
from pipeline._types import BoolArray, FloatArray
from pipeline.model import CurrentGrid, Note, Place, Scene, SeasonPlan

# Time step for the interpolation of a changing current, s.
_STEP_S = 300.0


def overpowering_notes(
    grid: CurrentGrid, region: Polygon, speed_m_s: float, departure: datetime | None = None
) -> Iterator[Note]:
    """Yield notes on the share of a region's water with an overpowering current, and its maximum.

    The region is in lon/lat degrees, the vessel's speed through water in m/s. `departure` is the
    first departure, from which the current's times are counted. If a changing current overpowers
    the vessel only for some hours, the note lists them.
    """
    lon, lat = np.meshgrid(grid.lon, grid.lat)
    strength = np.hypot(grid.u, grid.v)
    is_water = np.isfinite(strength[0]) & shapely.contains_xy(region, lon, lat)
    always = is_water & (strength.min(axis=0) >= speed_m_s)
    sometimes = is_water & (strength.max(axis=0) >= speed_m_s) & ~always
    for kind, cells in (("water-shut", always), ("water-shut-for-hours", sometimes)):
        if not cells.any() or (cells is sometimes and departure is None):
            continue
        (row, column), most_m_s = _worst(grid, cells)
        yield Note.of(
            kind,
            share=_share(cells, is_water, lat),
            speed_m_s=speed_m_s,
            most_m_s=most_m_s,
            place=Place(float(grid.lon[column]), float(grid.lat[row])),
            hours=tuple(
                tuple(departure + timedelta(seconds=end) for end in spell)
                for spell in _spells(grid, (row, column), speed_m_s)
            )
            if departure
            else (),
        ).about(grid.season)


def waiting_notes(scene: Scene, plans: Iterable[SeasonPlan]) -> Iterator[Note]:
    """Yield notes on the hours when the current blocks ways of routes or of rejected classes."""
    for plan in plans:
        routes = {f"route {rank}": one for rank, one in enumerate(plan.ranked_routes, start=1)}
        rejected = plan.plan.rejected if plan.plan else ()
        classes = {f"class {one.homotopy}": one for one in rejected}
        for kind, ways in (("routes-shut-for-hours", routes), ("classes-shut-for-hours", classes)):
            shut = tuple(
                Note.of("way-shut", way=name, places=_places(one.overpowered, scene, plan.season))
                for name, one in ways.items()
                if one.overpowered
            )
            if shut:
                yield Note.of(kind, ways=shut).about(plan.season)


def _places(hours: Iterable[renew.OverpoweredHours], scene: Scene, season: str) -> tuple[Note, ...]:
    """Return the places where the current blocks a way, each with its hours."""
    return tuple(
        Note.of(
            "place-shut",
            place=scene.place(one.place),
            begin=scene.moment(season, one.begin),
            until=scene.moment(season, one.end),
        )
        for one in hours
    )


def _share(some: BoolArray, water: BoolArray, lat: FloatArray) -> float:
    """Return the share of the water's area in some cells; a cell's width scales with cos(lat)."""
    area = np.cos(np.radians(lat))
    return float(area[some].sum() / area[water].sum())


def _worst(grid: CurrentGrid, among: BoolArray) -> tuple[tuple[int, int], float]:
    """Return the node (row, column) in `among` with the strongest current, and its speed, m/s."""
    strongest = np.where(among, np.hypot(grid.u, grid.v).max(axis=0), -1.0)
    row, column = np.unravel_index(np.argmax(strongest), strongest.shape)
    return (int(row), int(column)), float(strongest[row, column])


def _spells(
    grid: CurrentGrid, where: tuple[int, int], speed_m_s: float
) -> Iterator[tuple[float, float]]:
    """Yield begin and end, s since departure, of periods when the node's current is too fast."""
    times = np.arange(max(0.0, grid.times_s[0]), grid.times_s[-1] + _STEP_S / 2, _STEP_S)
    row, column = where
    u, v = (np.interp(times, grid.times_s, part[:, row, column]) for part in (grid.u, grid.v))
    is_shut = np.concatenate([[False], np.hypot(u, v) >= speed_m_s, [False]])
    turns = np.flatnonzero(np.diff(is_shut)).tolist()
    last = len(times) - 1
    for first, end in list(pairwise(turns))[::2]:
        yield float(times[first]), float(times[min(end, last)])
