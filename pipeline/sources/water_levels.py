"""Official water levels, S-104: the height of the sea over chart datum, in zones of like water.

Unlike a tide that constants predict, these levels have the residual of wind and air pressure, and
differ from place to place. A zone joins nodes whose levels stay close at all hours; its own is the
lowest of them at each hour, so it is never above the file's. A node that the model leaves dry has
the lowest level of the nodes around it, up to two cells from the water: the model's cells are
coarser than a chart's coast.
"""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import shapely

import renew
from pipeline._types import BoolArray, Dataset, FloatArray, IndexArray
from pipeline.errors import refuse_any
from pipeline.machine.paths import shown
from pipeline.sources.cf.axes import merge_steps, read_steps, reference_time, time_axis
from pipeline.sources.cf.dataset import fatal_files, open_dataset, reading
from pipeline.sources.cf.s100 import is_s100, option_of
from pipeline.sources.land.s57 import DATUMS

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

# Largest difference at any hour between a zone's first node and another, m: a third of the height
# by which a tide may be lower than predicted. So a zone's level is at most twice this too low.
_ALIKE_M = 0.05
# Cells from the water up to which nodes without a level have that of their neighbours.
_RINGS = 2
# Steps that are further apart than this multiple of the usual one have a hole between them.
_HOLE = 1.5
# Time between the levels among which the lowest and the highest are looked for, s.
_STEP_S = 300.0
_VARIABLE = "waterLevelHeight"


@dataclass(frozen=True, eq=False)
class LevelSeries(renew.Tide):
    """Levels (n,), m over datum, at `instants` (n,), s since 1970 UTC, in place of constants.

    Between instants they follow a cubic spline. Before and after them the lowest counts.
    """

    instants: FloatArray = field(default_factory=lambda: np.empty(0))
    levels: FloatArray = field(default_factory=lambda: np.empty(0))

    def heights(self, times: FloatArray) -> FloatArray:
        """Heights over datum (m) at times (s on the planner's clock), of the same shape."""
        epoch_s = (np.datetime64(self.epoch) - np.datetime64(0, "s")) / np.timedelta64(1, "s")
        at = np.asarray(times, dtype=float) + epoch_s
        is_known = (at >= self.instants[0]) & (at <= self.instants[-1])
        within = np.clip(at, self.instants[0], self.instants[-1])
        return np.where(is_known, self._curve(within), self.lowest)

    @cached_property
    def _curve(self) -> "CubicSpline":
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.instants, self.levels)

    @cached_property
    def _range(self) -> tuple[float, float]:
        """The lowest and the highest level, m."""
        count = int((self.instants[-1] - self.instants[0]) / _STEP_S) + 2
        between = self._curve(np.linspace(self.instants[0], self.instants[-1], count))
        own = np.concatenate([between, self.levels])
        return float(own.min()), float(own.max())

    @property
    def lowest(self) -> float:
        """The lowest level (m)."""
        return self._range[0]

    @property
    def highest(self) -> float:
        """The highest level (m)."""
        return self._range[1]


class LevelZone(NamedTuple):
    """Water whose level is one series: its `area` is in lon/lat degrees.

    The `series` are instants (n,), s since 1970 UTC, and levels (n,), m over the datum.
    """

    source: str
    datum: str
    area: shapely.MultiPolygon
    series: tuple[FloatArray, FloatArray]


def has_levels(path: Path) -> bool:
    """Whether a path is that of an S-100 file; False for what is no path."""
    with contextlib.suppress(OSError):  # a name may be too long for one
        return path.is_file() and is_s100(path)
    return False


def read_levels(paths: Sequence[Path]) -> tuple[LevelZone, ...]:
    """Read the zones of S-104 files: tiles beside each other, and forecasts of the same tile.

    Raises RequestError if a file can't be read, has no levels of several hours on a grid, or states
    no datum that is known: one line for each.
    """
    faults = [f"{shown(path.name)}: {fault}" for path, fault in fatal_files(paths).items()]
    tiles: list[dict[Path, Dataset]] = []
    for path in paths if not faults else ():
        try:
            dataset = open_dataset(path)
            _check(dataset)
        except ValueError as error:
            faults.append(f"{shown(path.name)}: {error}")
            continue
        same = (tile for tile in tiles if _grid(next(iter(tile.values()))) == _grid(dataset))
        if (tile := next(same, None)) is None:
            tiles.append(tile := {})
        tile[path] = dataset
    zones = list[LevelZone]()
    for tile in tiles if not faults else ():
        try:
            zones += _zones(tile)
        except ValueError as error:
            faults.append(f"{_name(tile)}: {error}")
    refuse_any([f"tide: {fault}" for fault in faults])
    return tuple(zones)


