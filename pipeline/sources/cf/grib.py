"""GRIB files of currents, wind and waves, editions 1 and 2, as datasets by the CF conventions.

They are read by ecCodes itself. cfgrib (0.9.15), which is built on it, is not used: it knows
variables by ECMWF's names, of which the WMO's components of a current have none, and so makes one
variable of both. If a time has several fields, it takes the first without a word. And it writes an
index beside the file, a pickle, and reads it back.

The source is the WMO's Manual on Codes (I.2: FM 92 GRIB). Programs for sailors write 49 and 50
under any centre and version of table 2, and on several kinds of level.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from pipeline._types import Dataset, FloatArray
from pipeline.sources import quantities

# Tables of edition 1 from this version on are a centre's own.
_FIRST_LOCAL_TABLE = 128
# Components that belong together, in the order of preference.
_PAIRS = (
    (quantities.EAST, quantities.NORTH),
    (quantities.SPEED, quantities.DIRECTION),
    (quantities.SIZE, quantities.SIZE),
)
_REGULAR = "regular_ll"
# Depth of each kind of level, m per unit. A lone level of another kind counts as the surface.
_DEPTHS_M = dict.fromkeys(("surface", "meanSea", "oceanSurface"), 0.0)
_DEPTHS_M |= dict.fromkeys(("depthBelowSea", "depthBelowSeaLayer"), 1.0)
_DEPTH = {"standard_name": "depth", "units": "m", "positive": "down"}
# Numbers that mean no centre, though the library has names for them.
_NO_CENTRES = (255, 65535)
# Largest number of nodes of a field: 512 MB.
_MAX_NODES = 64 << 20
# Largest difference between an axis's step and the one that the file states, as a share of it:
# edition 1 rounds to millidegrees.
_STEP_SHARE = 0.05
# Number of other parameters, and of kinds of level, that a message names.
_MAX_NAMES = 4
# What the library gives for a node without a value.
_MISSING = 1e30
_SINCE = {"units": "seconds since 1970-01-01 00:00:00", "calendar": "standard"}
_Axis = tuple[float, float, int]


@dataclass(frozen=True, slots=True)
class Grid:
    """A grid: its kind; of each axis the first and the last node (degrees), and how many there are.

    `steps_deg` are the steps that the file states for longitude and latitude; 0 where it does not.
    Values run along longitudes first, or along latitudes if `by_column`. If the grid `snakes`, each
    line runs the other way than the line before.
    """

    kind: str
    lons: _Axis = (0.0, 0.0, 0)
    lats: _Axis = (0.0, 0.0, 0)
    steps_deg: tuple[float, ...] = (0.0, 0.0)
    by_column: bool = False
    snakes: bool = False

    @property
    def shape(self) -> tuple[int, int]:
        """Number of nodes along latitude and longitude."""
        return self.lats[2], self.lons[2]


@dataclass(frozen=True, slots=True)
class GribField:
    """A component at one time: where it lies in its file, and what its message states.

    `part` counts the fields of the message that begins at the byte `offset`. Times are seconds
    since 1970: `time` is that of the values, or the end of the period that begins at `begin`.
    `member` is -1 outside an ensemble.
    """

    component: str
    offset: int
    part: int
    reference: int
    begin: int
    time: int
    kind: str
    level: tuple[str, float]
    member: int
    grid: Grid

    @property
    def depth_m(self) -> float:
        """The depth of its level."""
        kind, value = self.level
        return _DEPTHS_M.get(kind, 0.0) * value


Read: TypeAlias = tuple[tuple[GribField, ...], tuple[str, ...], str]
"""The fields of a quantity in a file, the names of its other parameters, and its centre."""


def require_library() -> None:
    """Raise ValueError where ecCodes is not installed."""
    try:
        import eccodes  # noqa: F401 - only to see whether it can be loaded
    except (ImportError, RuntimeError):
        raise ValueError(
            "it is GRIB, and ecCodes is not installed; pip install eccodes eccodeslib, or "
            "convert it, as with `cdo -f nc copy`"
        ) from None


@contextmanager
def _messages(path: Path, offset: int = 0) -> Iterator[Iterator[int]]:
    """Yield the handles of a file's fields from a byte on: each is valid until the next."""
    import eccodes

    def handles() -> Iterator[int]:
        try:
            while (handle := eccodes.codes_grib_new_from_file(file)) is not None:
                try:
                    yield handle
                finally:
                    eccodes.codes_release(handle)
        except eccodes.PrematureEndOfFileError:
            raise ValueError("it ends in the middle of a message") from None

    with path.open("rb") as file:
        file.seek(offset)
        # A message of edition 2 may hold several fields, as NCEP's hold both components.
        eccodes.codes_grib_multi_support_on()
        eccodes.codes_grib_multi_support_reset_file(file)
        yield handles()


