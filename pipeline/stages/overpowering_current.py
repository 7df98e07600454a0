"""Report the water whose current is as fast as the vessel: no route leads through it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely

if TYPE_CHECKING:
    from shapely.geometry import Polygon

    from pipeline.model import CurrentGrid


def overpowering_notes(grid: CurrentGrid, region: Polygon, speed_m_s: float) -> tuple[str, ...]:
    """Note the share of a region's water with an overpowering current, and its maximum.

    The region is in lon/lat degrees, the vessel's speed through water in m/s. Of a current that
    changes, what it is at its weakest counts: other water is open for a while. Empty where the
    current is slower than the vessel everywhere.
    """
    lon, lat = np.meshgrid(grid.lon, grid.lat)
    strength = np.hypot(grid.u, grid.v).min(axis=0)
    is_water = np.isfinite(strength) & shapely.contains_xy(region, lon, lat)
    overpowers = is_water & (strength >= speed_m_s)
    if not overpowers.any():
        return ()
    # A grid cell's width is proportional to the cosine of its latitude.
    area = np.cos(np.radians(lat))
    share = area[overpowers].sum() / area[is_water].sum()
    peak = np.unravel_index(np.argmax(np.where(is_water, strength, -1.0)), strength.shape)
    note = (
        f"{grid.season}: in {share:.1%} of the water the current is as fast as the vessel "
        f"({speed_m_s:g} m/s) or faster, up to {strength[peak]:.2f} m/s at {lon[peak]:.2f} E "
        f"{lat[peak]:.2f} N: no route leads through it"
    )
    return (note,)
