"""Contents of the user's files of currents, by the CF conventions: components, axes, units, times.

No values of the currents are read here. Faults are collected and reported together, each with the
thing that was found and the thing that is needed.
"""

import contextlib
import glob
import os
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.machine.paths import shown, unreadable_reason
from pipeline.model import Note
from pipeline.sources.cf import axes
from pipeline.sources.cf.axes import TimeSteps
from pipeline.sources.cf.dataset import check_values, fatal_files, groups_of, open_dataset

if TYPE_CHECKING:
    import xarray as xr

# Standard names of eastward components and their partners, and pairs of names for variables without
# a standard name; the first found is used.
_STANDARD_NAMES = tuple(
    (name, name.replace("eastward", "northward").replace("_x_", "_y_"))
    for name in (
        "eastward_sea_water_velocity",
        "surface_eastward_sea_water_velocity",
        "eastward_sea_water_velocity_assuming_no_tide",
        "sea_water_x_velocity",
        "surface_sea_water_x_velocity",
        "surface_geostrophic_eastward_sea_water_velocity",
        "geostrophic_eastward_sea_water_velocity",
    )
)
_VARIABLE_NAMES = (("uo", "vo"), ("ugos", "vgos"), ("u", "v"), ("utotal", "vtotal"))
# Size of each unit of speed in m/s, and its spellings, without blanks, dots, carets and asterisks.
_UNITS_M_S = {
    1.0: ("ms-1", "m/s", "meters-1", "metres-1", "metersecond-1", "metresecond-1", "meters/second"),
    0.01: ("cms-1", "cm/s", "centimeters-1", "centimetersecond-1"),
    0.001: ("mms-1", "mm/s"),
    1 / 3.6: ("kmh-1", "km/h", "kmhr-1", "km/hr", "kph"),
    1852 / 3600: ("knot", "knots", "kt", "kts", "kn", "international_knot"),
}
_REMEDY = "give a NetCDF file or a Zarr store"
# Number of groups that a message names.
_MAX_GROUPS = 4


@dataclass(frozen=True)
class Component:
    """One component in one file: names of the variable and of its dimensions, and its axes.

    `time` is empty where there is no such dimension, `fixed` is the index to use in each other
    dimension, and `unit_m_s` is its unit in m/s.
    """

    file: Path
    name: str
    time: str
    lat: str
    lon: str
    fixed: dict[str, int]
    unit_m_s: float
    lats_deg: FloatArray
    lons_deg: FloatArray
    steps: TimeSteps
    notes: tuple[Note, ...]

    def lazy(self, dataset: "xr.Dataset") -> "xr.Variable":
        """Return the variable of its open file, not yet read."""
        return dataset.variables[self.name].isel(self.fixed)


@dataclass(frozen=True)
class Contents:
    """Contents of files together: axes as they are in the files, both components, time steps.

    `lon` (nx,) and `lat` (ny,) are in degrees, ascending or descending. For each of the `steps`,
    `u_index` and `v_index` give the number of the component's file, and the step in that file.
    """

    files: tuple[Path, ...]
    lon: FloatArray
    lat: FloatArray
    u: tuple[Component, ...]
    v: tuple[Component, ...]
    steps: TimeSteps
    u_index: tuple[tuple[int, int], ...]
    v_index: tuple[tuple[int, int], ...]
    notes: tuple[Note, ...]
    attributes: dict[str, str]
    reference_time: datetime | None = None

    @property
    def largest_cell(self) -> tuple[float, float]:
        """The largest steps of longitude and latitude, degrees."""
        lon_deg, lat_deg = (float(np.abs(np.diff(axis)).max()) for axis in (self.lon, self.lat))
        return lon_deg, lat_deg


def find_files(paths: Sequence[str]) -> tuple[Path, ...]:
    """Find the files of paths and patterns, in their order.

    Raises
    ------
    RequestError
        A file does not exist or can't be read, or no file matches a pattern.
    """
    files: list[Path] = []
    faults = []
    for path in paths:
        is_pattern = glob.has_magic(path) and not os.path.lexists(path)
        matches = sorted(glob.glob(path)) if is_pattern else [path]  # noqa: PTH207 - Path.glob takes no absolute pattern
        if not matches:
            faults.append(f"no file matches the pattern {shown(path)!r}; {_REMEDY}")
        for match in matches:
            if why := unreadable_reason(match):
                remedy = "" if ";" in why else f"; {_REMEDY}"
                faults += [f"{shown(match)} {why}{remedy}"]
        files += [Path(match) for match in matches]
    if faults:
        raise RequestError(faults)
    return tuple(files)