def read_fields(path: Path, quantity: quantities.Quantity) -> Read:
    """Read what a file says of a quantity; errors of the library where it is damaged."""
    fields, others, centre = [], dict[str, None](), ""
    at, part = -1, 0
    with _messages(path) as handles:
        for handle in handles:
            offset = int(_get(handle, "offset", float))
            at, part = offset, (part + 1 if offset == at else 0)
            if _get(handle, "centre", int) not in _NO_CENTRES:
                centre = _get(handle, "centreDescription", str, "")
            parameter = _parameter(handle)
            if parameter in quantity.grib:
                fields.append(_field(handle, quantity.grib[parameter], at, part))
            else:
                name = _get(handle, "name", str, "unknown")
                number = f"parameter {'/'.join(map(str, parameter))}"
                others[number if name == "unknown" else name] = None
    return tuple(fields), tuple(others), centre


def check_values(path: Path) -> None:
    """Read all values that are known; errors of the library where they are damaged."""
    for quantity in quantities.QUANTITIES:
        for field in read_fields(path, quantity)[0]:
            if field.grid.kind == _REGULAR and math.prod(field.grid.shape) <= _MAX_NODES:
                _values(path, field)


def _get(handle: int, key: str, kind: type, default: Any = None) -> Any:  # noqa: ANN401 - untyped
    """Return the value of a key; where there is no such key the default, if one is given."""
    import eccodes

    try:
        return eccodes.codes_get(handle, key, kind)
    except eccodes.KeyValueNotFoundError:
        if default is None:
            raise
        return default


def _parameter(handle: int) -> tuple[int, ...]:
    """Return a field's parameter, as in `Quantity.grib`."""
    if _get(handle, "edition", int) == 1:
        table = _get(handle, "table2Version", int)
        number = _get(handle, "indicatorOfParameter", int)
        return (number,) if table < _FIRST_LOCAL_TABLE else (number, table)
    keys = ("discipline", "parameterCategory", "parameterNumber")
    return tuple(_get(handle, key, int) for key in keys)


def _field(handle: int, component: str, offset: int, part: int) -> GribField:
    """Return what a message says of a component."""
    import eccodes

    eccodes.codes_set(handle, "stepUnits", "m")
    day, clock = (_get(handle, key, int) for key in ("dataDate", "dataTime"))
    begin, end = (60 * _get(handle, key, int) for key in ("startStep", "endStep"))
    reference = datetime.strptime(f"{day}{clock:04}", "%Y%m%d%H%M").replace(tzinfo=UTC)
    since = int(reference.timestamp())
    return GribField(
        component=component,
        offset=offset,
        part=part,
        reference=since,
        begin=since + begin,
        time=since + end,
        kind=_get(handle, "stepType", str),
        level=(_get(handle, "typeOfLevel", str), _get(handle, "level", float)),
        member=_get(handle, "perturbationNumber", int, -1),
        grid=_grid(handle),
    )