def _name(tile: dict[Path, Dataset]) -> str:
    """Name the files of a tile in a message."""
    return shown(next(iter(tile)).name) + (f" and {len(tile) - 1} more" if len(tile) > 1 else "")


def _grid(dataset: Dataset) -> list[bytes]:
    """Return the nodes of a dataset, to compare them."""
    return [dataset[name].values.tobytes() for name in ("lon", "lat")]


def _check(dataset: Dataset) -> None:
    """Raise ValueError for a dataset without levels of several hours, of a known datum, in m."""
    if _VARIABLE not in dataset.data_vars:
        hint = option_of(dataset)
        raise ValueError(f"it has no water levels; give S-104, or a station's file{hint}")
    array = dataset[_VARIABLE]
    if array.dims[0] != "time" or array.ndim != 3 or array.sizes["time"] < 2:
        raise ValueError("its levels are not of several hours on a grid; give S-104 of format 2")
    if (units := array.attrs["units"].lower()) not in {"m", "metre", "metres", "meter", "meters"}:
        raise ValueError(f"its levels are in {units!r}, not in metres; give S-104 in metres")
    if dataset.attrs.get("verticalDatum") not in DATUMS:
        stated = dataset.attrs.get("verticalDatum", "none")
        raise ValueError(
            f"its datum is {stated}, none of a chart; give S-104 over one of "
            f"{', '.join(DATUMS.values())}"
        )


def _zones(tile: dict[Path, Dataset]) -> Iterator[LevelZone]:
    """Yield the zones of forecasts on one grid, of which the later ones win."""
    datasets = list(tile.values())
    steps, index = merge_steps(
        [read_steps(*time_axis(dataset, "time"), by="point") for dataset in datasets],
        [reference_time(dataset) for dataset in datasets],
    )
    instants = np.array([moment.timestamp() for moment in steps.moments])
    if (gaps := np.diff(instants)).max() > _HOLE * np.median(gaps):
        raise ValueError(
            f"no levels for {gaps.max() / 3600:g} hours from "
            f"{steps.labels[int(gaps.argmax())]} on; give the forecast of these hours too, or "
            "leave out what comes before or after them"
        )
    with reading():
        each = [dataset[_VARIABLE].values for dataset in datasets]
    levels = np.stack([each[file][at] for file, at in index]).astype(float)
    levels = _beside_water(levels)
    known = np.isfinite(levels).all(axis=0)
    corners = _corners(datasets[0])[known]
    series = levels[:, known].T
    first = datasets[0].attrs["verticalDatum"]
    for members in _alike(series):
        cells = shapely.union_all(shapely.polygons(corners[members]))
        yield LevelZone(
            source=_name(tile),
            datum=DATUMS[first],
            area=shapely.multipolygons(shapely.get_parts(cells)),
            series=(instants, series[members].min(axis=0)),
        )


def _beside_water(levels: FloatArray) -> FloatArray:
    """Fill gaps of levels (nt, ny, nx): at dry hours, and at the nodes beside the water."""
    from scipy import ndimage

    known = np.isfinite(levels)
    # A node that falls dry has its lowest level then.
    least = np.where(known, levels, np.inf).min(axis=0)
    levels = np.where(known, levels, least)
    for _ in range(_RINGS):
        around = ndimage.minimum_filter(levels, size=(1, 3, 3), mode="nearest")
        levels = np.where(np.isfinite(levels), levels, around)
    return np.where(np.isfinite(levels), levels, np.nan)


def _corners(dataset: Dataset) -> FloatArray:
    """Return the corners (ny, nx, 4, 2), degrees, of the cells around nodes."""
    lon, lat = dataset["lon"].values, dataset["lat"].values
    x, y = np.meshgrid(lon, lat) if lon.ndim == 1 else (lon, lat)
    nodes = np.stack([x, y], axis=-1)
    wide = np.pad(nodes, ((1, 1), (1, 1), (0, 0)), mode="reflect", reflect_type="odd")
    middles = (wide[:-1, :-1] + wide[1:, :-1] + wide[:-1, 1:] + wide[1:, 1:]) / 4
    around = (middles[:-1, :-1], middles[:-1, 1:], middles[1:, 1:], middles[1:, :-1])
    return np.stack(around, axis=2)


def _alike(series: FloatArray) -> Iterator[IndexArray]:
    """Divide series (n, nt) into groups that stay close to their first at all times."""
    left: BoolArray = np.ones(len(series), dtype=bool)
    # From the lowest to the highest water, so that neighbours in level are tried together.
    for first in np.argsort(series.mean(axis=1), kind="stable"):
        if left[first]:
            members = np.flatnonzero(left)
            members = members[np.abs(series[members] - series[first]).max(axis=1) <= _ALIKE_M]
            left[members] = False
            yield members