def read_contents(files: tuple[Path, ...]) -> Contents:
    """Read the contents of files that belong together.

    Raises
    ------
    RequestError
        They can't be read, or have no currents on a lon/lat grid: one line for each fault.
    """
    if fatal := fatal_files(files):
        raise RequestError([f"{file.name}: {fault}" for file, fault in fatal.items()])
    datasets: dict[Path, xr.Dataset] = {}
    faults = []
    with contextlib.ExitStack() as stack:
        for file in files:
            try:
                datasets[file] = stack.enter_context(open_dataset(file))
            except ValueError as error:
                faults.append(f"{file.name}: {error}")
        if faults:
            raise RequestError(faults)
        return _contents(files, datasets)


def _contents(files: tuple[Path, ...], datasets: "dict[Path, xr.Dataset]") -> Contents:
    """Return the contents of open files; RequestError as in `read_contents`."""
    pair = _component_pair(list(datasets.values()))
    if isinstance(pair, str):
        raise RequestError(f"{name_of(files)}: {pair}{_groups_hint(files)}")
    faults: list[str] = []
    found: tuple[list[Component], list[Component]] = ([], [])
    for (standard, name), components in zip(pair, found, strict=True):
        for file, dataset in datasets.items():
            variable = dataset.data_vars.get(name)
            if variable is not None and variable.attrs.get("standard_name", "") == standard:
                try:
                    components.append(_component(file, dataset, name))
                except ValueError as error:
                    faults.append(f"{file.name}: {error}")
    if faults:
        raise RequestError(list(dict.fromkeys(faults)))
    try:
        return _combined(datasets, *found, _kind_notes(pair))
    except ValueError as error:
        raise RequestError(f"{name_of(files)}: {error}") from None


def name_of(files: Sequence[Path]) -> str:
    """Name files in a message: the first, and how many more there are."""
    more = f" and {len(files) - 1} more" if len(files) > 1 else ""
    return f"{files[0].name}{more}"


def _component_pair(
    datasets: "Sequence[xr.Dataset]",
) -> tuple[tuple[str, str], tuple[str, str]] | str:
    """Find the two components, (standard name, name) each; or name the variables there are."""
    variables = {
        (str(array.attrs.get("standard_name", "")), str(name))
        for dataset in datasets
        for name, array in dataset.data_vars.items()
        if array.ndim >= 2
    }
    for pair in _STANDARD_NAMES:
        names = [
            sorted(name for standard, name in variables if standard == wanted) for wanted in pair
        ]
        if not all(names):
            continue
        if all(len(candidates) == 1 for candidates in names):
            return (pair[0], names[0][0]), (pair[1], names[1][0])
        for u, v in _VARIABLE_NAMES:
            if u in names[0] and v in names[1]:
                return (pair[0], u), (pair[1], v)
        listed = ", ".join(names[0] + names[1])
        return f"several variables are {pair[0]} or its partner ({listed}); keep one pair of them"
    without = {name.lower(): (standard, name) for standard, name in variables if not standard}
    for u, v in _VARIABLE_NAMES:
        if u in without and v in without:
            return without[u], without[v]
    listed = ", ".join(
        f"{name} ({standard or 'no standard name'})" for standard, name in sorted(variables)
    )
    return (
        f"it has no pair of current components among {listed or 'no variables at all'}; needed are "
        f"the standard names {' and '.join(_STANDARD_NAMES[0])}, or variables called "
        f"{', '.join('/'.join(names) for names in _VARIABLE_NAMES)}"
    )


def _groups_hint(files: Sequence[Path]) -> str:
    """Say that the variables may be in groups, if the first file has any."""
    try:
        groups = groups_of(files[0])
    except ValueError:
        return ""
    if not groups:
        return ""
    listed = ", ".join(groups[:_MAX_GROUPS])
    return f"; groups ({listed}) are not read: take one out, as with `ncks -G : -g {groups[0]}`"


