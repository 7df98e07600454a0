"""Contents of the user's files of fields, by the CF conventions: components, axes, units, times.

No values of the fields are read here. Faults are collected and reported together, each with what
was found and what is needed.
"""

import contextlib
import glob
import itertools
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from pipeline._types import DataArray, Dataset, FloatArray
from pipeline.errors import RequestError, naming, refuse_any
from pipeline.geo.projection import Bounds
from pipeline.machine.paths import NOT_THERE, shown, unreadable_reason
from pipeline.model import Note
from pipeline.sources.cf import axes, grids, s100
from pipeline.sources.cf.axes import TimeSteps, merge_steps, read_steps, reference_time, step_method
from pipeline.sources.cf.dataset import (
    check_values,
    fatal_files,
    groups_of,
    open_dataset,
    open_together,
)
from pipeline.sources.cf.mesh import Axes, SourceMesh
from pipeline.sources.quantities import CURRENT, Pair, Quantity

# Words in units of speed and length, and the symbols that stand for them.
_SYMBOLS = {
    word + plural: symbol
    for word, symbol in (
        *(("meter", "m"), ("metre", "m"), ("centimeter", "cm"), ("centimetre", "cm")),
        *(("millimeter", "mm"), ("kilometer", "km"), ("kilometre", "km"), ("second", "s")),
        *(("sec", "s"), ("hour", "h"), ("hr", "h"), ("knot", "knot"), ("kt", "kt"), ("per", "/")),
    )
    for plural in ("", "s")
}
# Size of a degree's units, in degrees.
_DEGREES = {"degree": 1.0, "degrees": 1.0, "deg": 1.0, "arc-degrees": 1.0, "degree_true": 1.0}
_DEGREES |= {"degrees_true": 1.0, "degreetrue": 1.0, "degreestrue": 1.0, "": 1.0}
_DEGREES |= dict.fromkeys(("rad", "radian", "radians"), 180.0 / np.pi)


@dataclass(frozen=True, eq=False)
class Component:
    """One component in one file: names of the variable and of its time's dimension, and its grid.

    `time` is empty where there is no such dimension, `fixed` is the index to use in each other
    dimension, and `unit` is its unit in that of the `quantity`, or in degrees for a direction. The
    files `beside` add tiles or a mesh (`open_together`).
    """

    file: Path
    name: str
    time: str
    fixed: dict[str, int]
    unit: float
    grid: Axes | SourceMesh
    steps: TimeSteps
    notes: tuple[Note, ...]
    beside: tuple[Path, ...] = ()
    quantity: Quantity = CURRENT


