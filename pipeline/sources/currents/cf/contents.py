"""What a user's files of currents hold, by the CF conventions: components, axes, units, times.

Nothing of a field is read here: files stay open and lazy. Faults are gathered, so that all of them
are told at once, each with what was found and what is needed.
"""

from __future__ import annotations

import contextlib
import glob
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.errors import RequestError
from pipeline.sources.currents.cf import axes as cf_axes
from pipeline.sources.currents.cf import time as cf_time

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy as np
    import numpy.typing as npt
    import xarray as xr

    FloatArray = npt.NDArray[np.float64]

# Pairs of standard names, and of variables' names where those say nothing; the first is taken.
_STANDARD = (
    ("eastward_sea_water_velocity", "northward_sea_water_velocity"),
    ("surface_eastward_sea_water_velocity", "surface_northward_sea_water_velocity"),
    (
        "eastward_sea_water_velocity_assuming_no_tide",
        "northward_sea_water_velocity_assuming_no_tide",
    ),
    ("sea_water_x_velocity", "sea_water_y_velocity"),
    ("surface_sea_water_x_velocity", "surface_sea_water_y_velocity"),
    (
        "surface_geostrophic_eastward_sea_water_velocity",
        "surface_geostrophic_northward_sea_water_velocity",
    ),
    ("geostrophic_eastward_sea_water_velocity", "geostrophic_northward_sea_water_velocity"),
)
_NAMES = (("uo", "vo"), ("ugos", "vgos"), ("u", "v"), ("utotal", "vtotal"))
# Units as they are when blanks, dots, carets and asterisks are left out, in m/s.
_UNITS = {
    1.0: ("ms-1", "m/s", "meters-1", "metres-1", "metersecond-1", "metresecond-1", "meters/second"),
    0.01: ("cms-1", "cm/s", "centimeters-1", "centimetersecond-1"),
    0.001: ("mms-1", "mm/s"),
    1 / 3.6: ("kmh-1", "km/h", "kmhr-1", "km/hr", "kph"),
    1852 / 3600: ("knot", "knots", "kt", "kts", "kn", "international_knot"),
}
_HDF5, _CLASSIC = b"\x89HDF", b"CDF"
_ZARR = ("zarr.json", ".zgroup", ".zmetadata")


@dataclass(frozen=True)
class Component:
    """Where one component lies in one file: the variable, and its dimensions time, lat and lon.

    `time` is empty where it has none, `fixed` says which place of other dimensions is meant, and
    `factor` makes m/s of its unit.
    """

    file: Path
    name: str
    time: str
    lat: str
    lon: str
    fixed: dict[str, int]
    factor: float

    @contextlib.contextmanager
    def lazy(self) -> Iterator[xr.DataArray]:
        """Give the variable, not yet read; the file is let go of when the block ends."""
        dataset = opened(self.file)
        try:
            yield dataset[self.name].isel(self.fixed)
        finally:
            dataset.close()


@dataclass(frozen=True)
class Contents:
    """What files hold together: axes as they lie in them, both components, time steps.

    `lon` (nx,) and `lat` (ny,) are in degrees, monotonic, ascending or not. For each of the `steps`
    the `places` say which of a component's files has it, and which step there it is.
    """

    files: tuple[Path, ...]
    lon: FloatArray
    lat: FloatArray
    u: tuple[Component, ...]
    v: tuple[Component, ...]
    steps: cf_time.Steps
    u_places: tuple[tuple[int, int], ...]
    v_places: tuple[tuple[int, int], ...]
    notes: tuple[str, ...]
    attributes: dict[str, str]


@dataclass(frozen=True)
class _Part:
    """A component in a file with what belongs to it, before files are put together."""

    component: Component
    lon: FloatArray
    lat: FloatArray
    steps: cf_time.Steps
    notes: tuple[str, ...]


def found(paths: Sequence[str]) -> tuple[Path, ...]:
    """Files of paths and patterns, in their order.

    Raises
    ------
    RequestError
        One is not there, or no file fits a pattern.
    """
    files: list[Path] = []
    faults = []
    for path in paths:
        matches = [path] if Path(path).exists() else sorted(glob.glob(path))  # noqa: PTH207
        if not matches:
            what = "no file fits the pattern" if glob.has_magic(path) else "there is no file"
            faults.append(f"{what} {path!r}; give a NetCDF file or a Zarr store")
        files += [Path(match) for match in matches]
    if faults:
        raise RequestError(faults)
    return tuple(files)


