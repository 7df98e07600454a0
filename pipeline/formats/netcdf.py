"""`currents.nc`: the seasons' currents as they were planned on, after the CF conventions 1.11.

Each season is a group by its name, since seasons may come from different sources, on different
grids, for different times. So every group is a whole dataset whose variables are called the same:
`xarray.open_dataset("currents.nc", group="summer")`, or `xarray.open_datatree` for all of them.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.formats.gis.disk import os_error
from pipeline.formats.manifest import versions
from pipeline.period import Period, period

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from pipeline.formats.result import RunResult
    from pipeline.model import CurrentGrid

_CONVENTIONS = "CF-1.11"
_REFERENCES = "RENEW: Risk- and Energy-Aware Navigation in Dynamic Waterways, AAAI 2026"
_COMMENT = (
    "One group a season. The figures are the source's own, without a figure where it has none. "
    "Between the points the planner takes the current to be bilinear, and fills points without a "
    "figure from those around them."
)
_CRS = {
    "grid_mapping_name": "latitude_longitude",
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
    "long_name": "middle of the time that the figures stand for",
    "units": "seconds since 1970-01-01 00:00:00",
    "calendar": "standard",
    # As Python's own timestamps count, and every library that reads them.
    "units_metadata": "leap_seconds: none",
    "axis": "T",
}
_LONGEST_NAME = 64


def has_currents(result: RunResult) -> bool:
    """Whether there is a grid to write: a planar scenario gives its current as a formula."""
    return bool(result.fetched.currents)


def write_currents(result: RunResult, path: Path) -> None:
    """Write the currents of all seasons to a new file at `path`; see `has_currents`.

    Raises
    ------
    OSError
        The file can't be written.
    """
    import netCDF4

    grids = result.fetched.currents
    try:
        with netCDF4.Dataset(path, "w", format="NETCDF4") as dataset:
            dataset.setncatts(_about(result))
            for grid, name in zip(grids, _names(grid.season for grid in grids), strict=True):
                group = dataset.createGroup(name)
                group.setncatts(_about_season(result, grid))
                _put_season(group, grid)
    except RuntimeError as error:  # HDF5's
        raise os_error(path, error) from error


def _about(result: RunResult) -> dict[str, str]:
    """Attributes of the whole file."""
    made = result.created.strftime("%Y-%m-%dT%H:%M:%SZ")
    software = f"renew-planner {versions().get('renew-planner', '')}".strip()
    used = result.current_credits
    return _texts(
        {
            "Conventions": _CONVENTIONS,
            "title": f"Surface currents of {result.scenario.title or result.scenario.name}",
            "history": f"{made}: written by {software}",
            "source": _listed(credit.name for credit in used),
            "references": _listed([*(credit.url for credit in used), _REFERENCES]),
            "comment": _COMMENT,
            "license": _listed(credit.licence for credit in used),
            "acknowledgement": _listed(credit.text for credit in used),
            "date_created": made,
            "scenario": result.scenario.name,
        }
    )


def _about_season(result: RunResult, grid: CurrentGrid) -> dict[str, str]:
    """Attributes of a season's group."""
    return _texts(
        {
            "title": result.season_title(grid.season),
            "season": grid.season,
            "valid": grid.valid,
            "source": grid.credit.name,
            "references": grid.credit.url,
            "license": grid.credit.licence,
            "acknowledgement": grid.credit.text,
            "comment": _listed(grid.notes),
        }
    )


def _put_season(group: Any, grid: CurrentGrid) -> None:  # noqa: ANN401 - netCDF4 has no types
    """Write axes, time where it can be told, and the two components (time, lat, lon) or (lat, lon).

    Longitudes go on across 180 degrees.
    """
    import netCDF4

    crs = group.createVariable("crs", "i4")
    crs.setncatts(_CRS)
    crs[...] = 0
    valid = _period(grid.valid)
    if valid is not None:
        _put_time(group, valid)
    for (name, attributes), values in zip(_AXES.items(), (grid.lat, grid.lon), strict=True):
        group.createDimension(name, len(values))
        axis = group.createVariable(name, "f8", (name,))
        axis.setncatts({**attributes, "long_name": attributes["standard_name"]})
        axis[:] = values
    for name, direction, values in (("uo", "eastward", grid.u), ("vo", "northward", grid.v)):
        component = group.createVariable(
            name,
            "f8",
            (*(["time"] if valid is not None else []), "lat", "lon"),
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
        component[:] = np.ma.masked_invalid(values)


def _put_time(group: Any, valid: Period) -> None:  # noqa: ANN401 - as above
    """Write a period as its middle and its bounds; an instant has none."""
    begin, end = valid.begin.timestamp(), valid.end.timestamp()
    group.createDimension("time", 1)
    time = group.createVariable("time", "f8", ("time",))
    time.setncatts(_TIME)
    time[:] = [(begin + end) / 2]
    if not valid.is_instant:
        time.bounds = "time_bounds"
        group.createDimension("bound", 2)
        group.createVariable("time_bounds", "f8", ("time", "bound"))[:] = [[begin, end]]


def _period(valid: str) -> Period | None:
    """Read one time, or the first and last of several ('2024-01-03/2024-01-28'); None for others.

    A source may call its time what it likes.
    """
    first, _, last = valid.partition("/")
    try:
        return Period(period(first).begin, period(last or first).end)
    except ValueError:
        return None


def _names(seasons: Iterable[str]) -> list[str]:
    """Name the groups: the seasons' own names, but for signs that mean something in a path."""
    names: list[str] = []
    for season in seasons:
        plain = re.sub(r"[^\w-]", "_", season)[:_LONGEST_NAME] or "_"
        # Only names that had to change can meet.
        names.append(f"{plain}-{len(names) + 1}" if plain in names else plain)
    return names


def _listed(texts: Iterable[str]) -> str:
    """Texts that say something, each once."""
    return "; ".join(dict.fromkeys(text for text in texts if text))


def _texts(attributes: Mapping[str, str]) -> dict[str, str]:
    """Attributes that say something; what no UTF-8 or no C string can hold is replaced."""
    return {
        name: text.encode("utf-8", "replace").decode().replace("\0", "\N{REPLACEMENT CHARACTER}")
        for name, text in attributes.items()
        if text
    }
