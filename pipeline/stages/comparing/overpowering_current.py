"""Reports water with a current as fast as the vessel, always or for some hours.

Both in the whole region, by the grid of the currents, and on the ways of a plan's classes, with the
hours at which the vessel may be there.
"""

from collections.abc import Callable, Iterable, Iterator
from datetime import datetime, timedelta
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry import Polygon

import renew
from pipeline._types import BoolArray, FloatArray
from pipeline.formats.shared.text import moment_text, moments_of, season_name
from pipeline.model import CurrentGrid, Scene, SeasonPlan
from renew.errors import Moment

# Time step at which a changing current is interpolated, s.
_STEP_S = 300.0
# Largest numbers of spells and of classes that a note names.
_MAX_SPELLS, _MAX_CLASSES = 3, 3


def overpowering_notes(
    grid: CurrentGrid, region: Polygon, speed_m_s: float, departure: datetime | None = None
) -> tuple[str, ...]:
    """Note the share of a region's water with an overpowering current, and its maximum.

    The region is in lon/lat degrees, the vessel's speed through water in m/s. A changing current
    may overpower the vessel for some hours only, which the note gives; the current's clock begins
    at the first departure. Empty if the current is slower than the vessel everywhere.
    """
    lon, lat = np.meshgrid(grid.lon, grid.lat)
    strength = np.hypot(grid.u, grid.v)
    is_water = np.isfinite(strength[0]) & shapely.contains_xy(region, lon, lat)
    always = is_water & (strength.min(axis=0) >= speed_m_s)
    sometimes = is_water & (strength.max(axis=0) >= speed_m_s) & ~always
    notes = []
    if always.any():
        where, most = _worst(grid, always)
        notes.append(
            f"{season_name(grid.season)}: in {_share(always, is_water, lat):.1%} of the water the "
            f"current is as fast as the vessel ({speed_m_s:g} m/s) or faster, up to {most:.2f} "
            f"m/s at {grid.lon[where[1]]:.2f} E {grid.lat[where[0]]:.2f} N: no route leads "
            "through it"
        )
    if sometimes.any() and departure is not None:
        where, most = _worst(grid, sometimes)
        notes.append(
            f"{season_name(grid.season)}: {_share(sometimes, is_water, lat):.1%} of the water is "
            f"shut for some hours by a current as fast as the vessel ({speed_m_s:g} m/s); where "
            f"it is strongest, up to {most:.2f} m/s at {grid.lon[where[1]]:.2f} E "
            f"{grid.lat[where[0]]:.2f} N, {_hours(grid, where, speed_m_s, departure)}: routes "
            "are the best without waiting"
        )
    return tuple(notes)


def waiting_notes(scene: Scene, plans: Iterable[SeasonPlan]) -> tuple[str, ...]:
    """Say at which hours the current shuts the ways of routes and of rejected classes."""
    return tuple(
        f"{season_name(plan.season)}: {note}" for plan in plans for note in _waiting(plan, scene)
    )


def _waiting(plan: SeasonPlan, scene: Scene) -> Iterator[str]:
    """Yield the notes of one season."""
    moments = moments_of(scene.departures.get(plan.season))
    routes = [
        f"route {rank} {_places(route.overpowered, scene, moments)}"
        for rank, route in enumerate(plan.ranked_routes, start=1)
        if route.overpowered
    ]
    if routes:
        yield (
            f"the current shuts water for a while on the way of {_named(routes)}. The routes are "
            "the best without waiting"
        )
    rejected = [
        f"class {one.homotopy} {_places(one.overpowered, scene, moments)}"
        for one in (plan.plan.rejected if plan.plan else ())
        if one.overpowered
    ]
    if rejected:
        yield (
            "without a route, and with water on the way that the current shuts for a while: "
            f"{_named(rejected)}. At another departure it may be open"
        )


def _named(classes: list[str]) -> str:
    """Name the first of some classes, and count the others."""
    more = f", and of {len(classes) - _MAX_CLASSES} more" if len(classes) > _MAX_CLASSES else ""
    return "; ".join(classes[:_MAX_CLASSES]) + more


def _places(
    hours: tuple[renew.OverpoweredHours, ...], scene: Scene, moments: Callable[[Moment], str]
) -> str:
    """Name the places of a way that are shut, with their hours."""
    places = [
        f"at {scene.place_text(one.place)}{one.text.spelled(moment=moments)}"
        for one in hours[:_MAX_SPELLS]
    ]
    more = f" and at {len(hours) - _MAX_SPELLS} more places" if len(hours) > _MAX_SPELLS else ""
    return ", ".join(places) + more


def _share(some: BoolArray, water: BoolArray, lat: FloatArray) -> float:
    """Share of water by area: a cell's width is proportional to the cosine of its latitude."""
    area = np.cos(np.radians(lat))
    return float(area[some].sum() / area[water].sum())


def _worst(grid: CurrentGrid, among: BoolArray) -> tuple[tuple[int, int], float]:
    """The node (row, column) among some with the strongest current at any time, and that (m/s)."""
    strongest = np.where(among, np.hypot(grid.u, grid.v).max(axis=0), -1.0)
    row, column = np.unravel_index(np.argmax(strongest), strongest.shape)
    return (int(row), int(column)), float(strongest[row, column])


def _hours(grid: CurrentGrid, where: tuple[int, int], speed_m_s: float, departure: datetime) -> str:
    """When the current at a node is as fast as the vessel, from the first departure on."""
    spells = [
        f"from {moment_text(departure + timedelta(seconds=begin))} until "
        f"{moment_text(departure + timedelta(seconds=end))}"
        for begin, end in _spells(grid, where, speed_m_s)
    ]
    more = f" and {len(spells) - _MAX_SPELLS} more times" if len(spells) > _MAX_SPELLS else ""
    return (
        "shut " + ", ".join(spells[:_MAX_SPELLS]) + more if spells else "before the vessel departs"
    )


def _spells(
    grid: CurrentGrid, where: tuple[int, int], speed_m_s: float
) -> Iterator[tuple[float, float]]:
    """Times (s) since departure between which the current at a node is as fast as the vessel."""
    times = np.arange(max(0.0, grid.times_s[0]), grid.times_s[-1] + _STEP_S / 2, _STEP_S)
    row, column = where
    u, v = (np.interp(times, grid.times_s, part[:, row, column]) for part in (grid.u, grid.v))
    is_shut = np.concatenate([[False], np.hypot(u, v) >= speed_m_s, [False]])
    turns = np.flatnonzero(np.diff(is_shut)).tolist()
    last = len(times) - 1
    for first, end in list(pairwise(turns))[::2]:
        yield float(times[first]), float(times[min(end, last)])
