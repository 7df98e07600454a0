"""`<scenario>-<season>-currents.nc`: the current that a season was planned with, by CF 1.11.

`uo` and `vo` (y, x) at the nodes of the planner's own grid, which is regular in the planner's plane
and not in degrees: bilinear interpolation between these nodes is the planner's current, and any
other grid would have another current between its nodes. A current that changes has (time, y, x).
A file for each season, since seasons may come from different sources on different grids, and GDAL,
and so QGIS, places a grid only if its lines are evenly spaced.
"""

from collections.abc import Iterable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pyproj

from pipeline.formats.manifest import versions
from pipeline.formats.shared.note_words import note_texts
from pipeline.formats.shared.result import RunResult
from pipeline.formats.shared.text import os_error
from pipeline.geo.projection import Projection
from pipeline.model import CurrentGrid
from pipeline.scenario.times import Period, period
from renew._types import FloatArray
from renew.kernels.current_table import CurrentTable

Dataset = Any  # netCDF4 has no types

_CONVENTIONS = "CF-1.11"
_REFERENCES = "RENEW: Risk- and Energy-Aware Navigation in Dynamic Waterways, AAAI 2026"
_COMMENT = (
    "The nodes are those of the planner: between them, in x and y, it interpolates bilinearly, and "
    "between times linearly. Beyond the source's water the values are filled from their neighbours."
)
_DEGREES = {
    "lat": {"standard_name": "latitude", "long_name": "latitude", "units": "degrees_north"},
    "lon": {"standard_name": "longitude", "long_name": "longitude", "units": "degrees_east"},
}
_FILLED = {
    "standard_name": "status_flag",
    "long_name": "whether the source of the current has a figure at the node",
    "flag_values": np.array([0, 1], dtype="i1"),
    "flag_meanings": "from_source filled_from_neighbours",
    "grid_mapping": "crs",
    "coordinates": "lat lon",
}
_TIME = {
    "standard_name": "time",
    "units": "seconds since 1970-01-01 00:00:00",
    "calendar": "standard",
    # Python's timestamps, and those of the libraries that read the file, ignore leap seconds.
    "units_metadata": "leap_seconds: none",
}


def write_currents(result: RunResult, season: str, path: Path) -> None:
    """Write the current of a season that has a grid to a new file at `path`.

    Raises
    ------
    OSError
        The file can't be written.
    """
    grid = next(grid for grid in result.fetched.currents if grid.season == season)
    table = result.scene.currents[season].table(result.scene.chart.bounds)
    projection = result.scene.projection
    lonlat = projection.to_lonlat(np.stack(np.meshgrid(table.x, table.y), axis=-1))
    try:
        with netCDF4.Dataset(path, "w", format="NETCDF4") as dataset:
            dataset.setncatts(_about(result, grid))
            _put_plane(dataset, projection, table)
            for name, degrees in (("lon", lonlat[..., 0]), ("lat", lonlat[..., 1])):
                _put(dataset, name, "f8", ("y", "x"), _DEGREES[name])[:] = degrees
            filled = ~grid.cells.at(lonlat.reshape(-1, 2)).reshape(lonlat.shape[:2])
            _put(dataset, "filled", "i1", ("y", "x"), _FILLED)[:] = filled
            has_time = _put_time(dataset, grid, table, result.scene.departures.get(season))
            _put_velocity(dataset, projection, table, lonlat, has_time=has_time)
    except RuntimeError as error:  # HDF5's
        raise os_error(path, error) from error


def _about(result: RunResult, grid: CurrentGrid) -> dict[str, str]:
    """Global attributes, without empty ones."""
    made = result.created.strftime("%Y-%m-%dT%H:%M:%SZ")
    software = f"renew-planner {versions().get('renew-planner', '')}".strip()
    scenario, credit, valid = result.scenario, grid.credit, _period(grid)
    attributes = {
        "Conventions": _CONVENTIONS,
        "title": (
            f"Surface current of {scenario.title or scenario.name}: "
            f"{result.season_title(grid.season)}"
        ),
        "history": f"{made}: written by {software}",
        "source": credit.name,
        "references": _listed([credit.url, _REFERENCES]),
        "comment": _COMMENT,
        "license": credit.licence,
        "acknowledgement": credit.text,
        "date_created": made,
        "scenario": scenario.name,
        "season": grid.season,
        "valid": grid.valid,
        "time_coverage_start": valid.begin.isoformat() if valid else "",
        "time_coverage_end": valid.end.isoformat() if valid else "",
        "notes": _listed(note_texts(grid.notes)),
    }
    # UTF-8 and C strings can't hold every character.
    return {
        name: text.encode("utf-8", "replace").decode().replace("\0", "\N{REPLACEMENT CHARACTER}")
        for name, text in attributes.items()
        if text
    }


