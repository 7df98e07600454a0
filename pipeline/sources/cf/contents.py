"""Contents of the user's files of currents, by the CF conventions: components, axes, units, times.

No values of the currents are read here. Faults are collected and reported together, each with what
was found and what is needed.
"""

import contextlib
import glob
import itertools
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.machine.paths import NOT_THERE, shown, unreadable_reason
from pipeline.model import Note
from pipeline.sources.cf import axes
from pipeline.sources.cf.axes import (
    TimeSteps,
    merge_steps,
    read_steps,
    reference_time,
    step_method,
)
from pipeline.sources.cf.dataset import check_values, fatal_files, groups_of, open_dataset

if TYPE_CHECKING:
    import xarray as xr

# Units of speed: size in m/s, and spellings, without blanks, dots, carets and asterisks.
_UNITS_M_S = {
    1.0: ("ms-1", "m/s", "meters-1", "metres-1", "metersecond-1", "metresecond-1", "meters/second"),
    0.01: ("cms-1", "cm/s", "centimeters-1", "centimetersecond-1"),
    0.001: ("mms-1", "mm/s"),
    1 / 3.6: ("kmh-1", "km/h", "kmhr-1", "km/hr", "kph"),
    1852 / 3600: ("knot", "knots", "kt", "kts", "kn", "international_knot"),
}


@dataclass(frozen=True, eq=False)
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


def read_component(
    file: Path,
    dataset: "xr.Dataset",
    name: str,
    along: str = "",
    index: tuple[str, int] | None = None,
) -> Component:
    """Return a component of a file; ValueError where something is wrong with it.

    `along` is the dimension that is read in place of a time. `index` names a further dimension, and
    the place along it.
    """
    array = dataset[name]
    check_values(array)
    for dim, size in array.sizes.items():
        if not size:
            raise ValueError(f"{name} is empty, as {dim} has no values; give a file with data")
    unit_m_s, notes = _unit_m_s(array)
    if re.search(r"\b(depth|lev|z)\w*: ?(\w+: ?)*mean", array.attrs.get("cell_methods", "")):
        notes.append(Note.of("current-over-depth"))
    roles = {dim: axes.axis_role(dataset, str(dim)) for dim in array.dims}
    if along:
        roles = {dim: "" if role == "time" else role for dim, role in roles.items()}
        if along not in roles:
            raise ValueError(f"{name} has no dimension {along!r}; give it along {along}, lat, lon")
        roles[along] = "time"
    by_role = {role: str(dim) for dim, role in roles.items() if role}
    mapping = dataset.variables.get(array.attrs.get("grid_mapping", ""))
    is_turned = mapping is not None and "rotated" in mapping.attrs.get("grid_mapping_name", "")
    if "lon" not in by_role or "lat" not in by_role or is_turned:
        raise ValueError(axes.grid_fault(dataset, array))
    fixed: dict[str, int] = {}
    # A level, or the time, may also be a variable without a dimension.
    scalars = [str(name) for name, variable in dataset.variables.items() if not variable.dims]
    roles |= {name: "level" for name in scalars if axes.axis_role(dataset, name) == "level"}
    times = [name for name in scalars if dataset[name].attrs.get("standard_name") == "time"]
    for dim, role in roles.items():
        if role == "level":
            fixed[str(dim)], level_notes = axes.surface_level(dataset, str(dim))
            notes += level_notes
        elif not role:
            fixed[str(dim)] = _place_along(array, str(dim), index)
    time = by_role.get("time", "")
    clock = "" if along else time or next(iter(times), "")
    named = (*map(str, dataset.attrs.values()), file.name)
    return Component(
        file=file,
        name=name,
        time=time,
        lat=by_role["lat"],
        lon=by_role["lon"],
        fixed={dim: at for dim, at in fixed.items() if dim in array.dims},
        unit_m_s=unit_m_s,
        steps=read_steps(*axes.time_axis(dataset, clock), **step_method(array, clock, named))
        if clock
        else TimeSteps(),
        lons_deg=axes.coordinate_axis(dataset, by_role["lon"], period=360.0),
        lats_deg=axes.coordinate_axis(dataset, by_role["lat"]),
        notes=tuple(notes),
    )


def _place_along(array: "xr.DataArray", dim: str, index: tuple[str, int] | None) -> int:
    """Return the place along a dimension of no known role; ValueError where none is given."""
    size = array.sizes[dim]
    at = index[1] if index is not None and index[0] == dim else 0
    if size == 1 or (index is not None and dim == index[0] and at < size):
        return at
    raise ValueError(
        f"{array.name} has the dimension {dim} ({size}), which is neither time, depth, latitude "
        f"nor longitude; {axes.SWAP}; or keep one index of it; or, of an ensemble, "
        f"plan in all with members = {{ along = '{dim}' }}"
    )


