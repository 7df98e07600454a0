"""Currents written by the tests, and how readers see them."""

import warnings
from dataclasses import replace
from pathlib import Path

import netCDF4
import numpy as np
import pyproj
import shapely
import xarray as xr

from pipeline.findings.result import RunResult
from pipeline.model import CurrentGrid
from pipeline.stages.project import planar_current

_MEDIUM = 2  # compliance_checker's weights: 3 is high, 2 medium, 1 low


def with_grids(result: RunResult, *grids: CurrentGrid) -> RunResult:
    """The same run, planned with other currents (but for its routes)."""
    water = result.water
    planned = {
        grid.case: replace(
            result.planned[grid.case],
            current=planar_current(grid, water.projection, water.chart.bounds),
        )
        for grid in grids
    }
    fetched = replace(result.fetched, currents=grids)
    return replace(result, fetched=fetched, planned={**result.planned, **planned})


def in_file(file: xr.Dataset, lonlat: np.ndarray, time: xr.DataArray | None = None) -> np.ndarray:
    """East and north (n, 2) at points (n, 2) by what the file alone says, interpolated linearly."""
    plane = pyproj.Transformer.from_crs("EPSG:4326", file.crs.crs_wkt, always_xy=True)
    x, y = (xr.DataArray(axis, dims="point") for axis in plane.transform(*lonlat.T))
    when = {} if time is None else {"time": time}
    found = file[["uo", "vo"]].interp({"x": x, "y": y, **when})
    return np.stack([found.uo, found.vo], axis=-1)


def along_routes(result: RunResult, season: str, count: int) -> np.ndarray:
    """Random points (count, 2), planar metres, along a season's routes."""
    rng = np.random.default_rng(35)
    routes = [shapely.LineString(one.route.path) for one in result.case(season).routes]
    shares = rng.random((count, 2))
    lines = np.array(routes, dtype=object)[(shares[:, 0] * len(routes)).astype(int)]
    points = shapely.line_interpolate_point(lines, shares[:, 1], normalized=True)
    return np.asarray(shapely.get_coordinates(points))


def planners(
    result: RunResult, season: str, xy: np.ndarray, time: float | np.ndarray = 0.0
) -> np.ndarray:
    """The planner's own current (n, 2), to east and to north, at points (n, 2) of its plane."""
    projection = result.water.projection
    velocity = result.case(season).case.current.velocity(xy, time)
    return projection.rotate_to_lonlat(projection.to_lonlat(xy), velocity)


def faults(path: Path) -> list[str]:
    """Faults of high and medium weight that the CF checker of IOOS finds in a file.

    It has its own table of standard names, so it needs no connection.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own and its libraries' deprecations
        from compliance_checker.runner import CheckSuite

        suite = CheckSuite()
        suite.load_all_available_checkers()
        with netCDF4.Dataset(path) as dataset:
            found = suite.run_all(dataset, ["cf:1.11"])
    [(groups, errors)] = found.values()
    assert not errors
    assert len(groups) > 10
    return [
        f"{group.name}: {group.msgs}"
        for group in groups
        if group.weight >= _MEDIUM and group.value[0] != group.value[1]
    ]
