"""Currents of a small table that travels with the catalogue, for who has no account anywhere."""

from __future__ import annotations

import csv
import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pipeline.errors import StageError
from pipeline.model import Credit, CurrentGrid
from pipeline.scenario import catalogue
from pipeline.scenario.messages import near_miss

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt
    from shapely.geometry import Polygon

    from pipeline.model import Land
    from pipeline.scenario.catalogue import EmbeddedTableSpec
    from pipeline.scenario.model import Season

    FloatArray = npt.NDArray[np.float64]

# Coordinates of the table have four decimals: a step may be off by two roundings.
_STEP_TOLERANCE_DEG = 2e-4


@dataclass(frozen=True)
class EmbeddedTable:
    """A CSV table (season, lon, lat, u, v) whose points lie on one regular grid a season.

    Missing points are NaN: land, or water that the table has no figure for.
    """

    spec: EmbeddedTableSpec

    def asks_network(self, region: Polygon, season: Season, folder: Path) -> bool:
        """Never."""
        del region, season, folder
        return False

    @cached_property
    def _bytes(self) -> bytes:
        """The table as it stands on disk."""
        return catalogue.table(self.spec.table).read_bytes()

    def identity(self, season: Season) -> tuple[str, ...]:
        """Hash of the table, and the season in it."""
        digest = hashlib.sha256(self._bytes).hexdigest()
        return (self.spec.name, digest, season.name, self.spec.model_dump_json())

    def unavailable(self) -> str:
        """Nothing stands in its way."""
        return ""

    def uncovered(self, region: Polygon, season: Season) -> str:
        """Say how far the region reaches beyond the table's cells."""
        if season.name not in self.spec.seasons:
            return (
                f"{self.spec.name} has no season {season.name!r}: "
                f"{near_miss(season.name, self.spec.seasons)}"
            )
        lon, lat, _, _ = self._grid(season.name)
        west, south, east, north = cell_bounds(lon, lat)
        bounds = region.bounds
        lacking = [
            f"{side} of {limit:g} (the region reaches {value:g})"
            for side, limit, value, is_beyond in (
                ("west", west, bounds[0], bounds[0] < west),
                ("south", south, bounds[1], bounds[1] < south),
                ("east", east, bounds[2], bounds[2] > east),
                ("north", north, bounds[3], bounds[3] > north),
            )
            if is_beyond
        ]
        if not lacking:
            return ""
        return (
            f"{self.spec.name} has no figures {' nor '.join(lacking)}; shrink the region or name "
            "another source in 'currents'"
        )

    def current(self, region: Polygon, season: Season, land: Land, folder: Path) -> CurrentGrid:
        """Return the season's whole grid: it is small, and its surroundings do no harm."""
        del region, land, folder
        entry = self.spec.seasons[season.name]
        lon, lat, u, v = self._grid(season.name)
        credit = Credit(
            name=self.spec.title,
            kind="current",
            text=entry.credit,
            licence=entry.licence,
            url=entry.url,
        )
        return CurrentGrid(season.name, lon, lat, u, v, entry.valid, credit)

    def _grid(self, season: str) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Axes lon (nx,) and lat (ny,), and u, v (ny, nx) with NaN where the table is silent."""
        points = self._points(season)
        name = self.spec.table
        if not len(points):
            raise StageError(f"{name} has no rows for season {season!r}; mend the table")
        lon, column = _axis(points[:, 0], f"{name}, {season}, lon")
        lat, row = _axis(points[:, 1], f"{name}, {season}, lat")
        u = np.full((lat.size, lon.size), np.nan)
        v = u.copy()
        u[row, column], v[row, column] = points[:, 2], points[:, 3]
        if np.count_nonzero(np.isfinite(u)) != len(points):
            raise StageError(f"{name}, {season}: a point comes twice; mend the table")
        return lon, lat, u, v

    def _points(self, season: str) -> FloatArray:
        """Rows (n, 4) of lon, lat, u, v."""
        lines = self._bytes.decode("utf-8").splitlines()
        rows = csv.DictReader(line for line in lines if not line.startswith("#"))
        found = [
            [float(row[key]) for key in ("lon", "lat", "u", "v")]
            for row in rows
            if row["season"] == season
        ]
        return np.array(found, dtype=float).reshape(-1, 4)


def cell_bounds(lon: FloatArray, lat: FloatArray) -> tuple[float, float, float, float]:
    """West, south, east and north edge of a regular grid's outer cells: half a cell beyond."""
    half_x, half_y = (lon[1] - lon[0]) / 2, (lat[1] - lat[0]) / 2
    return (
        float(lon[0] - half_x),
        float(lat[0] - half_y),
        float(lon[-1] + half_x),
        float(lat[-1] + half_y),
    )


def _axis(values: FloatArray, what: str) -> tuple[FloatArray, npt.NDArray[np.intp]]:
    """Regular axis through all values, and each value's place on it."""
    distinct = np.unique(values)
    if distinct.size < 2:
        raise StageError(f"{what}: only one value, no grid; mend the table")
    # Lines without a single figure leave wider gaps: the least gap is the step.
    step = float(np.diff(distinct).min())
    steps = np.rint((distinct - distinct[0]) / step).astype(np.intp)
    # The mean step, as four decimals a value would add up over a long axis.
    step = float((distinct[-1] - distinct[0]) / steps[-1])
    axis = distinct[0] + step * np.arange(steps[-1] + 1)
    place = np.rint((values - distinct[0]) / step).astype(np.intp)
    if np.abs(axis[place] - values).max() > _STEP_TOLERANCE_DEG:
        raise StageError(f"{what}: the values lie on no regular grid; mend the table")
    return axis, place