def _unit_m_s(array: "xr.DataArray") -> tuple[float, list[Note]]:
    """Return a variable's unit in m/s, and notes; ValueError where it is no unit of speed."""
    units = str(array.attrs.get("units", "")).strip()
    if not units:
        return 1.0, [Note.of("unit-assumed", variable=str(array.name))]
    plain = re.sub(r"sec\b", "s", units.lower().translate(str.maketrans("", "", " .^*")))
    for unit_m_s, spellings in _UNITS_M_S.items():
        if plain in spellings:
            converted = Note.of("unit-converted", variable=str(array.name), unit=units)
            return unit_m_s, [] if unit_m_s == 1 else [converted]
    raise ValueError(
        f"{array.name} is in {units!r}, not in m s-1, cm s-1, km h-1 or knots; give its true unit"
    )


def require_one_grid(components: Sequence[Component]) -> None:
    """Raise ValueError where components are not on the same nodes."""
    first = components[0]
    for other in components:
        for axis in ("longitudes", "latitudes"):
            own, theirs = (getattr(part, f"{axis[:3]}s_deg") for part in (other, first))
            if not axes.is_same_axis(own, theirs):
                raise ValueError(
                    f"{other.name} has other {axis} than {first.name}: interpolate both to the "
                    "same nodes (a staggered grid is not supported)"
                )


# Parts of harmonic constants: u_re and u_im are those of u.
_PARTS = ("re", "im")
# Dimension that harmonic constants are along.
_CONSTITUENT = "constituent"
_REMEDY = "give a NetCDF, GRIB or Zarr file"
# Number of groups that a message names.
_MAX_GROUPS = 4
# Standard names of eastward components and their partners, and pairs of names for variables without
# a standard name, in the order in which they are preferred.
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
_VARIABLE_NAMES = (
    *(("utotal", "vtotal"), ("uo", "vo"), ("ugos", "vgos"), ("u", "v"), ("water_u", "water_v")),
)
# Attributes that say what a variable is.
_SAYING = ("standard_name", "long_name", "description", "short_name", "GRIB_name", "var_desc")
# Words in these attributes that mean something else than a velocity.
_NO_VELOCITY = r"\b(standard (deviation|error)|variance|uncertaint|(volume|mass) transport)"
# Words that mean wind, air or ice, unless water is named too.
_NO_WATER = r"\b(wind|gust|air|ice|stress|atmospher)"
_WATER = r"\b(water|current)"
# Words that mean waves, which are no current unless they are part of a sum.
_WAVES = r"\b(wave|stokes|swell)"
_SUM = r"(\b[uv]tot|\btot_|_tot|total|sum\b|includ|plus\b)|\+"
# A long name with one of these words is quoted in a note.
_TOLD = rf"(?i){_NO_WATER}|{_WAVES}|{_SUM}|tid(e|al)|bottom|floor|averag|barotrop|anomal|ekman"
_WITHOUT = re.compile(r"\b(without|no|not|excluding)\b[^,;()]*")
# Words that mean moving water, or a part of its motion.
_MOVES = rf"velocity|current|drift|tide|stokes|{_SUM}"
_Variable: TypeAlias = tuple[str, str]
_Pair: TypeAlias = tuple[_Variable, _Variable]


StepInFile: TypeAlias = tuple[Component, int]
"""A component in a file, and the number of a step there."""


@dataclass(frozen=True)
class Contents:
    """What files contain together: axes in the files' own order, both components, time steps.

    `lon` (nx,) and `lat` (ny,) are in degrees, ascending or descending. For each of the `steps`,
    `u` and `v` give the component in a file, and the step in that file.

    Harmonic constants have `constituents` and no time steps: "steps" are the real parts of all
    constituents, then their imaginary parts, then the mean, if the file has one.
    """

    files: tuple[Path, ...]
    lon: FloatArray
    lat: FloatArray
    u: tuple[StepInFile, ...]
    v: tuple[StepInFile, ...]
    steps: TimeSteps
    notes: tuple[Note, ...]
    attributes: dict[str, str]
    reference_time: datetime | None = None
    constituents: tuple[str, ...] = ()

    @property
    def has_mean(self) -> bool:
        """Whether harmonic constants have a mean beside them."""
        return len(self.u) > len(_PARTS) * len(self.constituents)

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
                remedy = f"; {_REMEDY}" if why == NOT_THERE else ""
                faults += [f"{shown(match)} {why}{remedy}"]
        files += [Path(match) for match in matches]
    if faults:
        raise RequestError(faults)
    return tuple(files)


