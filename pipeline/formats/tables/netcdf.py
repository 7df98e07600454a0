"""`currents.nc`: the seasons' currents as they were planned on, after the CF conventions 1.11.

One dataset for all seasons, `uo` and `vo` (season, lat, lon): `xarray.open_dataset("currents.nc")`,
then `uo.sel(season="summer")`. What is told of each season, such as its source and time, goes along
as coordinates.

Seasons may come from different sources, on different grids, so the axes hold the lines of all their
grids. The planner takes a current to be bilinear between the points of its grid, and a bilinear
field that is written on more lines is still the same field: nothing is lost. Read bilinearly, the
file gives what the season's own grid gives, and nothing where that gives nothing: outside it, or
in a cell with a point without figure. At the points of its own grid stand the source's figures,
bit for bit.
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
    from pipeline.model import CurrentGrid, FloatArray

_CONVENTIONS = "CF-1.11"
_REFERENCES = "RENEW: Risk- and Energy-Aware Navigation in Dynamic Waterways, AAAI 2026"
_COMMENT = (
    "The axes hold the lines of all seasons' grids. At the points of its own grid a season has its "
    "source's figures, between them bilinear ones; it has none outside its grid, and none in a "
    "cell with a point that the source has no figure for. The planner takes the current to be "
    "bilinear too, and fills points without a figure from those around them."
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
}
# Lines of two grids that are nearer are one: less than a tenth of a millimetre apart.
_ONE_LINE_DEG = 1e-9


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
            _put_crs(dataset)
            _put_names(dataset, grids)
            told = [*_put_texts(dataset, result), *_put_time(dataset, grids)]
            lat = _put_axis(dataset, "lat", [grid.lat for grid in grids])
            lon = _put_axis(dataset, "lon", [grid.lon for grid in grids])
            uo = _put_component(dataset, "uo", "eastward", told)
            vo = _put_component(dataset, "vo", "northward", told)
            for place, grid in enumerate(grids):
                for component, figures in ((uo, grid.u), (vo, grid.v)):
                    along = _on_lines(lon, grid.lon, figures, axis=1)
                    component[place] = np.ma.masked_invalid(_on_lines(lat, grid.lat, along, axis=0))
    except RuntimeError as error:  # HDF5's
        raise os_error(path, error) from error


def _about(result: RunResult) -> dict[str, str]:
    """Attributes of the file, of those that say something."""
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
    """Write which longitudes and latitudes are meant."""
    crs = dataset.createVariable("crs", "i4")
    crs.setncatts(_CRS)
    crs[...] = 0


def _put_names(dataset: Any, grids: Sequence[CurrentGrid]) -> None:  # noqa: ANN401 - as above
    """Write the seasons' names as an axis.

    As characters: CF 1.12 forbids a string the name of its dimension, and readers that know of an
    axis of names know it in this form.
    """
    names = np.array([_storable(grid.season).encode() for grid in grids])
    dataset.createDimension("season", len(names))
    dataset.createDimension("season_length", names.itemsize)
    season = dataset.createVariable("season", "S1", ("season", "season_length"))
    season[:] = names.view("S1").reshape(len(names), names.itemsize)
    season.setncatts({"long_name": "season of the scenario", "_Encoding": "utf-8"})


def _put_texts(dataset: Any, result: RunResult) -> list[str]:  # noqa: ANN401 - as above
    """Write what is told of each season; what it is called."""
    grids = result.fetched.currents
    told = {
        "season_title": ("season for readers", [result.season_title(g.season) for g in grids]),
        "valid": ("time that the figures stand for", [g.valid for g in grids]),
        "source": ("source of the figures", [g.credit.name for g in grids]),
        "references": ("where the source is described", [g.credit.url for g in grids]),
        "license": ("licence of the source", [g.credit.licence for g in grids]),
        "acknowledgement": ("credit due to the source", [g.credit.text for g in grids]),
        "notes": ("what there is to know of the figures", [_listed(g.notes) for g in grids]),
    }
    for name, (meaning, texts) in told.items():
        variable = dataset.createVariable(name, str, ("season",))
        variable.long_name = meaning
        variable[:] = np.array([_storable(text) for text in texts], dtype=object)
    return list(told)


def _put_time(dataset: Any, grids: Iterable[CurrentGrid]) -> list[str]:  # noqa: ANN401 - as above
    """Write the seasons' times with their bounds, if each can be told: none may be missing."""
    periods = [_period(grid.valid) for grid in grids]
    told = [valid for valid in periods if valid is not None]
    if len(told) < len(periods):
        return []
    bounds = np.array([(valid.begin.timestamp(), valid.end.timestamp()) for valid in told])
    time = dataset.createVariable("time", "f8", ("season",))
    time.setncatts({**_TIME, "bounds": "time_bounds"})
    time[:] = bounds.mean(axis=1)
    dataset.createDimension("bound", 2)
    dataset.createVariable("time_bounds", "f8", ("season", "bound"))[:] = bounds
    return ["time"]


def _put_axis(dataset: Any, name: str, parts: Sequence[FloatArray]) -> FloatArray:  # noqa: ANN401 - as above
    """Write all lines of the seasons' grids (degrees), each once; longitudes go on across 180."""
    lines = np.unique(np.concatenate(parts))
    lines = lines[np.diff(lines, prepend=-np.inf) > _ONE_LINE_DEG]
    dataset.createDimension(name, len(lines))
    axis = dataset.createVariable(name, "f8", (name,))
    axis.setncatts({**_AXES[name], "long_name": _AXES[name]["standard_name"]})
    axis[:] = lines
    return lines


def _put_component(dataset: Any, name: str, direction: str, told: Iterable[str]) -> Any:  # noqa: ANN401 - as above
    """Write what a component of the current is, and which variables tell of its seasons."""
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
            "coordinates": " ".join(told),
        }
    )
    return component


def _on_lines(lines: FloatArray, own: FloatArray, figures: FloatArray, axis: int) -> FloatArray:
    """Interpolate figures linearly from a grid's own lines to those of the file, along an axis.

    Where a line is the grid's own its figures stay as they are; there are none beyond its ends,
    nor beside one that is NaN.
    """
    # The first of several that count as one is kept: each is the last that isn't beyond.
    stands_at = lines[np.searchsorted(lines, own, side="right") - 1]

    def row(values: FloatArray) -> FloatArray:
        return np.interp(lines, stands_at, values, left=np.nan, right=np.nan)

    return np.apply_along_axis(row, axis, figures)


def _period(valid: str) -> Period | None:
    """Read one time, or the first and last of several ('2024-01-03/2024-01-28'); None for others.

    A source may call its time what it likes.
    """
    first, _, last = valid.partition("/")
    try:
        return Period(period(first).begin, period(last or first).end)
    except ValueError:
        return None


def _listed(texts: Iterable[str]) -> str:
    """Texts that say something, each once."""
    return "; ".join(dict.fromkeys(text for text in texts if text))


def _storable(text: str) -> str:
    """Replace what no UTF-8 or no C string can hold."""
    return text.encode("utf-8", "replace").decode().replace("\0", "\N{REPLACEMENT CHARACTER}")
