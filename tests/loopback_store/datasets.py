"""Datasets of the loopback store, their catalogue pages (STAC) and their chunks (zarr v2).

The layout is that of the service: `<product>/<dataset>_<version>/dataset.stac.json` with an asset
for each chunking, and zarr arrays over time, elevation (negative, ascending), latitude and
longitude. Nothing is stored: a chunk is computed when it is requested, of an ocean whose currents
are given by a formula, with gaps on its islands.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt
import shapely
from numcodecs import Blosc
from shapely.geometry import Polygon

from pipeline._types import FloatArray

ROOT = "http://mds.invalid"
_EPOCH = datetime(1950, 1, 1, tzinfo=UTC)
CODEC = Blosc(cname="lz4", clevel=5, shuffle=Blosc.SHUFFLE)
_FILL = float(np.float32(9.96921e36))
# Packing of GLORYS12's currents; other datasets are in float32.
_SCALE, _PACKED_FILL = 0.0006103701889514923, -32767
# Chunk sizes along time, elevation, latitude, longitude: small, so that a region needs several, but
# fewer than fifty, from which on the client makes a task for each chunk of the globe.
_CHUNK_SIZES = {"timeChunked": (1, 1, 32, 32), "geoChunked": (64, 1, 32, 32)}
_CHUNK = re.compile(r"(?P<name>\w+)/(?P<index>\d+(\.\d+)*)")
_STANDARD_NAMES = {
    "uo": "eastward_sea_water_velocity",
    "vo": "northward_sea_water_velocity",
    "utide": "surface_sea_water_x_velocity_due_to_tide",
    "vtide": "surface_sea_water_y_velocity_due_to_tide",
    "vsdx": "sea_surface_wave_stokes_drift_x_velocity",
    "vsdy": "sea_surface_wave_stokes_drift_y_velocity",
    "utotal": "surface_sea_water_x_velocity",
    "vtotal": "surface_sea_water_y_velocity",
}


@dataclass(frozen=True)
class Dataset:
    """A dataset: its name and release, its axes (degrees, metres down, UTC) and its variables.

    `times` are those in the service's catalogue, `stored_times` those of the data if they differ.
    """

    name: str
    product: str
    version: str
    times: tuple[datetime, ...]
    cell_deg: float
    variables: tuple[str, ...] = ("uo", "vo")
    depths: tuple[float, ...] = (0.49402499198913574, 1.5413750410079956, 92.32607269287110)
    north: float = 90.0
    packed: bool = False
    updating_from: str = ""
    stored_times: tuple[datetime, ...] | None = None

    @cached_property
    def axes(self) -> dict[str, FloatArray]:
        """Values of the four axes; a grid with nodes at the poles starts at 80 S."""
        cells = round(360 / self.cell_deg)
        # A grid of 1/12 degree has a node at 180 W; one of 1/4 degree has a cell's edge there.
        offset = 0.0 if self.cell_deg < 0.2 else self.cell_deg / 2
        south = -80.0 if offset == 0 else -90 + offset
        rows = round((self.north - offset - south) / self.cell_deg) + 1
        return {
            "time": np.array([(time - _EPOCH) / timedelta(hours=1) for time in self._data_times]),
            "elevation": -np.array(self.depths[::-1]),
            "latitude": south + self.cell_deg * np.arange(rows),
            "longitude": -180 + offset + self.cell_deg * np.arange(cells),
        }

    @property
    def folder(self) -> str:
        """Name of its folder below the product's: with the version."""
        return f"{self.name}_{self.version}"

    @property
    def _data_times(self) -> tuple[datetime, ...]:
        """The times of the data."""
        return self.times if self.stored_times is None else self.stored_times

    def stac_item(self) -> dict[str, object]:
        """Return the dataset's catalogue page."""
        return {
            "type": "Feature",
            "stac_version": "1.0.0",
            "id": self.folder,
            "collection": self.product,
            "geometry": None,
            "bbox": [-180, -90, 180, 90],
            "links": [],
            "properties": {
                "title": self.name,
                "datetime": "2020-01-01T00:00:00Z",
                "cube:dimensions": {name: {"axis": _AXES[name]} for name in _AXES},
                "cube:variables": {
                    name: {
                        "id": name,
                        "dimensions": list(_AXES),
                        "standardName": _STANDARD_NAMES[name],
                        "unit": "m s-1",
                    }
                    for name in self.variables
                },
                **({"admp_updating_start_date": self.updating_from} if self.updating_from else {}),
            },
            "assets": {chunking: self._asset(chunking) for chunking in _CHUNK_SIZES},
        }

    def _asset(self, chunking: str) -> dict[str, object]:
        """The asset of a chunking, with the axes as the client reads them."""
        return {
            "href": f"{ROOT}/arco/{self.product}/{self.folder}/{chunking}.zarr",
            "type": "application/vnd+zarr",
            "viewDims": {
                name: {
                    "units": _UNITS[name],
                    "chunkLen": _CHUNK_SIZES[chunking][index],
                    "coords": self._coords(name),
                }
                for index, name in enumerate(_AXES)
            },
        }

    def _coords(self, name: str) -> dict[str, object]:
        """Limits and step of an axis, or its values where the steps differ; times in ms."""
        if name == "time":
            stamps = [int(time.timestamp() * 1000) for time in self.times]
            steps = set(np.diff(stamps).tolist())
            if len(steps) == 1:
                return {"min": stamps[0], "max": stamps[-1], "step": steps.pop()}
            return {"values": stamps}
        values = self.axes[name]
        if name == "elevation":
            return {"values": values.tolist()}
        return {"min": values[0], "max": values[-1], "step": self.cell_deg}

    def file(self, ocean: Ocean, path: str) -> bytes | None:
        """Return a file of its zarr stores, `<chunking>.zarr/...`; None where there is none."""
        chunking, _, key = path.partition(".zarr/")
        if chunking not in _CHUNK_SIZES:
            return None
        entries = self._metadata(chunking)
        if key == ".zmetadata":
            return json.dumps({"metadata": entries, "zarr_consolidated_format": 1}).encode()
        if key in entries:
            return json.dumps(entries[key]).encode()
        found = _CHUNK.fullmatch(key)
        if found is None:
            return None
        index = tuple(int(number) for number in found["index"].split("."))
        if found["name"] in self.axes:
            return bytes(CODEC.encode(self._axis_values(found["name"])))
        return self._chunk(ocean, chunking, found["name"], index)

    def _axis_values(self, name: str) -> npt.NDArray[np.generic]:
        """Values of an axis in the type in which they are stored."""
        return self.axes[name].astype("<f8" if name == "time" else "<f4")

    def _metadata(self, chunking: str) -> dict[str, object]:
        """The metadata files of one store: content by name."""
        entries: dict[str, object] = {".zgroup": {"zarr_format": 2}, ".zattrs": {}}
        for name in _AXES:
            values = self._axis_values(name)
            entries[f"{name}/.zarray"] = _array(values.shape, values.shape, values.dtype.str, None)
            attributes = {"units": _UNITS[name], "standard_name": name}
            if name == "time":
                attributes = {"units": "hours since 1950-01-01", "calendar": "gregorian"}
            entries[f"{name}/.zattrs"] = {"_ARRAY_DIMENSIONS": [name], **attributes}
        shape = tuple(self.axes[name].size for name in _AXES)
        for name in self.variables:
            kind, fill = ("<i2", _PACKED_FILL) if self.packed else ("<f4", _FILL)
            entries[f"{name}/.zarray"] = _array(shape, _CHUNK_SIZES[chunking], kind, fill)
            entries[f"{name}/.zattrs"] = {
                "_ARRAY_DIMENSIONS": list(_AXES),
                "standard_name": _STANDARD_NAMES[name],
                "units": "m s-1",
                **({"scale_factor": _SCALE, "add_offset": 0.0} if self.packed else {}),
            }
        return entries

    def _chunk(
        self, ocean: Ocean, chunking: str, name: str, index: tuple[int, ...]
    ) -> bytes | None:
        """A chunk of a variable, padded beyond the axes' ends; None where it is all land."""
        lengths = dict(zip(_AXES, _CHUNK_SIZES[chunking], strict=True))
        number = dict(zip(_AXES, index, strict=True))
        inside = {
            axis: np.arange(number[axis] * length, (number[axis] + 1) * length)
            for axis, length in lengths.items()
        }
        inside = {axis: cells[cells < self.axes[axis].size] for axis, cells in inside.items()}
        lon, lat = (self.axes[axis][inside[axis]] for axis in ("longitude", "latitude"))
        values = np.full(tuple(lengths.values()), np.nan)
        for row, time in enumerate(inside["time"]):
            field = ocean.value(name, self._data_times[time], lon, lat)
            # Elevations ascend: the last is the surface, and deeper water is slower.
            for level, height in enumerate(inside["elevation"]):
                slower = 0.5 ** (len(self.depths) - 1 - height)
                values[row, level, : lat.size, : lon.size] = field * slower
        # The service stores no chunk without data.
        if not np.isfinite(values).any():
            return None
        if self.packed:
            packed = np.where(np.isfinite(values), np.rint(values / _SCALE), _PACKED_FILL)
            return bytes(CODEC.encode(packed.astype("<i2")))
        return bytes(CODEC.encode(np.where(np.isfinite(values), values, _FILL).astype("<f4")))