def read_contents(files: tuple[Path, ...], index: tuple[str, int] | None = None) -> Contents:
    """Read the contents of files that belong together; `index` as in `read_component`.

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
        return _contents(files, datasets, index)


def _contents(
    files: tuple[Path, ...], datasets: "dict[Path, xr.Dataset]", index: tuple[str, int] | None
) -> Contents:
    """Return the contents of open files; RequestError as in `read_contents`."""
    if any("u_re" in dataset.data_vars for dataset in datasets.values()):
        return _constants(files, datasets)
    try:
        pair, notes = _find_pair(list(datasets.values()))
    except ValueError as error:
        raise RequestError(f"{name_of(files)}: {error}{_groups_hint(files)}") from None
    faults: list[str] = []
    components_of: tuple[list[Component], list[Component]] = ([], [])
    for (standard, name), components in zip(pair, components_of, strict=True):
        for file, dataset in datasets.items():
            variable = dataset.data_vars.get(name)
            if variable is not None and variable.attrs.get("standard_name", "") == standard:
                try:
                    components.append(read_component(file, dataset, name, index=index))
                except ValueError as error:
                    faults.append(f"{file.name}: {error}")
    if faults:
        raise RequestError(list(dict.fromkeys(faults)))
    try:
        return _combined(datasets, *components_of, notes)
    except ValueError as error:
        raise RequestError(f"{name_of(files)}: {error}") from None


def _find_pair(datasets: "Sequence[xr.Dataset]") -> tuple[_Pair, tuple[Note, ...]]:
    """Find the two components, (standard name, name) each, with notes; ValueError without a pair.

    Of several pairs a total is taken; if there is none, the first in the order of the standard
    names above, and then of the names.
    """
    said = {
        (str(array.attrs.get("standard_name", "")), str(name)): tuple(
            str(array.attrs[key]) for key in _SAYING if array.attrs.get(key)
        )
        for dataset in datasets
        for name, array in dataset.data_vars.items()
        if array.ndim >= 2
    }
    pairs = list(_pairs({of for of, texts in said.items() if not any(map(_is_other, texts))}))
    if not pairs:
        listed = [f"{of[1]} ({'; '.join(said[of]) or 'no standard name'})" for of in sorted(said)]
        raise ValueError(
            f"it has no pair of current components among {', '.join(listed) or 'no variables'}; "
            f"needed are the standard names {' and '.join(_STANDARD_NAMES[0])}, or variables "
            f"called {', '.join(map('/'.join, _VARIABLE_NAMES))}, which nothing calls wind, "
            "ice or waves: give a file of currents, or correct its names"
        )
    text = {of: " ".join((of[1], *texts)).lower() for of, texts in said.items()}
    pair = max(pairs, key=lambda candidate: bool(re.search(_SUM, text[candidate[0]])))
    also = {of for of in said if re.search(_MOVES, text[of]) and not re.search(_NO_WATER, text[of])}
    return pair, tuple(_notes(pair, said, sorted({*also, *itertools.chain(*pairs)} - {*pair})))


def _pairs(variables: set[_Variable]) -> Iterator[_Pair]:
    """Find pairs by their standard names and, of variables without one, by their names."""
    for names in (*_STANDARD_NAMES, ("", "")):
        u, v = ({name.lower(): (of, name) for of, name in variables if of == own} for own in names)
        known = [(u[east], v[north]) for east, north in _VARIABLE_NAMES if east in u and north in v]
        if names[0] and len(u) == len(v) == 1:
            known = list(zip(u.values(), v.values(), strict=True))
        if names[0] and u and v and not known:
            listed = ", ".join(sorted(name for _, name in (*u.values(), *v.values())))
            raise ValueError(
                f"several variables are {names[0]} or its partner ({listed}); keep one pair of them"
            )
        yield from known


def _is_other(said: str) -> bool:
    """Whether a name says that something is no current of water."""
    plain = _WITHOUT.sub("", said.lower().replace("_", " "))
    is_dry = re.search(_NO_WATER, plain) and not re.search(_WATER, plain)
    is_part = re.search(_WAVES, plain) and not re.search(_SUM, plain)
    return bool(is_dry or is_part or re.search(_NO_VELOCITY, plain))


def _notes(
    pair: _Pair, said: Mapping[_Variable, Sequence[str]], also: Sequence[_Variable]
) -> Iterator[Note]:
    """Note why a pair was taken, what the file calls it, and what kind of current it is."""
    (standard, u), (_, v) = pair
    called = "; ".join(said[pair[0]][bool(standard) :])
    why = {
        "by their names alone, as they have no standard name": not standard,
        f"which the file calls {called!r}": called and (not standard or re.search(_TOLD, called)),
        f"not {', '.join(name for _, name in also)}": also,
        f"as east and north, although {standard} is along a grid's own lines: wrong by the angle "
        "of a turned grid, if it was put on this one without turning them": "_x_" in standard,
    }
    if any(why.values()):
        yield Note.of(
            "pair-taken", u=u, v=v, why=tuple(text for text, holds in why.items() if holds)
        )
    if "geostrophic" in standard or u == "ugos":
        yield Note.of("current-geostrophic")
    elif "no_tide" in standard:
        yield Note.of("current-without-tide")


def _constants(files: tuple[Path, ...], datasets: "dict[Path, xr.Dataset]") -> Contents:
    """Return the contents of harmonic constants; RequestError as in `read_contents`."""
    if len(files) > 1:
        raise RequestError(
            f"{name_of(files)}: harmonic constants are one file, and can't be mixed with others; "
            "give that file alone"
        )
    (file, dataset) = next(iter(datasets.items()))
    has_mean = {"u_mean", "v_mean"} <= set(dataset.data_vars)
    parts = [*_PARTS, *["mean"] * has_mean]
    wanted = [f"{component}_{part}" for part in parts for component in "uv"]
    if lacking := [name for name in wanted if name not in dataset.data_vars]:
        raise RequestError(
            f"{file.name}: its harmonic constants lack {', '.join(lacking)}; give u_re, u_im, v_re "
            "and v_im, as `renew tide fit` writes them"
        )
    try:
        components = {
            name: read_component(
                file, dataset, name, along="" if name.endswith("mean") else _CONSTITUENT
            )
            for name in wanted
        }
        require_one_grid(list(components.values()))
        names = axes.coordinate_names(dataset, _CONSTITUENT)
    except ValueError as error:
        raise RequestError(f"{file.name}: {error}") from None
    count = {part: 1 if part == "mean" else len(names) for part in parts}
    u, v = (
        tuple((components[f"{name}_{part}"], step) for part in parts for step in range(count[part]))
        for name in "uv"
    )
    first = components[wanted[0]]
    return Contents(
        files=files,
        lon=first.lons_deg,
        lat=first.lats_deg,
        u=u,
        v=v,
        steps=TimeSteps(),
        notes=_distinct_notes([components[f"{name}_{part}"] for name in "uv" for part in parts]),
        attributes=dict(dataset.attrs),
        constituents=names,
    )


def _distinct_notes(parts: Sequence[Component], before: Sequence[Note] = ()) -> tuple[Note, ...]:
    """Return some notes and those of components, each once."""
    return tuple(dict.fromkeys([*before, *(note for part in parts for note in part.notes)]))


def name_of(files: Sequence[Path]) -> str:
    """Name files in a message: the first, and how many more there are."""
    more = f" and {len(files) - 1} more" if len(files) > 1 else ""
    return f"{files[0].name}{more}"


def _groups_hint(files: Sequence[Path]) -> str:
    """Say that the variables may be in groups, if the first file has any."""
    try:
        groups = groups_of(files[0])
    except ValueError:
        return ""
    if not groups:
        return ""
    if "Group_F" in groups:
        return "; it is an S-100 file, which is not read: give its currents as NetCDF"
    listed = ", ".join(groups[:_MAX_GROUPS])
    return f"; groups ({listed}) are not read: take one out, as with `ncks -G : -g {groups[0]}`"


def _combined(
    datasets: "dict[Path, xr.Dataset]",
    u: Sequence[Component],
    v: Sequence[Component],
    notes: tuple[Note, ...],
) -> Contents:
    """Combine both components of all files; ValueError where they don't match each other."""
    first = u[0]
    require_one_grid([*u, *v])
    references = {file: reference_time(dataset) for file, dataset in datasets.items()}
    (u_steps, u_index), (v_steps, v_index) = (
        merge_steps([part.steps for part in parts], [references[part.file] for part in parts])
        for parts in (u, v)
    )
    known = [time for time in references.values() if time is not None]
    newest = max(known) if len(known) == len(references) else None
    if (count := sum(len(part.steps.labels) for part in u) - len(u_index)) > 0:
        notes = (*notes, Note.of("forecasts-overlap", count=count, reference=newest))
    if u_steps != v_steps:
        raise ValueError(
            f"the components have different times: {u_steps.span}, and {v_steps.span}; give both "
            "for the same times"
        )
    return Contents(
        files=tuple(datasets),
        lon=first.lons_deg,
        lat=first.lats_deg,
        u=tuple((u[file], step) for file, step in u_index),
        v=tuple((v[file], step) for file, step in v_index),
        steps=u_steps,
        notes=_distinct_notes([*u, *v], notes),
        attributes=dict(next(iter(datasets.values())).attrs),
        reference_time=newest,
    )
