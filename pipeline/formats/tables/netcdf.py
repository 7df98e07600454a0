"""`currents.nc`: the seasons' currents that were planned with, by the CF conventions 1.11.

One dataset for all seasons, `uo` and `vo` (season, lat, lon): `xarray.open_dataset("currents.nc")`,
then `uo.sel(season="summer")`. Facts about each season, such as its source and time, are auxiliary
coordinates.

Seasons may come from different sources on different grids, so the axes hold the grid lines of all
of them. The planner takes a current to be bilinear between its grid points, and a bilinear field
sampled on more lines is still the same field. Read bilinearly, the file gives the same values as
the season's own grid, and NaN where that has none: outside the grid, or in a cell with a point
without a value. At the points of its own grid a season has the source's values, bit for bit.
Of a current that changes the file has that at departure.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.formats.shared.os_errors import os_error
from pipeline.formats.tables.manifest import versions
from pipeline.scenario.period import Period, period

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from pipeline.formats.shared.result import RunResult
    from pipeline.model import CurrentGrid
    from renew._types import FloatArray

_CONVENTIONS = "CF-1.11"
_REFERENCES = "RENEW: Risk- and Energy-Aware Navigation in Dynamic Waterways, AAAI 2026"
_COMMENT = (
    "The axes hold the grid lines of all seasons. At the points of its own grid a season has its "
    "source's values, between them bilinearly interpolated ones; it has no value outside its grid, "
    "nor in a cell with a point for which the source has none. The planner interpolates "
    "bilinearly too, and fills points without a value from their neighbours."
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
    "long_name": "middle of the period that the values represent",
    "units": "seconds since 1970-01-01 00:00:00",
    "calendar": "standard",
    # Python's timestamps, and those of the libraries that read the file, ignore leap seconds.
    "units_metadata": "leap_seconds: none",
}
# Distance, degrees, below which lines of two grids are one: a tenth of a millimetre.
_SAME_LINE_DEG = 1e-9


def has_currents(result: RunResult) -> bool:
    """Whether there is a grid to write: a planar scenario's current is a formula."""
    return bool(result.fetched.currents)