def _grid(handle: int) -> Grid:
    """Return what a message says of its grid; of a grid that is not regular only its kind."""
    import eccodes

    kind = _get(handle, "gridType", str)
    if kind != _REGULAR:
        return Grid(kind)
    axes: list[_Axis] = []
    steps_deg = []
    for axis, letter in (("longitude", "i"), ("latitude", "j")):
        first, last = (
            _get(handle, f"{axis}Of{end}GridPointInDegrees", float) for end in ("First", "Last")
        )
        axes.append((first, last, _get(handle, f"N{letter}", int)))
        step = f"{letter}DirectionIncrement"
        is_stated = not eccodes.codes_is_missing(handle, step)
        steps_deg.append(_get(handle, f"{step}InDegrees", float) if is_stated else 0.0)
    (west, east, columns), lats = axes
    if _get(handle, "iScansNegatively", int):
        east -= 360.0 * (east > west)
    else:
        east += 360.0 * (east < west)
    return Grid(
        kind,
        (west, east, columns),
        lats,
        tuple(steps_deg),
        bool(_get(handle, "jPointsAreConsecutive", int)),
        bool(_get(handle, "alternativeRowScanning", int)),
    )


def _values(path: Path, field: GribField) -> FloatArray:
    """Read the values of a field (ny, nx), m/s, with NaN where there are none."""
    import eccodes

    with _messages(path, field.offset) as handles:
        handle = next(itertools.islice(handles, field.part, None))
        eccodes.codes_set(handle, "missingValue", _MISSING)
        values = np.array(eccodes.codes_get_values(handle), dtype=float)
    values[values == _MISSING] = np.nan
    shape, grid = field.grid.shape, field.grid
    lines = values.reshape(shape[::-1] if grid.by_column else shape)
    if grid.snakes:
        lines[1::2] = lines[1::2, ::-1]
    return lines.T if grid.by_column else lines


def as_dataset(path: Path, read: Read, quantity: quantities.Quantity) -> Dataset:
    """Return a quantity's fields as a dataset whose values are read when they are needed.

    Raises ValueError if there are none, or they are not along time, latitude and longitude.
    """
    import xarray as xr

    all_fields, others, centre = read
    fields = _uppermost(all_fields, others, quantity)
    grid = _one_grid(fields)
    there = {field.component for field in fields}
    pair = next((two for two in _PAIRS if there & {*two}), _PAIRS[0])
    series = {component: _in_time(fields, component) for component in pair}
    times = {component: [field.time for field in own] for component, own in series.items()}
    if lacking := set(times[pair[0]]) ^ set(times[pair[1]]):
        raise ValueError(
            f"it has only one component at {_moment(min(lacking))}; give both for the same times"
        )
    newest = max(field.reference for field in fields)
    since = {"standard_name": "time", "bounds": "periods", **_SINCE}
    level, value = fields[0].level
    about: dict[str, str] = {"positive": "down"}
    if level in _DEPTHS_M:
        level, value, about = "depth", fields[0].depth_m, _DEPTH
    coordinates: dict[str, Any] = {
        "time": ("time", np.array(times[pair[0]], float), since),
        level: (level, [value], about),
        "latitude": ("latitude", np.linspace(*grid.lats), {"units": "degrees_north"}),
        "longitude": ("longitude", np.linspace(*grid.lons), {"units": "degrees_east"}),
        "reference": ((), newest, {"standard_name": "forecast_reference_time", **_SINCE}),
    }
    variables = {
        quantity.grib_names[component][0]: xr.Variable(
            ("time", level, "latitude", "longitude"),
            _lazy(path, own),
            dict(zip(("standard_name", "units"), quantity.grib_names[component][1:], strict=True)),
        )
        for component, own in series.items()
    }
    periods = np.array([(field.begin, field.time) for field in series[pair[0]]], float)
    variables["periods"] = xr.Variable(("time", "side"), periods)
    return xr.Dataset(variables, coordinates, {"institution": centre})


