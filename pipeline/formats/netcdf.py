"""`<scenario>-<season>-currents.nc`: the current that a season was planned with, by CF 1.11.

`uo` and `vo` (lat, lon) on the source's own grid, as the source has them: a file for each season,
since seasons may come from different sources on different grids, and GDAL, and so QGIS, places a
grid only if its lines are evenly spaced. A current that changes is given as at departure.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pyproj

from pipeline.formats.manifest import versions
from pipeline.formats.shared.note_words import note_texts
from pipeline.formats.shared.result import RunResult
from pipeline.formats.shared.writing import os_error
from pipeline.model import CurrentGrid
from pipeline.scenario.times import Period, period
from renew._types import FloatArray

Dataset = Any  # netCDF4 has no types

_CONVENTIONS = "CF-1.11"
_REFERENCES = "RENEW: Risk- and Energy-Aware Navigation in Dynamic Waterways, AAAI 2026"
_COMMENT = (
    "Between these points the planner interpolates bilinearly, and it fills points without a value "
    "from their neighbours."
)
_CRS = {
    "grid_mapping_name": "latitude_longitude",
    "geographic_crs_name": "WGS 84",
    "long_name": "WGS 84",
    "semi_major_axis": 6378137.0,
    "inverse_flattening": 298.257223563,
    "longitude_of_prime_meridian": 0.0,
}
_AXES = {
    "lat": {"standard_name": "latitude", "units": "degrees_north", "axis": "Y"},
    "lon": {"standard_name": "longitude", "units": "degrees_east", "axis": "X"},
}
_TIME = {
    "standard_name": "time",
    "long_name": "middle of the period that the values represent",
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
    try:
        with netCDF4.Dataset(path, "w", format="NETCDF4") as dataset:
            dataset.setncatts(_about(result, grid))
            crs = dataset.createVariable("crs", "i4")
            crs.setncatts({**_CRS, "crs_wkt": pyproj.CRS("EPSG:4326").to_wkt()})
            crs[...] = 0
            coordinates = _put_time(dataset, grid)
            _put_axis(dataset, "lat", grid.lat)
            _put_axis(dataset, "lon", grid.lon)
            u, v = grid.at_departure
            _put_component(dataset, "uo", "eastward", u, coordinates)
            _put_component(dataset, "vo", "northward", v, coordinates)
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
    return {name: _storable(text) for name, text in attributes.items() if text}


def _put_time(dataset: Dataset, grid: CurrentGrid) -> str:
    """Write the time, if it is known: CF forbids a missing one.

    Returns what the components have as auxiliary coordinates.
    """
    valid = _period(grid)
    if valid is None:
        return ""
    time = dataset.createVariable("time", "f8")
    time.setncatts(_TIME)
    time[...] = (valid.begin.timestamp() + valid.end.timestamp()) / 2
    return "time"


def _put_axis(dataset: Dataset, name: str, lines: FloatArray) -> None:
    """Write the grid's lines, degrees; longitudes are continuous across 180 degrees."""
    dataset.createDimension(name, len(lines))
    axis = dataset.createVariable(name, "f8", (name,))
    axis.setncatts({**_AXES[name], "long_name": _AXES[name]["standard_name"]})
    axis[:] = lines


def _put_component(
    dataset: Dataset, name: str, direction: str, values: FloatArray, coordinates: str
) -> None:
    """Write a component of the current, m/s."""
    component = dataset.createVariable(
        name,
        "f8",
        ("lat", "lon"),
        compression="zlib",
        fill_value=netCDF4.default_fillvals["f8"],
    )
    component.setncatts(
        {
            "standard_name": f"surface_{direction}_sea_water_velocity",
            "long_name": f"{direction} surface current",
            "units": "m s-1",
            "grid_mapping": "crs",
        }
    )
    if coordinates:
        component.coordinates = coordinates
    component[:] = np.ma.masked_invalid(values)


def _period(grid: CurrentGrid) -> Period | None:
    """Read the period of the values, or the first and last of several ('2024-01-03/2024-01-28').

    None for any other text, as sources name their periods freely, and for a current that changes,
    whose values are those at departure.
    """
    first, _, last = grid.valid.partition("/")
    try:
        return None if grid.changes else Period(period(first).begin, period(last or first).end)
    except ValueError:
        return None


def _listed(texts: Iterable[str]) -> str:
    """Join texts that are not empty, each once."""
    return "; ".join(dict.fromkeys(text for text in texts if text))


def _storable(text: str) -> str:
    """Replace what UTF-8 or C strings can't hold."""
    return text.encode("utf-8", "replace").decode().replace("\0", "\N{REPLACEMENT CHARACTER}")