def write_currents(result: RunResult, path: Path) -> None:
    """Write the currents of all seasons to a new file at `path`, if the run `has_currents`.

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
            _put_crs(dataset)
            _put_names(dataset, grids)
            coordinates = [*_put_texts(dataset, result), *_put_time(dataset, grids)]
            lat = _put_axis(dataset, "lat", [grid.lat for grid in grids])
            lon = _put_axis(dataset, "lon", [grid.lon for grid in grids])
            uo = _put_component(dataset, "uo", "eastward", coordinates)
            vo = _put_component(dataset, "vo", "northward", coordinates)
            for index, grid in enumerate(grids):
                for component, values in zip((uo, vo), grid.at_departure, strict=True):
                    rows = _on_lines(lon, grid.lon, values, axis=1)
                    component[index] = np.ma.masked_invalid(_on_lines(lat, grid.lat, rows, axis=0))
    except RuntimeError as error:  # HDF5's
        raise os_error(path, error) from error


def _about(result: RunResult) -> dict[str, str]:
    """Global attributes, without empty ones."""
    made = result.created.strftime("%Y-%m-%dT%H:%M:%SZ")
    software = f"renew-planner {versions().get('renew-planner', '')}".strip()
    used = result.current_credits
    attributes = {
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
    return {name: _storable(text) for name, text in attributes.items() if text}


def _put_crs(dataset: Any) -> None:  # noqa: ANN401 - netCDF4 has no types
    """Write the coordinate reference system."""
    crs = dataset.createVariable("crs", "i4")
    crs.setncatts(_CRS)
    crs[...] = 0


def _put_names(dataset: Any, grids: Sequence[CurrentGrid]) -> None:  # noqa: ANN401 - as above
    """Write the seasons' names as an axis.

    As characters: CF 1.12 forbids a string variable with the name of its dimension, and readers
    that support an axis of names support this form.
    """
    names = np.array([_storable(grid.season).encode() for grid in grids])
    dataset.createDimension("season", len(names))
    dataset.createDimension("season_length", names.itemsize)
    season = dataset.createVariable("season", "S1", ("season", "season_length"))
    season[:] = names.view("S1").reshape(len(names), names.itemsize)
    season.setncatts({"long_name": "season of the scenario", "_Encoding": "utf-8"})


def _put_texts(dataset: Any, result: RunResult) -> list[str]:  # noqa: ANN401 - as above
    """Write facts about each season as texts; returns the names of their variables."""
    grids = result.fetched.currents
    facts = {
        "season_title": ("title of the season", [result.season_title(g.season) for g in grids]),
        "valid": ("period that the values represent", [g.valid for g in grids]),
        "source": ("source of the values", [g.credit.name for g in grids]),
        "references": ("description of the source", [g.credit.url for g in grids]),
        "license": ("licence of the source", [g.credit.licence for g in grids]),
        "acknowledgement": ("credit due to the source", [g.credit.text for g in grids]),
        "notes": ("notes on the values", [_listed(g.notes) for g in grids]),
    }
    for name, (meaning, texts) in facts.items():
        variable = dataset.createVariable(name, str, ("season",))
        variable.long_name = meaning
        variable[:] = np.array([_storable(text) for text in texts], dtype=object)
    return list(facts)


def _put_time(dataset: Any, grids: Iterable[CurrentGrid]) -> list[str]:  # noqa: ANN401 - as above
    """Write the seasons' times with their bounds, if all are known: CF forbids a missing one.

    Returns the names of the variables.
    """
    # Of a current that changes the values are of the departure, not of all of its period.
    periods = [None if grid.changes else _period(grid.valid) for grid in grids]
    known = [valid for valid in periods if valid is not None]
    if len(known) < len(periods):
        return []
    bounds = np.array([(valid.begin.timestamp(), valid.end.timestamp()) for valid in known])
    time = dataset.createVariable("time", "f8", ("season",))
    time.setncatts({**_TIME, "bounds": "time_bounds"})
    time[:] = bounds.mean(axis=1)
    dataset.createDimension("bound", 2)
    dataset.createVariable("time_bounds", "f8", ("season", "bound"))[:] = bounds
    return ["time"]


def _put_axis(dataset: Any, name: str, parts: Sequence[FloatArray]) -> FloatArray:  # noqa: ANN401 - as above
    """Write the grid lines of all seasons (degrees), each once; continuous across 180 degrees."""
    lines = np.unique(np.concatenate(parts))
    lines = lines[np.diff(lines, prepend=-np.inf) > _SAME_LINE_DEG]
    dataset.createDimension(name, len(lines))
    axis = dataset.createVariable(name, "f8", (name,))
    axis.setncatts({**_AXES[name], "long_name": _AXES[name]["standard_name"]})
    axis[:] = lines
    return lines


def _put_component(dataset: Any, name: str, direction: str, coordinates: Iterable[str]) -> Any:  # noqa: ANN401 - as above
    """Create the variable of a component of the current, with its auxiliary coordinates."""
    import netCDF4

    component = dataset.createVariable(
        name,
        "f8",
        ("season", "lat", "lon"),
        compression="zlib",
        fill_value=netCDF4.default_fillvals["f8"],
    )
    component.setncatts(
        {
            "standard_name": f"surface_{direction}_sea_water_velocity",
            "long_name": f"{direction} surface current",
            "units": "m s-1",
            "grid_mapping": "crs",
            "coordinates": " ".join(coordinates),
        }
    )
    return component


def _on_lines(lines: FloatArray, own: FloatArray, values: FloatArray, axis: int) -> FloatArray:
    """Interpolate values linearly from a grid's own lines to those of the file, along an axis.

    Values at the grid's own lines stay exact; NaN beyond its ends and next to NaN.
    """
    # Of lines that count as one the file has the first, which is at or below the grid's own.
    on_file = lines[np.searchsorted(lines, own, side="right") - 1]

    def interpolated(row: FloatArray) -> FloatArray:
        return np.interp(lines, on_file, row, left=np.nan, right=np.nan)

    return np.apply_along_axis(interpolated, axis, values)


def _period(valid: str) -> Period | None:
    """Read a period, or the first and last of several ('2024-01-03/2024-01-28').

    None for any other text: sources name their periods freely.
    """
    first, _, last = valid.partition("/")
    try:
        return Period(period(first).begin, period(last or first).end)
    except ValueError:
        return None


def _listed(texts: Iterable[str]) -> str:
    """Join texts that are not empty, each once."""
    return "; ".join(dict.fromkeys(text for text in texts if text))


def _storable(text: str) -> str:
    """Replace what UTF-8 or C strings can't hold."""
    return text.encode("utf-8", "replace").decode().replace("\0", "\N{REPLACEMENT CHARACTER}")
