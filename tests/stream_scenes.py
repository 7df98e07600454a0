"""Tidal streams from a file of harmonic constants, and their exact sum flown in small steps.

The exact sum is not taken from fields: f cos(V + u) and f sin(V + u) are heights that pyfes
predicts for constants of 1 m, a table every minute, and each part of the constants is brought into
the plane by itself.
"""

import functools
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np
import shapely
import xarray as xr

import renew
from pipeline.geo.projection import Projection
from pipeline.model import Credit, CurrentGrid, Land
from pipeline.scenario.season import Season, StreamConstants
from pipeline.sources.registry import current_source
from pipeline.stages.project import planar_current
from renew._types import FloatArray
from tests.pipeline.synthetic_currents import sea

REGION = shapely.box(-29.6, 40.2, -27.8, 41.3)
"""Open water in the Atlantic, in degrees."""
DEPARTURE = datetime(2026, 9, 10, 6, 20, tzinfo=UTC)
LON, LAT = np.linspace(-30.5, -27.0, 36), np.linspace(39.5, 42.0, 26)
NAMES = ("M2", "S2", "N2", "K1", "O1", "M4", "MS4", "M6", "K2", "MF")
_CREDIT = Credit("A tide", "current", "", "")
# Pieces of a path, and s between heights of a table.
_PIECES, _TABLE_S = 4000, 20.0


def constants(
    strengths: dict[str, float], seed: int = 1, mean_m_s: float = 0.1, weak: float | None = None
) -> xr.Dataset:
    """Return constants whose rms over all nodes is given by name, m/s, and a mean beside them."""
    rng = np.random.default_rng(seed)

    def parts(rms: list[float]) -> tuple[FloatArray, FloatArray]:
        fields = [sea(LON, LAT, int(rng.integers(1 << 30)), 1.0) for _ in rms]
        u, v = (np.stack([r * getattr(one, name) for r, one in zip(rms, fields, strict=True)])
                for name in "uv")  # fmt: skip
        return u, v

    grid, m_s = ("lat", "lon"), {"units": "m s-1"}
    data: dict[str, tuple[tuple[str, ...], FloatArray, dict[str, str]]] = {}
    for part in ("re", "im"):
        for name, values in zip("uv", parts(list(strengths.values())), strict=True):
            data[f"{name}_{part}"] = (("constituent", *grid), values, m_s)
    for name, values in zip("uv", parts([mean_m_s]), strict=True):
        data[f"{name}_mean"] = (grid, values[0], m_s)
    if weak is not None:
        share = np.where(LON[None, :] < weak, 0.5, 0.95) * np.ones((LAT.size, 1))
        data["variance_share"] = (grid, share, {"units": "1"})
    axes = {"constituent": list(strengths), "lat": ("lat", LAT, {"units": "degrees_north"}),
            "lon": ("lon", LON, {"units": "degrees_east"})}  # fmt: skip
    return xr.Dataset(data, axes, {"title": "Constants made up for a test"})


def written(data: xr.Dataset, path: Path) -> Path:
    """Write a dataset; return its path."""
    data.to_netcdf(path, engine="netcdf4")
    return path


def season(path: Path, residual: str | None = None) -> Season:
    """Return a season that departs with the constants of a file, and a residual."""
    return Season(
        name="tide",
        time_method="changing",
        departure=DEPARTURE,
        max_hours=30.0,
        currents=(StreamConstants.model_validate({"constants": str(path), "residual": residual}),),
    )


def fetched(asked: Season) -> CurrentGrid:
    """Read a season's current."""
    source = current_source(asked.currents[0])
    assert source.uncovered_reason(REGION, asked) == ""
    return source.current(REGION, asked, Land((), (), 0.0), Path())


@functools.cache
def plane() -> tuple[Projection, renew.Chart]:
    """Return the projection, and a chart of open water."""
    projection = Projection.for_region(REGION)
    extent = shapely.box(*shapely.bounds(projection.geometry_to_plane(REGION)))
    return projection, renew.Chart(extent, [])