def is_zarr(path: Path) -> bool:
    """Whether a path is that of a Zarr store."""
    return path.is_dir() and any((path / name).is_file() for name in _ZARR)


def contents(files: tuple[Path, ...]) -> Contents:
    """Look into files that belong together.

    Raises
    ------
    RequestError
        They can't be read, or hold no currents on a lon/lat grid: one line for each fault.
    """
    datasets: dict[Path, xr.Dataset] = {}
    faults = []
    try:
        for file in files:
            try:
                datasets[file] = opened(file)
            except ValueError as error:
                faults.append(str(error))
        if faults:
            raise RequestError(faults)
        return _looked_into(files, datasets)
    finally:
        for dataset in datasets.values():
            dataset.close()


def _looked_into(files: tuple[Path, ...], datasets: dict[Path, xr.Dataset]) -> Contents:
    """Look into open files; RequestError as `contents` has it."""
    pair = _pair(list(datasets.values()))
    if isinstance(pair, str):
        raise RequestError([f"{called(files)}: {pair}"])
    faults: list[str] = []
    sides: list[list[_Part]] = []
    for wanted in pair:
        parts = []
        for file, dataset in datasets.items():
            if _carries(dataset, wanted):
                try:
                    parts.append(_part(file, dataset, wanted[1]))
                except ValueError as error:
                    faults.append(f"{file.name}: {error}")
        sides.append(parts)
    if faults:
        raise RequestError(list(dict.fromkeys(faults)))
    try:
        return _together(files, sides, _notes(pair), datasets)
    except ValueError as error:
        raise RequestError([f"{called(files)}: {error}"]) from None


def called(files: Sequence[Path]) -> str:
    """Name files in a sentence."""
    more = f" and {len(files) - 1} more" if len(files) > 1 else ""
    return f"{files[0].name}{more}"


def opened(path: Path) -> xr.Dataset:
    """Open a file lazily, times as they stand; ValueError says why it can't be."""
    import xarray as xr

    options: dict[str, Any] = {}
    if is_zarr(path):
        options = {"engine": "zarr", "consolidated": False}
    elif path.is_file():
        with path.open("rb") as file:
            if file.read(4).startswith((_HDF5, _CLASSIC)):
                options = {"engine": "netcdf4"}
    if not options:
        raise ValueError(
            f"{path.name} is neither NetCDF nor Zarr; convert it, as with `cdo -f nc copy`"
        )
    try:
        return xr.open_dataset(path, decode_times=False, decode_timedelta=False, **options)
    except (OSError, ValueError, RuntimeError, KeyError) as error:
        said = " ".join(str(error).split())
        raise ValueError(f"{path.name} can't be read: {said}; fetch it again") from None


def _pair(datasets: Sequence[xr.Dataset]) -> tuple[tuple[str, str], tuple[str, str]] | str:
    """Find the two components: (standard name, name) of each; or say what there is instead."""
    variables = {
        (str(array.attrs.get("standard_name", "")), str(name))
        for dataset in datasets
        for name, array in dataset.data_vars.items()
        if array.ndim >= 2
    }
    for standard in _STANDARD:
        names = [sorted(name for said, name in variables if said == wanted) for wanted in standard]
        if not all(names):
            continue
        if all(len(of) == 1 for of in names):
            return (standard[0], names[0][0]), (standard[1], names[1][0])
        for u, v in _NAMES:
            if u in names[0] and v in names[1]:
                return (standard[0], u), (standard[1], v)
        listed = ", ".join(names[0] + names[1])
        return (
            f"several variables are {standard[0]} or its partner ({listed}); keep one pair of them"
        )
    unsaid = {name.lower(): (said, name) for said, name in variables if not said}
    for u, v in _NAMES:
        if u in unsaid and v in unsaid:
            return unsaid[u], unsaid[v]
    listed = ", ".join(f"{name} ({said or 'no standard name'})" for said, name in sorted(variables))
    return (
        f"it has no pair of current components among {listed or 'no variables at all'}; needed are "
        f"the standard names {' and '.join(_STANDARD[0])}, or variables called "
        f"{', '.join('/'.join(names) for names in _NAMES)}"
    )