def read_component(
    file: Path,
    dataset: Dataset,
    name: str,
    along: str = "",
    index: tuple[str, int] | None = None,
    quantity: Quantity = CURRENT,
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
    unit, notes = _unit(array, quantity)
    notes += [Note.of("versions-merged")] * ("is_merged" in array.encoding)
    if re.search(r"\b(depth|lev|z)\w*: ?(\w+: ?)*mean", array.attrs.get("cell_methods", "")):
        notes.append(Note.of("current-over-depth"))
    about = grids.coordinates(dataset, array)
    roles = {dim: next(iter(own), "") if len(own) == 1 else "" for dim, own in about.items()}
    if along:
        roles = {dim: "" if role == "time" else role for dim, role in roles.items()}
        if along not in roles:
            raise ValueError(f"{name} has no dimension {along!r}; give it along {along}, lat, lon")
        roles[along] = "time"
        about[along] = {"time": along}
    by_role = {role: dim for dim, role in roles.items() if role}
    grid = grids.grid_of(dataset, array, about)
    fixed: dict[str, int] = {}
    # A level, or the time, may also be a variable without a dimension.
    scalars = [str(name) for name, variable in dataset.variables.items() if not variable.dims]
    about |= {name: {"level": name} for name in scalars if axes.axis_role(dataset, name) == "level"}
    roles |= {name: "level" for name, own in about.items() if "level" in own and name in scalars}
    times = [name for name in scalars if dataset[name].attrs.get("standard_name") == "time"]
    for dim, role in roles.items():
        if role == "level":
            fixed[dim], level_notes = axes.level_of(
                dataset, about[dim][role], dim, quantity.height_m
            )
            notes += level_notes
        elif not role and dim not in grid.dims:
            fixed[dim], place_notes = _place_along(array, dim, index)
            notes += place_notes
    time = about[by_role["time"]]["time"] if "time" in by_role else ""
    clock = "" if along else time or next(iter(times), "")
    notes += axes.calendar_notes(dataset, clock)
    named = (*map(str, dataset.attrs.values()), file.name)
    return Component(
        file=file,
        name=name,
        time=by_role.get("time", ""),
        fixed={dim: at for dim, at in fixed.items() if dim in array.dims},
        unit=unit,
        steps=read_steps(
            *axes.time_axis(dataset, clock),
            **step_method(array, clock, named, has_maxima="max" in quantity.kinds),
        )
        if clock
        else TimeSteps(),
        grid=grid,
        notes=tuple(notes),
        quantity=quantity,
    )


def _place_along(
    array: DataArray, dim: str, index: tuple[str, int] | None
) -> tuple[int, list[Note]]:
    """Return the place along a dimension of no known role, with notes; ValueError without one."""
    size = array.sizes[dim]
    at = index[1] if index is not None and index[0] == dim else 0
    if size == 1 or (index is not None and dim == index[0] and at < size):
        return at, []
    if dim.lower() in grids.SURFACE:
        at = grids.SURFACE[dim.lower()] % size
        return at, [Note.of("level-by-name", level=dim, at=at)]
    why = (
        "which is neither time, depth, latitude nor longitude; add its coordinate, or keep one "
        f"index of it; or, of an ensemble, plan in all with members = {{ along = '{dim}' }}"
        if dim != "expver"
        else "and some of its times have values of both ERA5 and ERA5T, or of neither; keep one, "
        "as with `ncks -d expver,0`"
    )
    raise ValueError(f"{array.name} has the dimension {dim} ({size}), {why}")


def _unit(array: DataArray, quantity: Quantity) -> tuple[float, list[Note]]:
    """Return a unit in the quantity's, or a direction's in degrees; ValueError without one."""
    units = str(array.attrs.get("units", "")).strip()
    if _is_direction(array):
        if units.lower() in _DEGREES:
            return _DEGREES[units.lower()], []
        raise ValueError(f"{array.name} is in {units!r}, not in degrees; give its true unit")
    if not units:
        assumed = Note.of("unit-assumed", variable=str(array.name), assumed=quantity.unit)
        return 1.0, [assumed]
    unit = quantity.units.get(_plain_unit(units))
    if unit is None:
        raise ValueError(
            f"{array.name} is in {units!r}, not in {quantity.examples}; give its true unit"
        )
    name = str(array.name)
    converted = Note.of("unit-converted", variable=name, unit=units, to=quantity.unit)
    return unit, [] if unit == 1 else [converted]


def _is_direction(array: DataArray) -> bool:
    """Whether a variable is a direction, by its standard name, or its own name and its unit."""
    unit = str(array.attrs.get("units", "")).strip().lower()
    is_called = "dir" in str(array.name).lower() and unit in _DEGREES
    return is_called or "direction" in array.attrs.get("standard_name", "")


def _plain_unit(units: str) -> str:
    """Return a unit as `Quantity.units` spells it, where it is one: "meter sec-1" is "m/s"."""
    words = re.sub(r"[a-z_]+", lambda word: _SYMBOLS.get(word[0], word[0]), units.lower())
    plain = words.translate(str.maketrans("", "", " .^*()"))
    return re.sub(r"(?<=[a-z])([sh])-1$", r"/\1", plain)


def require_one_grid(components: Sequence[Component]) -> None:
    """Raise ValueError where components are not on the same points."""
    first = components[0]
    for other in components:
        if not other.grid.is_same(first.grid):
            raise ValueError(
                f"{other.name} of {other.file.name} has other longitudes or latitudes than "
                f"{first.name} of {first.file.name}; give files of one grid"
            )


# Parts of harmonic constants: u_re and u_im are those of u.
_PARTS = ("re", "im")
# Dimension that harmonic constants are along.
_CONSTITUENT = "constituent"
_REMEDY = "give a NetCDF, GRIB or Zarr file"
# Number of groups that a message names.
_MAX_GROUPS = 4
# Names of components along a grid's own lines, where no standard name says so: NEMO's.
_GRID_NAMES = ("vozocrtx",)
# Words by which a file calls a component one along its grid's lines, or an eastward one.
_ALONG = r"\b(xi|x|i|along|grid|momentum)\b|\b[xui]-(comp|dir|mom)"
_EASTWARD = r"\b(east|zonal)"
# Largest angle of a grid's lines from east at which components count as eastward, degrees.
_STRAIGHT_DEG = 1.0
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


_Values: TypeAlias = tuple[float, ...]
StepInFile: TypeAlias = tuple[Component, int]
"""A component in a file, and the number of a step there."""

Frame: TypeAlias = Literal["east", "lines", "to", "from"]
"""What two components are: east and north, along a grid's lines and across, or a speed and the
direction to which, or from which, the water runs."""


@dataclass(frozen=True)
class Contents:
    """What files contain together: axes in the files' own order, both components, time steps.

    `lon` (nx,) and `lat` (ny,) are in degrees, ascending or descending. For each of the `steps`,
    `u` and `v` give the component in a file, and the step in that file.

    On a mesh the axes are empty, until `on_axes` gives those of a table.

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
    frame: Frame = "east"
    quantity: Quantity = CURRENT

    @property
    def grid(self) -> Axes | SourceMesh:
        """The points of the first component."""
        return self.u[0][0].grid

    @property
    def bounds(self) -> Bounds:
        """Bounds of all points, degrees."""
        if isinstance(self.grid, SourceMesh):
            return self.grid.extent((0.0, 0.0, 2 * float(np.nanmedian(self.grid.lon)), 0.0))
        sides = (self.lon, self.lat)
        west, south, east, north = *(side.min() for side in sides), *(side.max() for side in sides)
        return float(west), float(south), float(east), float(north)

    def on_axes(self, region: Bounds) -> "Contents":
        """Return contents that have axes: on a mesh those of a table for a region."""
        if isinstance(self.grid, Axes):
            return self
        lon, lat, finest, step = self.grid.axes(region)
        told = Note.of(
            "current-on-table", is_turned=self.frame == "lines", finest=finest, step=step
        )
        return replace(self, lon=lon, lat=lat, notes=(*self.notes, told))

    @property
    def has_mean(self) -> bool:
        """Whether harmonic constants have a mean beside them."""
        return len(self.u) > len(_PARTS) * len(self.constituents)

    @property
    def largest_cell(self) -> tuple[float, float]:
        """The largest steps of longitude and latitude, degrees."""
        lon_deg, lat_deg = (
            float(np.abs(np.diff(axis)).max(initial=0.0)) for axis in (self.lon, self.lat)
        )
        return lon_deg, lat_deg


def find_files(paths: Sequence[str]) -> tuple[Path, ...]:
    """Find the files of paths and patterns, in their order.

    Raises RequestError if a file does not exist or can't be read, or no file matches a pattern.
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
    refuse_any(faults)
    return tuple(files)


def read_contents(
    files: tuple[Path, ...],
    index: tuple[str, int] | None = None,
    asked: tuple[str, str] | None = None,
    quantity: Quantity = CURRENT,
) -> Contents:
    """Read the contents of files that belong together; `index` as in `read_component`.

    `asked` names the two variables that are the quantity; by default they are found. Raises
    RequestError if they can't be read, or have no such field on a lon/lat grid: one line for each
    fault.
    """
    refuse_any([f"{file.name}: {fault}" for file, fault in fatal_files(files).items()])
    datasets: dict[Path, Dataset] = {}
    faults = []
    with contextlib.ExitStack() as stack:
        for file in files:
            try:
                datasets[file] = stack.enter_context(open_dataset(file, quantity))
            except ValueError as error:
                faults.append(f"{file.name}: {error}")
        refuse_any(faults)
        contents = _contents(files, datasets, index, asked, quantity)
        return replace(contents, quantity=quantity)


def _together(
    datasets: Mapping[Path, Dataset], names: set[str]
) -> "Iterator[tuple[Path, tuple[Path, ...]]]":
    """Yield the files that have some variables, each with the files beside it.

    Tiles of S-100 are beside each other if they have the same times and other places. Files without
    any of the variables are beside all others: they may have their grid.
    """
    bare = tuple(file for file, dataset in datasets.items() if not names & set(dataset.variables))
    cycles: dict[tuple[_Values, int], dict[tuple[_Values, _Values], Path]] = {}
    for file, dataset in datasets.items():
        if file not in bare and not s100.is_from_s100(dataset):
            yield file, bare
        elif file not in bare:
            times, lat, lon = (
                tuple(dataset[name].values.ravel().tolist()) if name in dataset else ()
                for name in ("time", "lat", "lon")
            )
            # Of a tile that was issued twice each issue is a forecast of its own.
            number = sum((lat, lon) in tiles for (own, _), tiles in cycles.items() if own == times)
            cycles.setdefault((times, number), {})[lat, lon] = file
    for tiles in cycles.values():
        first, *others = (tiles[place] for place in sorted(tiles))
        yield first, tuple(others)


def _contents(
    files: tuple[Path, ...],
    datasets: dict[Path, Dataset],
    index: tuple[str, int] | None,
    asked: tuple[str, str] | None,
    quantity: Quantity,
) -> Contents:
    """Return the contents of open files; RequestError as in `read_contents`."""
    if any("u_re" in dataset.data_vars for dataset in datasets.values()):
        return _constants(files, datasets)
    try:
        pair, notes = _find_pair(list(datasets.values()), asked, quantity)
    except ValueError as error:
        hint = s100.option_of(next(iter(datasets.values()))) or _groups_hint(files)
        raise RequestError(f"{name_of(files)}: {error}{hint}") from None
    beside = dict(_together(datasets, {name for _, name in pair}))
    faults: list[str] = []
    components_of: tuple[list[Component], list[Component]] = ([], [])
    with contextlib.ExitStack() as stack:
        datasets = {
            file: stack.enter_context(open_together(file, others, quantity))
            if others
            else datasets[file]
            for file, others in beside.items()
        }
        for (standard, name), components in zip(pair, components_of, strict=True):
            for file, dataset in datasets.items():
                variable = dataset.data_vars.get(name)
                if variable is not None and variable.attrs.get("standard_name", "") == standard:
                    try:
                        component = read_component(
                            file, dataset, name, index=index, quantity=quantity
                        )
                        components.append(replace(component, beside=beside[file]))
                    except ValueError as error:
                        faults.append(f"{file.name}: {error}")
    refuse_any(list(dict.fromkeys(faults)))
    with naming(name_of(files)):
        contents = _combined(files, datasets, *components_of, notes)
        frame = _frame(pair, contents, datasets)
    is_on_axes = isinstance(contents.grid, Axes)
    told = tuple(_frame_notes(pair, frame, quantity, is_on_axes=is_on_axes))
    return replace(contents, frame=frame, notes=(*contents.notes, *told))


def _frame_notes(
    pair: _Pair, frame: Frame, quantity: Quantity, *, is_on_axes: bool
) -> Iterator[Note]:
    """Note what the components of a pair are taken for, if nothing proves it."""
    (standard, east), (_, north) = pair
    taken = partial(Note.of, "pair-taken", quantity=quantity.name, names=(east, north))
    if is_on_axes and re.search(r"(_|^)x_", standard):
        why = (
            f"as east and north, although {standard} is along a grid's own lines: wrong by the "
            "angle of a turned grid, if it was put on this one without turning them"
        )
        yield taken(why=(why,))
    if frame in {"to", "from"}:
        yield taken(why=(f"as the speed and the direction {frame} which it moves",))


def _frame(pair: _Pair, contents: Contents, datasets: dict[Path, Dataset]) -> Frame:
    """Return what the two components of a pair are; ValueError where nothing says it."""
    (standard, name), (direction, _) = pair
    u, v = contents.u[0][0], contents.v[0][0]
    if _is_direction(datasets[v.file][v.name]):
        is_from = "from" in direction or not (direction or u.quantity.is_current)
        return "from" if is_from else "to"
    if isinstance(u.grid, Axes) or len(u.grid.dims) == 1 or u.name == v.name:
        return "east"
    if standard or name.lower() in _GRID_NAMES:
        return "east" if "eastward" in standard else "lines"
    attributes = datasets[u.file][name].attrs
    said = " ".join((name.replace("_", " "), *(attributes.get(key, "") for key in _SAYING))).lower()
    # East and north have no reason to be on points of their own.
    is_staggered = not u.grid.is_same(v.grid)
    if re.search(_EASTWARD, said):
        return "east"
    if is_staggered or re.search(_ALONG, said):
        return "lines"
    if u.grid.largest_angle_deg <= _STRAIGHT_DEG:
        return "east"
    raise ValueError(
        f"its grid is turned by up to {u.grid.largest_angle_deg:.0f} degrees, and nothing says "
        f"whether {name} is eastward or along the grid's lines; give both components a "
        "standard_name, eastward_sea_water_velocity and northward_sea_water_velocity or "
        "sea_water_x_velocity and sea_water_y_velocity, as with `ncatted -a standard_name`"
    )


def _find_pair(
    datasets: Sequence[Dataset], asked: tuple[str, str] | None, quantity: Quantity
) -> tuple[_Pair, tuple[Note, ...]]:
    """Find the two components, (standard name, name) each, with notes; ValueError without a pair.

    A pair that is asked for by its names is taken, unless the file calls it something else. Of
    several pairs a total is taken; if there is none, the first in the order of the standard names,
    and then of the names.
    """
    said = {
        (str(array.attrs.get("standard_name", "")), str(name)): tuple(
            str(array.attrs[key]) for key in _SAYING if array.attrs.get(key)
        )
        for dataset in datasets
        for name, array in dataset.data_vars.items()
        if array.ndim >= 2 or "mesh" in array.attrs
    }
    listed = [f"{of[1]} ({'; '.join(said[of]) or 'no standard name'})" for of in sorted(said)]
    if asked is not None:
        by_name = {name: (standard, name) for standard, name in said}
        if lacking := [name for name in asked if name not in by_name]:
            raise ValueError(f"it has no variable {', '.join(lacking)}, but {', '.join(listed)}")
        named = (by_name[asked[0]], by_name[asked[1]])
        _refuse_other(named, said)
        return named, tuple(_notes(named, said, (), quantity, is_asked=True))
    if not quantity.is_current:
        pair = _found(said, listed, quantity)
        return pair, tuple(_notes(pair, said, (), quantity))
    water = {of for of, texts in said.items() if not any(map(_is_other, texts))}
    pairs = list(_pairs(water, quantity))
    if not pairs:
        for named in _pairs(set(said), quantity):
            _refuse_other(named, said)
        raise ValueError(
            f"it has no pair of current components among {', '.join(listed) or 'no variables'}; "
            f"needed are the standard names {' and '.join(quantity.standard_names[0])}, or "
            f"variables called {', '.join(map('/'.join, quantity.variable_names[:_MAX_GROUPS]))} "
            "and the like: give a file of currents, correct its names, or name the two "
            "(--current-variables U,V, or current_variables in a season)"
        )
    text = {of: " ".join((of[1], *texts)).lower() for of, texts in said.items()}
    pair = max(pairs, key=lambda candidate: bool(re.search(_SUM, text[candidate[0]])))
    also = {of for of in said if re.search(_MOVES, text[of]) and not re.search(_NO_WATER, text[of])}
    return pair, tuple(
        _notes(pair, said, sorted({*also, *itertools.chain(*pairs)} - {*pair}), quantity)
    )


def _found(
    said: Mapping[_Variable, Sequence[str]], listed: Sequence[str], quantity: Quantity
) -> _Pair:
    """Return the first pair of a quantity that is no current; ValueError without one.

    A name that its files mostly have is enough, whatever standard name stands with it. So is that
    the file calls one variable the quantity's first component, and one its second.
    """
    bare = {("", name): (standard, name) for standard, name in said}
    for pair in _pairs(set(said), quantity):
        return pair
    for first, second in _pairs(set(bare), quantity):
        return bare[first], bare[second]
    called = [
        [of for of, texts in said.items() if re.search(words, " ".join(texts), re.IGNORECASE)]
        for words in quantity.called
    ]
    if [len(each) for each in called] == [1, 1]:
        return called[0][0], called[1][0]
    names = dict.fromkeys(itertools.chain(*quantity.standard_names[:1]))
    own = ", ".join("/".join(dict.fromkeys(pair)) for pair in quantity.variable_names[:_MAX_GROUPS])
    raise ValueError(
        f"it has no {quantity.name} among {', '.join(listed) or 'no variables'}; needed is the "
        f"standard name {' with '.join(names)}, or a variable called {own} or the like: give a "
        f"file of the {quantity.name}, or correct its names"
    )


def _pairs(variables: set[_Variable], quantity: Quantity) -> Iterator[_Pair]:
    """Find pairs by their standard names and, of variables without one, by their names."""
    every: tuple[Pair, ...] = (*quantity.standard_names, *quantity.polar_names, ("", ""))
    for names in every:
        u, v = ({name.lower(): (of, name) for of, name in variables if of == own} for own in names)
        known = [
            (u[east], v[north])
            for east, north in quantity.variable_names
            if east in u and north in v
        ]
        if names[0] and len(u) == len(v) == 1:
            known = list(zip(u.values(), v.values(), strict=True))
        if names[0] and u and v and not known:
            listed = ", ".join(sorted(name for _, name in (*u.values(), *v.values())))
            raise ValueError(
                f"several variables are {names[0]} or its partner ({listed}); keep one pair of them"
            )
        yield from known


def _refuse_other(pair: _Pair, said: Mapping[_Variable, Sequence[str]]) -> None:
    """Raise ValueError for a pair that the file calls something else than a current."""
    if other := next(filter(_is_other, itertools.chain(*(said[of] for of in pair))), ""):
        (_, u), (_, v) = pair
        raise ValueError(
            f"{u} and {v} are no current: the file calls one {other!r}; give a file of currents, "
            "name others (--current-variables U,V), or correct that"
        )


def _is_other(said: str) -> bool:
    """Whether a name says that something is no current of water."""
    plain = _WITHOUT.sub("", said.lower().replace("_", " "))
    is_dry = re.search(_NO_WATER, plain) and not re.search(_WATER, plain)
    is_part = re.search(_WAVES, plain) and not re.search(_SUM, plain)
    return bool(is_dry or is_part or re.search(_NO_VELOCITY, plain))


def _notes(
    pair: _Pair,
    said: Mapping[_Variable, Sequence[str]],
    also: Sequence[_Variable],
    quantity: Quantity,
    *,
    is_asked: bool = False,
) -> Iterator[Note]:
    """Note why a pair was taken, what the file calls it, and what kind of current it is."""
    (standard, u), (_, v) = pair
    known = standard in itertools.chain(*quantity.standard_names, *quantity.polar_names)
    is_told = not known or (quantity.is_current and re.search(_TOLD, "; ".join(said[pair[0]])))
    called = "; ".join(said[pair[0]][bool(standard) :])
    why = {
        "as asked": is_asked,
        "by their names alone, as they have no standard name": not known and not is_asked,
        f"which the file calls {called!r}": called and is_told,
        f"not {', '.join(name for _, name in also)}": also,
    }
    if any(why.values()):
        yield Note.of(
            "pair-taken",
            quantity=quantity.name,
            names=tuple(dict.fromkeys((u, v))),
            why=tuple(text for text, holds in why.items() if holds),
        )
    if "geostrophic" in standard or u == "ugos":
        yield Note.of("current-geostrophic")
    elif "no_tide" in standard:
        yield Note.of("current-without-tide")


def _constants(files: tuple[Path, ...], datasets: dict[Path, Dataset]) -> Contents:
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
    with naming(file.name):
        components = {
            name: read_component(
                file, dataset, name, along="" if name.endswith("mean") else _CONSTITUENT
            )
            for name in wanted
        }
        require_one_grid(list(components.values()))
        names = axes.coordinate_names(dataset, _CONSTITUENT)
    count = {part: 1 if part == "mean" else len(names) for part in parts}
    u, v = (
        tuple((components[f"{name}_{part}"], step) for part in parts for step in range(count[part]))
        for name in "uv"
    )
    grid = components[wanted[0]].grid
    return Contents(
        files=files,
        lon=grid.lon,
        lat=grid.lat,
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
    listed = ", ".join(groups[:_MAX_GROUPS])
    return f"; groups ({listed}) are not read: take one out, as with `ncks -G : -g {groups[0]}`"


def _on_shared_grids(
    u: Sequence[Component], v: Sequence[Component]
) -> tuple[Sequence[Component], Sequence[Component]]:
    """Return components of which all that are on one mesh share it; ValueError as below.

    Each of the two may have its own points: then both are on meshes.
    """
    for parts in (u, v):
        require_one_grid(parts)
    is_one = u[0].grid.is_same(v[0].grid)
    if isinstance(u[0].grid, Axes) and is_one:
        return u, v
    own = u[0].grid.as_mesh()
    meshes = (own, own if is_one else v[0].grid.as_mesh())
    east, north = (
        [replace(part, grid=mesh) for part in parts]
        for parts, mesh in zip((u, v), meshes, strict=True)
    )
    return east, north


def _combined(
    files: tuple[Path, ...],
    datasets: dict[Path, Dataset],
    u: Sequence[Component],
    v: Sequence[Component],
    notes: tuple[Note, ...],
) -> Contents:
    """Combine both components of all files; ValueError where they don't match each other."""
    u, v = _on_shared_grids(u, v)
    first = u[0]
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
        files=files,
        lon=first.grid.lon if isinstance(first.grid, Axes) else np.zeros(0),
        lat=first.grid.lat if isinstance(first.grid, Axes) else np.zeros(0),
        u=tuple((u[file], step) for file, step in u_index),
        v=tuple((v[file], step) for file, step in v_index),
        steps=u_steps,
        notes=_distinct_notes([*u, *v], notes),
        attributes=dict(next(iter(datasets.values())).attrs),
        reference_time=newest,
    )
