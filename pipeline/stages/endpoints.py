"""Start and goal must lie in water, and in the same water; where not, say where water is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.errors import RequestError

if TYPE_CHECKING:
    import renew
    from pipeline.geo.projection import Projection
    from pipeline.scenario.model import Scenario

# A suggested position goes this far beyond the nearest water (true metres), and is given to so many
# decimals of a degree.
_BEYOND_SHORE_M = (50.0, 200.0, 1000.0, 5000.0)
_DECIMALS = 4


def check_ends(scenario: Scenario, chart: renew.Chart, projection: Projection) -> None:
    """Refuse ends that are not in the water, or in waters that nothing joins."""
    water = shapely.get_parts(chart.water)
    faults: list[str] = []
    basins: list[set[int]] = []
    for name, given in _ends(scenario).items():
        xy = np.asarray(given, dtype=float) if scenario.is_planar else projection.to_plane(given)
        here = shapely.Point(xy)
        inside = set(np.flatnonzero(shapely.covers(water, here)).tolist())
        if inside:
            basins.append(inside)
        else:
            faults.append(_on_land(scenario, name, here, chart, projection))
    if not faults and not set.intersection(*basins):
        faults.append(_other_basin(scenario, water[min(basins[0])], projection))
    if faults:
        raise RequestError(faults)


def _on_land(
    scenario: Scenario, name: str, here: shapely.Point, chart: renew.Chart, projection: Projection
) -> str:
    """Say how far an end is from the water, and where that is."""
    away, place = _nearest(scenario, here, chart.water, projection)
    what = "land" if scenario.is_planar else "land, or within the margin around it"
    return (
        f"{name} = {list(_ends(scenario)[name])} lies on {what}, {away} from the nearest water at "
        f"{place}; move it there or beyond"
    )


def _other_basin(scenario: Scenario, basin: shapely.Geometry, projection: Projection) -> str:
    """Say that no water joins the ends, and where the start's water comes nearest to the goal."""
    goal = np.asarray(scenario.goal, dtype=float)
    here = shapely.Point(goal if scenario.is_planar else projection.to_plane(goal))
    away, place = _nearest(scenario, here, basin, projection)
    return (
        f"goal = {list(scenario.goal)} lies in another basin than start = {list(scenario.start)}: "
        f"no water joins them here. The start's waters come within {away} of it, at {place}; move "
        "the goal there"
        + ("" if scenario.is_planar else ", widen the region, or lower chart.join_gap_m")
    )


def _ends(scenario: Scenario) -> dict[str, tuple[float, float]]:
    """Both ends as given."""
    return {"start": scenario.start, "goal": scenario.goal}


def _nearest(
    scenario: Scenario, here: shapely.Point, water: shapely.Geometry, projection: Projection
) -> tuple[str, str]:
    """Distance to the water in words, and a place in it, as a scenario would give it."""
    line = shapely.get_coordinates(shapely.shortest_line(here, water))
    shore, here_xy = line[-1], line[0]
    if scenario.is_planar:
        return f"{np.linalg.norm(shore - here_xy):.4g} m", f"[{shore[0]:.6g}, {shore[1]:.6g}]"
    metres = projection.geodesic_length_m(line)
    ahead = (shore - here_xy) / max(float(np.linalg.norm(shore - here_xy)), 1e-12)
    away = f"{metres / 1000:.1f} km" if metres >= 1000 else f"{metres:.0f} m"
    # Beyond the shore, so that rounding does not bring it back on land.
    tries = [shore + ahead * beyond / projection.scale for beyond in _BEYOND_SHORE_M]
    rounded = [np.round(projection.to_lonlat(xy), _DECIMALS) for xy in [*tries, shore]]
    good = [at for at in rounded if water.covers(shapely.Point(projection.to_plane(at)))]
    lon, lat = (good or rounded[-1:])[0]
    return away, f"[{lon:.{_DECIMALS}f}, {lat:.{_DECIMALS}f}]"