_AXES = {"time": "t", "elevation": "z", "latitude": "y", "longitude": "x"}
_UNITS = {
    "time": "milliseconds since 1970-01-01",
    "elevation": "m",
    "latitude": "degrees_north",
    "longitude": "degrees_east",
}


def _array(
    shape: tuple[int, ...], chunks: tuple[int, ...], kind: str, fill: float | None
) -> dict[str, object]:
    """Return the content of a `.zarray`."""
    return {
        "zarr_format": 2,
        "shape": list(shape),
        "chunks": list(chunks),
        "dtype": kind,
        "fill_value": fill,
        "order": "C",
        "filters": None,
        "compressor": CODEC.get_config(),
    }


Step = Literal["month", "day", "6 hours", "hour"]


def step_times(first: datetime, last: datetime, step: Step) -> tuple[datetime, ...]:
    """Return the times of all steps from `first` to `last`, both included."""
    if step == "month":
        months = range((last.year - first.year) * 12 + last.month - first.month + 1)
        count = [first.month - 1 + month for month in months]
        return tuple(
            first.replace(year=first.year + month // 12, month=month % 12 + 1) for month in count
        )
    hours = {"day": 24, "6 hours": 6, "hour": 1}[step]
    steps = math.floor((last - first) / timedelta(hours=hours)) + 1
    return tuple(first + timedelta(hours=hours * step) for step in range(steps))


# Period of the tide M2, h; its strength, m/s.
_M2_HOURS = 12.4206
_TIDE_M_S = 0.35
# Stokes drift under a steady trade wind, m/s east and north.
_STOKES_M_S = (-0.06, -0.03)


@dataclass(frozen=True)
class Ocean:
    """Eddies of about 300 km that drift west, tide, Stokes drift; islands in lon/lat degrees."""

    islands: tuple[Polygon, ...] = ()

    def value(
        self, variable: str, moment: datetime, lon: FloatArray, lat: FloatArray
    ) -> FloatArray:
        """Return a component (ny, nx) in m/s at a moment, on axes in degrees; NaN on islands."""
        x, y = np.meshgrid(lon, lat)
        hours = moment.timestamp() / 3600
        parts = _PARTS[variable]
        value = np.zeros(x.shape)
        for part in parts:
            value += part(x, y, hours)
        value[self.is_land(lon, lat)] = np.nan
        return value

    def is_land(self, lon: FloatArray, lat: FloatArray) -> npt.NDArray[np.bool_]:
        """Which cells have their centre on an island: (ny, nx)."""
        x, y = np.meshgrid((lon + 180) % 360 - 180, lat)
        is_land = np.zeros(x.shape, dtype=bool)
        for island in self.islands:
            west, south, east, north = island.bounds
            near = (x >= west) & (x <= east) & (y >= south) & (y <= north)
            is_land[near] |= shapely.contains_xy(island, x[near], y[near])
        return is_land


def _eddies_u(x: FloatArray, y: FloatArray, hours: float) -> FloatArray:
    """Eastward component of the eddies: of a stream function, so that it does not diverge."""
    phase = np.radians(x) * 60 + hours / 240
    return np.asarray(0.1 + 0.4 * np.sin(phase) * np.cos(np.radians(y) * 60))


def _eddies_v(x: FloatArray, y: FloatArray, hours: float) -> FloatArray:
    """Northward component of the eddies."""
    phase = np.radians(x) * 60 + hours / 240
    return np.asarray(-0.4 * np.cos(phase) * np.sin(np.radians(y) * 60))


def _tide_u(x: FloatArray, y: FloatArray, hours: float) -> FloatArray:
    """Eastward tide."""
    return _TIDE_M_S * np.cos(2 * np.pi * hours / _M2_HOURS + np.radians(x + y))


def _tide_v(x: FloatArray, y: FloatArray, hours: float) -> FloatArray:
    """Northward tide, a quarter of a period later: the current turns along an ellipse."""
    return 0.5 * _TIDE_M_S * np.sin(2 * np.pi * hours / _M2_HOURS + np.radians(x + y))


def _stokes_u(x: FloatArray, y: FloatArray, hours: float) -> FloatArray:
    """Eastward Stokes drift."""
    del y, hours
    return np.full(x.shape, _STOKES_M_S[0])


def _stokes_v(x: FloatArray, y: FloatArray, hours: float) -> FloatArray:
    """Northward Stokes drift."""
    del y, hours
    return np.full(x.shape, _STOKES_M_S[1])


_PARTS = {
    "uo": (_eddies_u,),
    "vo": (_eddies_v,),
    "utide": (_tide_u,),
    "vtide": (_tide_v,),
    "vsdx": (_stokes_u,),
    "vsdy": (_stokes_v,),
    "utotal": (_eddies_u, _tide_u, _stokes_u),
    "vtotal": (_eddies_v, _tide_v, _stokes_v),
}
