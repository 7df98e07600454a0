"""Where the current outruns the vessel: no-go for it, whichever way the water flows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely

if TYPE_CHECKING:
    from shapely.geometry import Polygon

    from pipeline.model import CurrentGrid


def outrun_note(grid: CurrentGrid, region: Polygon, speed_m_s: float) -> tuple[str, ...]:
    """Say how much of a region's water outruns a vessel, and where most; nothing where none does.

    The region is in lon/lat degrees, the vessel's speed through water in m/s.
    """
    lon, lat = np.meshgrid(grid.lon, grid.lat)
    strength = np.hypot(grid.u, grid.v)
    there = np.isfinite(strength) & shapely.contains_xy(region, lon, lat)
    strong = there & (strength >= speed_m_s)
    if not strong.any():
        return ()
    # Cells of a grid in degrees are as wide as the cosine of their latitude.
    area = np.cos(np.radians(lat))
    share = area[strong].sum() / area[there].sum()
    peak = np.unravel_index(np.argmax(np.where(there, strength, -1.0)), strength.shape)
    told = (
        f"{grid.season}: in {share:.1%} of the water the current is as fast as the vessel "
        f"({speed_m_s:g} m/s) or faster, up to {strength[peak]:.2f} m/s at {lon[peak]:.2f} E "
        f"{lat[peak]:.2f} N: no route leads through it"
    )
    return (told,)