def _put_plane(dataset: Dataset, projection: Projection, table: CurrentTable) -> None:
    """Write the nodes' coordinates in the plane's CRS, at true scale and in the CRS's own unit."""
    plane = pyproj.CRS.from_user_input(projection.crs)
    crs = dataset.createVariable("crs", "i4")
    crs.setncatts({**plane.to_cf(), "long_name": "the planner's plane, conformal"})
    crs[...] = 0
    unit_m = plane.axis_info[0].unit_conversion_factor
    for name, nodes in (("x", table.x), ("y", table.y)):
        dataset.createDimension(name, len(nodes))
        axis = dataset.createVariable(name, "f8", (name,))
        axis.setncatts(
            {
                "standard_name": f"projection_{name}_coordinate",
                "long_name": f"{name} in the planner's plane",
                "units": "m" if unit_m == 1 else f"{unit_m!r} m",
                "axis": name.upper(),
            }
        )
        axis[:] = nodes * (projection.scale / unit_m)


def _put_time(
    dataset: Dataset, grid: CurrentGrid, table: CurrentTable, departure: datetime | None
) -> bool:
    """Write the time, if it is known: CF forbids a missing one.

    Times of a current that changes are a dimension. Otherwise there is one time, and the result
    says whether it is there.
    """
    if len(table.times) > 1:
        since = 0.0 if departure is None else departure.timestamp()
        dataset.createDimension("time", len(table.times))
        time = dataset.createVariable("time", "f8", ("time",))
        time.setncatts({**_TIME, "long_name": "time", "axis": "T"})
        time[:] = since + table.times
        return True
    valid = _period(grid)
    if valid is None:
        return False
    time = dataset.createVariable("time", "f8")
    time.setncatts({**_TIME, "long_name": "middle of the period that the values represent"})
    time[...] = (valid.begin.timestamp() + valid.end.timestamp()) / 2
    return True


def _put_velocity(
    dataset: Dataset,
    projection: Projection,
    table: CurrentTable,
    lonlat: FloatArray,
    *,
    has_time: bool,
) -> None:
    """Write the current at the nodes, m/s, to east and to north: one time after the other."""
    changes = len(table.times) > 1
    components = [
        _put(
            dataset,
            name,
            "f4",
            ("time", "y", "x") if changes else ("y", "x"),
            {
                "standard_name": f"surface_{direction}_sea_water_velocity",
                "long_name": f"{direction} surface current",
                "units": "m s-1",
                "grid_mapping": "crs",
                "coordinates": "time lat lon" if has_time and not changes else "lat lon",
                "ancillary_variables": "filled",
            },
        )
        for name, direction in (("uo", "eastward"), ("vo", "northward"))
    ]
    for step, planar in enumerate(table.uv):
        at = step if changes else slice(None)
        east_north = projection.rotate_to_lonlat(lonlat, planar)
        for i, component in enumerate(components):
            component[at] = east_north[..., i]


def _put(
    dataset: Dataset, name: str, kind: str, dimensions: tuple[str, ...], about: Mapping[str, object]
) -> Dataset:
    """Return a new compressed variable, all of whose values there will be."""
    variable = dataset.createVariable(
        name, kind, dimensions, compression="zlib", shuffle=True, fill_value=False
    )
    variable.setncatts(about)
    return variable


def _period(grid: CurrentGrid) -> Period | None:
    """Read the period of the values, or the first and last of several ('2024-01-03/2024-01-28').

    None for any other text, as sources name their periods freely, and for a current that changes,
    whose times are in the file.
    """
    first, _, last = grid.valid.partition("/")
    try:
        return None if grid.changes else Period(period(first).begin, period(last or first).end)
    except ValueError:
        return None


def _listed(texts: Iterable[str]) -> str:
    """Join texts that are not empty, each once."""
    return "; ".join(dict.fromkeys(text for text in texts if text))