def _kind_notes(pair: tuple[tuple[str, str], tuple[str, str]]) -> tuple[Note, ...]:
    """Say in a note that such a current lacks the tide, or all but the geostrophic part."""
    standard, name = pair[0]
    if "geostrophic" in standard or name == "ugos":
        return (Note.of("current-geostrophic"),)
    return (Note.of("current-without-tide"),) if "no_tide" in standard else ()


def _component(file: Path, dataset: "xr.Dataset", name: str) -> Component:
    """Return a component of a file; ValueError where something is wrong with it."""
    array = dataset[name]
    check_values(array)
    for dim, size in array.sizes.items():
        if not size:
            raise ValueError(f"{name} is empty, as {dim} has no values; give a file with data")
    unit_m_s, notes = _unit_m_s(array)
    roles = {dim: axes.axis_role(dataset, str(dim)) for dim in array.dims}
    by_role = {role: str(dim) for dim, role in roles.items() if role}
    if "lon" not in by_role or "lat" not in by_role:
        raise ValueError(axes.grid_fault(dataset, array))
    fixed: dict[str, int] = {}
    for dim, role in roles.items():
        if role == "level":
            fixed[str(dim)], level_notes = axes.surface_level(dataset, str(dim))
            notes += level_notes
        elif not role and array.sizes[dim] == 1:
            fixed[str(dim)] = 0
        elif not role:
            raise ValueError(
                f"{name} has the dimension {dim} ({array.sizes[dim]}), which is neither time, "
                "depth, latitude nor longitude; keep one index of it"
            )
    time = by_role.get("time", "")
    return Component(
        file=file,
        name=name,
        time=time,
        lat=by_role["lat"],
        lon=by_role["lon"],
        fixed=fixed,
        unit_m_s=unit_m_s,
        steps=axes.read_steps(*axes.time_axis(dataset, time)) if time else TimeSteps(),
        lons_deg=axes.coordinate_axis(dataset, by_role["lon"], period=360.0),
        lats_deg=axes.coordinate_axis(dataset, by_role["lat"]),
        notes=tuple(notes),
    )


def _unit_m_s(array: "xr.DataArray") -> tuple[float, list[Note]]:
    """Return a variable's unit in m/s, and notes; ValueError where it is no unit of speed."""
    units = str(array.attrs.get("units", "")).strip()
    if not units:
        return 1.0, [Note.of("unit-assumed", variable=str(array.name))]
    plain = units.lower().translate(str.maketrans("", "", " .^*"))
    for unit_m_s, spellings in _UNITS_M_S.items():
        if plain in spellings:
            converted = Note.of("unit-converted", variable=str(array.name), unit=units)
            return unit_m_s, [] if unit_m_s == 1 else [converted]
    raise ValueError(
        f"{array.name} is in {units!r}, not in m s-1, cm s-1, km h-1 or knots; give its true unit"
    )


def _combined(
    datasets: "dict[Path, xr.Dataset]",
    u: Sequence[Component],
    v: Sequence[Component],
    notes: tuple[Note, ...],
) -> Contents:
    """Combine both components of all files; ValueError where they don't match each other."""
    first = u[0]
    for other in (*u, *v):
        for axis in ("longitudes", "latitudes"):
            own, theirs = (getattr(one, f"{axis[:3]}s_deg") for one in (other, first))
            if not axes.is_same_axis(own, theirs):
                raise ValueError(
                    f"{other.name} has other {axis} than {first.name}: interpolate both to the "
                    "same nodes (a staggered grid is not supported)"
                )
    (u_steps, u_index), (v_steps, v_index) = (
        axes.merge_steps([one.steps for one in components]) for components in (u, v)
    )
    if u_steps != v_steps:
        raise ValueError(
            f"the components have different times: {u_steps.span}, and {v_steps.span}; give both "
            "for the same times"
        )
    return Contents(
        files=tuple(datasets),
        lon=first.lons_deg,
        lat=first.lats_deg,
        u=tuple(u),
        v=tuple(v),
        steps=u_steps,
        u_index=u_index,
        v_index=v_index,
        notes=tuple(dict.fromkeys([*notes, *(note for one in (*u, *v) for note in one.notes)])),
        attributes={str(k): str(v) for k, v in next(iter(datasets.values())).attrs.items()},
        reference_time=axes.reference_time(datasets.values()),
    )