def basis(names: tuple[str, ...], times: FloatArray) -> FloatArray:
    """Return f cos(V + u), then -f sin(V + u), of constituents (2 n, times), by pyfes."""
    found = [
        -renew.Tide({name: renew.Constant(1.0, lag)}, 0.0, DEPARTURE).heights(times)
        for lag in (180.0, 90.0)
        for name in names
    ]
    return np.array(found)


@dataclass(frozen=True)
class StreamScene:
    """A voyage in tidal streams of a file, m/s."""

    path: Path
    speed: float
    drift: Literal["projected", "crab"]
    start: tuple[float, float]
    goal: tuple[float, float]

    def plan(self) -> renew.Plan:
        """Plan in the fields that the source gives."""
        projection, chart = plane()
        current = planar_current(fetched(season(self.path)), projection, chart.bounds)
        start, goal = (projection.to_plane(np.array(one)) for one in (self.start, self.goal))
        vessel = renew.Vessel(speed=self.speed, turn_rate=0.1)
        return renew.plan(
            chart, current, vessel, start, goal, drift=self.drift, padding="none", classes=1
        )

    def arrival(self, path: FloatArray) -> float:
        """Sail a planar path (n, 2) in the exact sum; return the arrival (s) after departure."""
        line = shapely.LineString(path)
        along = np.linspace(0.0, line.length, _PIECES + 1)
        points = shapely.get_coordinates(shapely.line_interpolate_point(line, along))
        ahead = np.diff(points, axis=0)
        lengths = np.linalg.norm(ahead, axis=1)
        velocities, names = self._parts((points[1:] + points[:-1]) / 2)
        table_s = np.arange(0.0, 3 * line.length / self.speed, _TABLE_S)
        shares = np.vstack([basis(names, table_s), np.ones((1, table_s.size))])
        time = 0.0
        for k, length in enumerate(lengths):
            towards = ahead[k] / length
            speed = self._over_ground(towards, velocities[:, k], shares, time)
            middle = time + length / speed / 2
            time += length / self._over_ground(towards, velocities[:, k], shares, middle)
        return time

    def _parts(self, places: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
        """Return the constants' parts and the mean at places: (2 n + 1, places, 2), m/s."""
        projection, chart = plane()
        with xr.open_dataset(self.path) as data:
            names = tuple(map(str, data["constituent"].values))
            u, v = (
                np.concatenate(
                    [data[f"{c}_re"].values, data[f"{c}_im"].values, data[f"{c}_mean"].values[None]]
                )
                for c in "uv"
            )
        found = []
        for east, north in zip(u, v, strict=True):
            grid = CurrentGrid("part", LON, LAT, east[None], north[None], "", _CREDIT)
            found.append(planar_current(grid, projection, chart.bounds)(places))
        return np.array(found), names

    def _over_ground(
        self, towards: FloatArray, parts: FloatArray, shares: FloatArray, time: float
    ) -> float:
        """Return the speed over ground (m/s) along a direction at a time (s)."""
        at, rest = divmod(time / _TABLE_S, 1.0)
        now = (1 - rest) * shares[:, int(at)] + rest * shares[:, int(at) + 1]
        u, v = now @ parts
        along, across = u * towards[0] + v * towards[1], v * towards[0] - u * towards[1]
        water = np.sqrt(self.speed**2 - across**2) if self.drift == "crab" else self.speed
        return float(along + water)


def stream_scene(seed: int, folder: Path) -> StreamScene:
    """Return a scene with three to eight constituents; some streams are as fast as the vessel."""
    rng = np.random.default_rng(seed)
    others = rng.permutation(NAMES[1:])[: rng.integers(2, 8)].tolist()
    strengths = {"M2": rng.uniform(0.3, 0.9)}
    strengths |= {name: strengths["M2"] * rng.uniform(0.05, 0.35) for name in others}
    path = written(constants(strengths, seed), folder / f"{seed}.nc")
    most = np.hypot(*(sum(strengths.values()),) * 2) * 1.6
    return StreamScene(
        path,
        speed=float(rng.uniform(0.5, 1.5) * most),
        drift="crab" if seed % 2 else "projected",
        start=(float(rng.uniform(-29.4, -29.1)), float(rng.uniform(40.4, 41.1))),
        goal=(float(rng.uniform(-28.4, -28.1)), float(rng.uniform(40.4, 41.1))),
    )
