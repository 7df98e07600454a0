"""One analytic current in the forms in which models and services publish theirs.

The current is that of a stream function of vortices, without divergence, and the same at all times.
Each form is written with its own points: on axes, with index dimensions, with 2-D coordinates, on a
turned and curved grid, staggered, on triangles, and as S-111.
"""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr
from scipy.spatial import Delaunay

from pipeline._types import ArrayLike, FloatArray

WEST, SOUTH, EAST, NORTH = 131.0, 15.9, 135.0, 19.1
"""Bounds within which each form has data, degrees: open water."""
VORTEX_DEG = 0.5
"""Width of a vortex, degrees of latitude."""
SPEED_M_S = 0.5
ONE = {"units": "m s-1"}
TIMES = ("2024-03-15T00:00", "2024-03-15T06:00", "2024-03-15T12:00")
_LONGER = 1.4
_MIDDLE = (133.0, 17.5)
_SHRINK = np.cos(np.radians(_MIDDLE[1]))


def velocity(lon: ArrayLike, lat: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the current's components east and north, m/s."""
    k = np.pi / VORTEX_DEG
    # Vortices are longer than wide: squares would remain free of divergence if u and v changed
    # places.
    x = k / _LONGER * (np.asarray(lon) - _MIDDLE[0]) * _SHRINK + 0.4
    y = k * (np.asarray(lat) - _MIDDLE[1]) + 0.3
    u = -SPEED_M_S * np.sin(x) * np.cos(y)
    v = SPEED_M_S / _LONGER * np.cos(x) * np.sin(y)
    return u, v


def _series(values: FloatArray) -> FloatArray:
    """Return values at all times."""
    return np.broadcast_to(values, (len(TIMES), *values.shape))


def _with_time(data: xr.Dataset) -> xr.Dataset:
    """Give a dataset its times."""
    return data.assign_coords(time=("time", np.array(TIMES, "datetime64[ns]")))


def _named(kind: str, **about: str) -> tuple[dict[str, str], dict[str, str]]:
    """Return the attributes of both components: "eastward" or "x"."""
    names = {"eastward": ("eastward", "northward"), "x": ("sea_water_x", "sea_water_y")}[kind]
    ends = "_sea_water_velocity" if kind == "eastward" else "_velocity"
    first, second = ({**ONE, "standard_name": name + ends, **about} for name in names)
    return first, second


def axes(step: float) -> tuple[FloatArray, FloatArray]:
    """Return the axes of a regular grid."""
    return np.arange(WEST, EAST, step / _SHRINK), np.arange(SOUTH, NORTH, step)


def regular(step: float) -> xr.Dataset:
    """Return the current on axes."""
    lon, lat = axes(step)
    parts = velocity(*np.meshgrid(lon, lat))
    dims = ("time", "lat", "lon")
    return _with_time(
        xr.Dataset(
            {
                name: (dims, _series(part), about)
                for name, part, about in zip(("uo", "vo"), parts, _named("eastward"), strict=True)
            },
            {
                "lon": ("lon", lon, {"units": "degrees_east"}),
                "lat": ("lat", lat, {"units": "degrees_north"}),
            },
        )
    )


def index_dims(step: float) -> xr.Dataset:
    """Return the current with axes beside index dimensions."""
    data = regular(step)
    named = {
        "lon": ("x", data.lon.values, data.lon.attrs),
        "lat": ("y", data.lat.values, data.lat.attrs),
    }
    return data.drop_vars(["lon", "lat"]).rename_dims(lon="x", lat="y").assign_coords(named)


def two_dimensional(step: float) -> xr.Dataset:
    """Return the current of a regular grid with 2-D longitudes and latitudes."""
    data = index_dims(step)
    lon, lat = np.meshgrid(data.lon, data.lat)
    return data.drop_vars(["lon", "lat"]).assign_coords(
        lon=(("y", "x"), lon, {"units": "degrees_east"}),
        lat=(("y", "x"), lat, {"units": "degrees_north"}),
    )


def lines(step: float, shift: tuple[float, float] = (0.0, 0.0)) -> tuple[FloatArray, ...]:
    """Return lon, lat and the angle (radians) from east of the lines along the second dimension.

    The grid is turned by some 40 degrees, and its lines are curved. `shift` is in cells along the
    first and the second dimension, as the points of a staggered grid have.
    """
    reach = 2.4
    along = np.arange(-reach, reach, step)
    j, i = np.meshgrid(along + shift[0] * step, along + shift[1] * step, indexing="ij")
    turned, bend = np.radians(40.0), 0.04
    x = i * np.cos(turned) - j * np.sin(turned) + bend * j**2
    y = i * np.sin(turned) + j * np.cos(turned) + bend * i**2
    lat = _MIDDLE[1] + y
    lon = _MIDDLE[0] + x / np.cos(np.radians(lat))
    # By the chain rule: d(lon) cos(lat) = dx + x tan(lat) d(lat).
    dx, dy = np.cos(turned), np.sin(turned) + 2 * bend * i
    angle = np.arctan2(dy, dx + x * np.tan(np.radians(lat)) * np.radians(1.0) * dy)
    return lon, lat, angle


def _along(lon: FloatArray, lat: FloatArray, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the components along lines and across."""
    u, v = velocity(lon, lat)
    return u * np.cos(angle) + v * np.sin(angle), v * np.cos(angle) - u * np.sin(angle)


def curved(step: float) -> xr.Dataset:
    """Return the current on curved lines, along and across them, as NEMO names it."""
    lon, lat, angle = lines(step)
    parts = _along(lon, lat, angle)
    return _with_time(
        xr.Dataset(
            {
                name: (("time", "y", "x"), _series(part), about)
                for name, part, about in zip(
                    ("vozocrtx", "vomecrty"), parts, _named("x"), strict=True
                )
            },
            {"nav_lon": (("y", "x"), lon), "nav_lat": (("y", "x"), lat)},
        )
    )


def staggered(step: float) -> xr.Dataset:
    """Return the current on the faces of curved cells, as ROMS writes it: u and v without names."""
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {}
    lon, lat, angle = lines(step)
    coordinates |= {
        "lon_rho": (("eta_rho", "xi_rho"), lon),
        "lat_rho": (("eta_rho", "xi_rho"), lat),
    }
    about = {"units": "radians", "long_name": "angle between XI-axis and EAST"}
    variables["angle"] = (("eta_rho", "xi_rho"), angle, about)
    for at, (name, shift) in enumerate((("u", (0.0, 0.5)), ("v", (0.5, 0.0)))):
        dims = (f"eta_{name}", f"xi_{name}")
        lon, lat, angle = (
            part[: -1 if at else None, : None if at else -1] for part in lines(step, shift)
        )
        coordinates |= {f"lon_{name}": (dims, lon), f"lat_{name}": (dims, lat)}
        part = _along(lon, lat, angle)[at]
        said = {"units": "meter second-1", "long_name": f"{name}-momentum component"}
        variables[name] = (("time", *dims), _series(part), said)
    return _with_time(xr.Dataset(variables, coordinates))


@cache
def _triangles(step: float) -> tuple[FloatArray, FloatArray, Any]:
    """Return nodes in no order, and the triangles between them."""
    rng = np.random.default_rng(1)
    lon, lat = np.meshgrid(*axes(step))
    # Rows are half a step apart, as in triangles of equal sides, and a little disordered.
    lon[1::2] += step / 2
    lon, lat = (side + rng.uniform(-0.15, 0.15, side.shape) * step for side in (lon, lat))
    nodes = np.stack([lon.ravel(), lat.ravel()], axis=-1)
    return nodes[:, 0], nodes[:, 1], Delaunay(nodes).simplices


def on_nodes(step: float) -> xr.Dataset:
    """Return the current on the nodes of triangles, by the UGRID conventions."""
    lon, lat, corners = _triangles(step)
    topology = {
        "cf_role": "mesh_topology",
        "topology_dimension": 2,
        "node_coordinates": "node_x node_y",
        "face_node_connectivity": "face_nodes",
    }
    about = _named("x", mesh="mesh", location="node")
    parts = zip(("ucx", "ucy"), velocity(lon, lat), about, strict=True)
    return _with_time(
        xr.Dataset(
            {
                **{name: (("time", "nodes"), _series(part), said) for name, part, said in parts},
                "mesh": ((), 0, topology),
                "face_nodes": (("faces", "three"), corners + 1, {"start_index": 1}),
                "node_x": ("nodes", lon, {"standard_name": "longitude"}),
                "node_y": ("nodes", lat, {"standard_name": "latitude"}),
            }
        )
    )


def on_cells(step: float) -> xr.Dataset:
    """Return the current at the middles of triangles, as FVCOM writes it."""
    lon, lat, corners = _triangles(step)
    middle_lon, middle_lat = lon[corners].mean(axis=1), lat[corners].mean(axis=1)
    said = (
        {"units": "meters s-1", "standard_name": "eastward_sea_water_velocity"},
        {"units": "meters s-1", "standard_name": "Northward_sea_water_velocity"},
    )
    parts = zip("uv", velocity(middle_lon, middle_lat), said, strict=True)
    return _with_time(
        xr.Dataset(
            {
                **{
                    name: (
                        ("time", "siglay", "nele"),
                        np.stack([_series(part), 0.2 * _series(part)], 1),
                        about,
                    )
                    for name, part, about in parts
                },
                "nv": (("three", "nele"), corners.T + 1),
                "shares": (
                    ("siglay", "node"),
                    np.repeat([[-0.1], [-0.9]], lon.size, axis=1),
                    {"standard_name": "ocean_sigma_coordinate", "positive": "up"},
                ),
                "lon": ("node", lon, {"units": "degrees_east"}),
                "lat": ("node", lat, {"units": "degrees_north"}),
                "lonc": ("nele", middle_lon),
                "latc": ("nele", middle_lat),
            }
        )
    )


def write_s111(
    path: Path,
    step: float,
    coding: int = 2,
    edition: str = "1.0",
    tile: tuple[float, float] = (-90.0, 90.0),
    **about: object,
) -> Path:
    """Write the current as S-111: speed in knots, and direction to which it runs.

    A `tile` has the latitudes from the first to before the second; `about` are attributes.

    The structure is that of NOAA's files of edition 1.0 (format 2); that of other editions, and of
    format 3, is from the text of the standard.
    """
    lon, lat = (axis.astype("f4" if edition == "1.0" else "f8") for axis in axes(step))
    lat = lat[(lat >= tile[0]) & (lat < tile[1])]
    x, y = np.meshgrid(
        lon[0] + (lon[1] - lon[0]) * np.arange(lon.size),
        lat[0] + (lat[1] - lat[0]) * np.arange(lat.size),
    )
    shape = x.shape
    if coding == 3:
        x, y, _ = _triangles(step)
        x, y = (side.astype("f4") for side in (x, y))
        shape = x.shape
    u, v = velocity(x, y)
    values = np.zeros(shape, [("surfaceCurrentSpeed", "<f4"), ("surfaceCurrentDirection", "<f4")])
    values["surfaceCurrentSpeed"] = np.hypot(u, v) * 3600 / 1852
    values["surfaceCurrentDirection"] = np.degrees(np.arctan2(u, v)) % 360
    text: Any = h5py.string_dtype() if edition == "2.0" else "S50"
    fields = ("code", "name", "uom.name", "fillValue", "datatype", "lower", "upper", "closure")
    knots, degrees, fill = (
        ("knot", "degree", "-9999.00") if edition == "2.0" else ("knots", "arc-degrees", "-9999.0")
    )
    rows = [
        ("surfaceCurrentSpeed", "Surface current speed", knots, fill, "H5T_FLOAT", "0", "", ""),
        ("surfaceCurrentDirection", "Direction", degrees, fill, "H5T_FLOAT", "0", "360", ""),
    ]
    with h5py.File(path, "w") as file:
        file.attrs["productSpecification"] = f"INT.IHO.S-111.{edition}"
        file.attrs["issueDate"] = "20240315" if edition == "2.0" else "2024-03-15"
        file.attrs["issueTime"] = "010000Z" if edition == "2.0" else "01:00:00.5"
        file.attrs.update(about)
        key = "horizontalCRS" if edition == "2.0" else "horizontalDatumValue"
        file.attrs[key] = np.int32(4326)
        described = np.array(rows, dtype=[(name, text) for name in fields])
        file.create_dataset("Group_F/SurfaceCurrent", data=described)
        feature = file.create_group("SurfaceCurrent")
        feature.attrs["dataCodingFormat"] = np.uint8(coding)
        instance = feature.create_group("SurfaceCurrent.01")
        if coding == 3:
            positions = np.zeros(shape, [("longitude", "<f4"), ("latitude", "<f4")])
            positions["longitude"], positions["latitude"] = x, y
            instance.create_dataset("Positioning/geometryValues", data=positions)
        else:
            instance.attrs["startSequence"] = "0,0"
            for name, axis in (("Latitud", lat), ("Longitud", lon)):
                instance.attrs[f"gridOrigin{name}e"] = axis[0]
                instance.attrs[f"gridSpacing{name}inal"] = axis[1] - axis[0]
                instance.attrs[f"numPoints{name}inal"] = axis.size
        for number, moment in enumerate(TIMES, 1):
            group = instance.create_group(f"Group_{number:03}")
            group.attrs["timePoint"] = moment.replace("-", "").replace(":", "") + "00Z"
            group.create_dataset("values", data=values)
    return path


FORMS: dict[str, Callable[[float], xr.Dataset]] = {
    "regular": regular,
    "index dimensions": index_dims,
    "2-D of regular": two_dimensional,
    "turned and curved": curved,
    "staggered": staggered,
    "triangles, on nodes": on_nodes,
    "triangles, on cells": on_cells,
}