def _uppermost(
    fields: Sequence[GribField], others: Sequence[str], quantity: quantities.Quantity
) -> list[GribField]:
    """Return the fields of the uppermost level; ValueError where they can't be used."""
    if not fields:
        more = ", …" if len(others) > _MAX_NAMES else ""
        listed = ", ".join(others[:_MAX_NAMES]) or "no fields"
        raise ValueError(f"it has {listed}{more}, and not {quantity.grib_text}")
    for level in quantity.levels:
        if there := [field for field in fields if field.level == level]:
            fields = there
            break
    if kinds := sorted({field.kind for field in fields}.difference(quantity.kinds)):
        raise ValueError(
            f"its fields are neither those of a time nor means ({', '.join(kinds)}); give such"
        )
    if (members := len({field.member for field in fields})) > 1:
        raise ValueError(f"it is an ensemble of {members}; keep one member")
    levels = {field.level for field in fields}
    unknown = sorted({kind for kind, _ in levels} - _DEPTHS_M.keys())
    if unknown and len(levels) > 1:
        raise ValueError(
            f"it has fields on {len(levels)} levels, some of the kind "
            f"{', '.join(unknown[:_MAX_NAMES])}; keep the surface alone"
        )
    least = min(field.depth_m for field in fields)
    return [field for field in fields if field.depth_m == least]


def _one_grid(fields: Sequence[GribField]) -> Grid:
    """Return the grid of fields; ValueError where they have several, or it can't be used."""
    grids = {field.grid for field in fields}
    if len(grids) > 1:
        raise ValueError(f"its fields are on {len(grids)} grids; keep one of them")
    grid = grids.pop()
    if grid.kind != _REGULAR:
        raise ValueError(
            f"its grid is of the kind {grid.kind}; make it NetCDF, as with `cdo -f nc copy`, which "
            "is read if it has lon and lat of its points"
        )
    if math.prod(grid.shape) > _MAX_NODES:
        raise ValueError(
            f"its grid states {grid.shape[0]:,} x {grid.shape[1]:,} nodes, more than "
            f"{_MAX_NODES:,}; cut out the region"
        )
    axes = (("longitude", grid.lons), ("latitude", grid.lats))
    for (name, (first, last, count)), stated in zip(axes, grid.steps_deg, strict=True):
        if abs(abs(last - first) / max(count - 1, 1) - stated) > _STEP_SHARE * stated > 0:
            raise ValueError(
                f"its {name}s contradict each other: {count} from {first:g} to {last:g}, and a "
                f"step of {stated:g}; fetch it again"
            )
    return grid


def _in_time(fields: Sequence[GribField], component: str) -> list[GribField]:
    """Return a component's fields in time; ValueError where two have the same time."""
    own = sorted(
        (field for field in fields if field.component == component), key=lambda field: field.time
    )
    for field, following in itertools.pairwise(own):
        if field.time == following.time:
            raise ValueError(
                f"it has two fields of the {component} component at {_moment(field.time)}; leave "
                "one out"
            )
    return own


def _moment(time: int) -> str:
    """Write a time: "2024-07-01T06:00Z"."""
    return f"{datetime.fromtimestamp(time, UTC):%Y-%m-%dT%H:%MZ}"


def _lazy(path: Path, fields: Sequence[GribField]) -> Any:  # noqa: ANN401 - a type of xarray's inside
    """Return fields (nt, 1, ny, nx) as an array that reads only those that are asked for."""
    from xarray.backends import BackendArray
    from xarray.core import indexing

    class Values(BackendArray):
        shape = (len(fields), 1, *fields[0].grid.shape)
        dtype = np.dtype(float)

        def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:  # noqa: ANN401 - as above
            basic = indexing.IndexingSupport.BASIC
            return indexing.explicit_indexing_adapter(key, self.shape, basic, self.read)

        def read(self, key: tuple[Any, ...]) -> FloatArray:
            """Read whole fields, and cut the rest of the key out of them."""
            chosen = np.arange(len(fields))[key[0]]
            read = np.stack([_values(path, fields[i])[None][key[1:]] for i in np.ravel(chosen)])
            return read if np.ndim(chosen) else read[0]

    return indexing.LazilyIndexedArray(Values())