def _carries(dataset: xr.Dataset, wanted: tuple[str, str]) -> bool:
    """Whether a file has the wanted component."""
    said, name = wanted
    return name in dataset.data_vars and dataset[name].attrs.get("standard_name", "") == said


def _notes(pair: tuple[tuple[str, str], tuple[str, str]]) -> tuple[str, ...]:
    """What the kind of current leaves out."""
    said, name = pair[0]
    if "geostrophic" in said or name == "ugos":
        return ("the currents are geostrophic: tide and wind drift are not in them",)
    return ("the currents are without tide",) if "no_tide" in said else ()


def _part(file: Path, dataset: xr.Dataset, name: str) -> _Part:
    """Take a component with its axes; ValueError with all that is wrong with it."""
    array = dataset[name]
    factor, notes = _factor(array)
    roles = {dim: cf_axes.role(dataset, str(dim)) for dim in array.dims}
    by_role = {role: str(dim) for dim, role in roles.items() if role}
    if "lon" not in by_role or "lat" not in by_role:
        raise ValueError(cf_axes.no_grid(dataset, array))
    fixed: dict[str, int] = {}
    for dim, role in roles.items():
        if role == "level":
            fixed[str(dim)], said = cf_axes.surface(dataset, str(dim))
            notes += said
        elif not role and array.sizes[dim] == 1:
            fixed[str(dim)] = 0
        elif not role:
            raise ValueError(
                f"{name} has the dimension {dim} ({array.sizes[dim]}), which is neither time, "
                "depth, latitude nor longitude; keep one of it"
            )
    time = by_role.get("time", "")
    steps = cf_time.steps(*cf_axes.time_axis(dataset, time)) if time else cf_time.Steps()
    return _Part(
        Component(file, name, time, by_role["lat"], by_role["lon"], fixed, factor),
        cf_axes.axis(dataset, by_role["lon"], turn=360.0),
        cf_axes.axis(dataset, by_role["lat"]),
        steps,
        tuple(notes),
    )


def _factor(array: xr.DataArray) -> tuple[float, list[str]]:
    """What makes m/s of a variable's unit, and what to say of it; ValueError for another unit."""
    units = str(array.attrs.get("units", "")).strip()
    if not units:
        return 1.0, [f"{array.name} says no unit: it is taken for m/s"]
    plain = units.lower().translate(str.maketrans("", "", " .^*"))
    for factor, known in _UNITS.items():
        if plain in known:
            said = [] if factor == 1 else [f"{array.name} is in {units}: converted to m/s"]
            return factor, said
    raise ValueError(
        f"{array.name} is in {units!r}, not in m s-1, cm s-1, km h-1 or knots; give its true unit"
    )


def _together(
    files: tuple[Path, ...],
    sides: Sequence[Sequence[_Part]],
    notes: tuple[str, ...],
    datasets: dict[Path, xr.Dataset],
) -> Contents:
    """Put the parts together; ValueError where they don't fit each other."""
    first = sides[0][0]
    for part in (*sides[0], *sides[1]):
        for own, other, what in (
            (part.lon, first.lon, "longitudes"),
            (part.lat, first.lat, "latitudes"),
        ):
            if not cf_axes.same(own, other):
                raise ValueError(
                    f"{part.component.name} has other {what} than {first.component.name}: put "
                    "both on one grid (a staggered one is none)"
                )
    joined = [cf_time.joined([part.steps for part in side]) for side in sides]
    if joined[0][0] != joined[1][0]:
        raise ValueError(
            f"the components are of different times: {joined[0][0].span}, and {joined[1][0].span}"
        )
    told = [note for side in sides for part in side for note in part.notes]
    attributes = {str(k): str(v) for k, v in next(iter(datasets.values())).attrs.items()}
    return Contents(
        files=files,
        lon=first.lon,
        lat=first.lat,
        u=tuple(part.component for part in sides[0]),
        v=tuple(part.component for part in sides[1]),
        steps=joined[0][0],
        u_places=joined[0][1],
        v_places=joined[1][1],
        notes=tuple(dict.fromkeys((*notes, *told))),
        attributes=attributes,
    )
