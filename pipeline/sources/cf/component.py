"""A component of a current in a file: its variable, unit, axes and time steps."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline._types import FloatArray
from pipeline.model import Note
from pipeline.sources.cf import axes
from pipeline.sources.cf.dataset import check_values
from pipeline.sources.cf.times import TimeSteps, read_steps, step_method

if TYPE_CHECKING:
    import xarray as xr

# Size of each unit of speed in m/s, and its spellings, without blanks, dots, carets and asterisks.
_UNITS_M_S = {
    1.0: ("ms-1", "m/s", "meters-1", "metres-1", "metersecond-1", "metresecond-1", "meters/second"),
    0.01: ("cms-1", "cm/s", "centimeters-1", "centimetersecond-1"),
    0.001: ("mms-1", "mm/s"),
    1 / 3.6: ("kmh-1", "km/h", "kmhr-1", "km/hr", "kph"),
    1852 / 3600: ("knot", "knots", "kt", "kts", "kn", "international_knot"),
}


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


def read_component(
    file: Path,
    dataset: "xr.Dataset",
    name: str,
    along: str = "",
    index: tuple[str, int] | None = None,
) -> Component:
    """Return a component of a file; ValueError where something is wrong with it.

    `along` is a dimension that takes the place of the time; `index` is the place along another one.
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
    scalars = [str(name) for name, one in dataset.variables.items() if not one.dims]
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
            own, theirs = (getattr(one, f"{axis[:3]}s_deg") for one in (other, first))
            if not axes.is_same_axis(own, theirs):
                raise ValueError(
                    f"{other.name} has other {axis} than {first.name}: interpolate both to the "
                    "same nodes (a staggered grid is not supported)"
                )
