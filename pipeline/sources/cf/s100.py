"""Official water on grids, HDF5 by the IHO's S-100: S-111 currents, S-104 levels, S-102 depths.

They become datasets by the CF conventions. Units and fill values are those that the file's own
`Group_F` states, as text. Sources are S-100 part 10c (editions 4 and 5), S-111 1.0 to 2.0, S-104
2.0 and S-102 3.0. GDAL's drivers read one time at a time, and no irregular points; NOAA's s100py
writes such files, and needs GDAL's Python bindings, which have no wheels.
"""

import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from pipeline._types import Dataset, FloatArray, IndexArray

Group: TypeAlias = Any  # of h5py, which has no types
_HDF5 = b"\x89HDF"
# Attributes by the CF conventions of what features hold, by its code.
_VARIABLES: Mapping[str, Mapping[str, str]] = {
    "surfaceCurrentSpeed": {"standard_name": "sea_water_speed"},
    "surfaceCurrentDirection": {"standard_name": "sea_water_velocity_to_direction"},
    "waterLevelHeight": {"standard_name": "water_surface_height_above_reference_datum"},
    "depth": {"standard_name": "sea_floor_depth_below_geoid", "positive": "down"},
}
_FEATURES = ("SurfaceCurrent", "WaterLevel", "BathymetryCoverage")
# Coding formats that are read: a regular grid, and points in any order.
_REGULAR = 2
_POINTS = 3
_FORMATS = {1: "fixed stations", 4: "a moving platform", 8: "fixed stations"}
# Where the first value of a regular grid is, and how the values run: to the east first.
_SCAN = ("longitude,latitude", "easting,northing", "x,y")
# Type of a depth that is counted from the sea's surface.
_BELOW_SURFACE = 2
# Largest number of values of a file: 1 GB.
_MAX_VALUES = 1 << 27
# Triangles with an edge of this multiple of the median edge join points across land.
_LONGEST_EDGE = 2.5
_NORTH = {"units": "degrees_north"}
_EAST = {"units": "degrees_east"}
# EPSG's code of degrees, WGS 84.
_DEGREES = 4326
# Attributes of a dataset: what S-100 it is from, and its time of issue.
_KIND = "productSpecification"
_ISSUED = "reference_time"
_SINCE = {"units": "seconds since 1970-01-01 00:00:00", "calendar": "standard"}


class UnusableError(ValueError):
    """A file that can be read, and holds nothing that is of use here."""


def is_s100(path: Path) -> bool:
    """Whether a file is HDF5 that describes its features as S-100 does."""
    import h5py

    with path.open("rb") as file:
        if file.read(4) != _HDF5:
            return False
    with h5py.File(path) as opened:
        return "Group_F" in opened


def as_dataset(path: Path) -> Dataset:
    """Read a file as a dataset.

    Raises UnusableError if it has something else, or of a kind that makes no field; OSError,
    KeyError if it is damaged.
    """
    import h5py
    import xarray as xr

    with h5py.File(path) as file:
        feature = next((name for name in _FEATURES if name in file), "")
        if not feature:
            raise UnusableError(
                f"it is S-100 without {', '.join(_FEATURES)}; give a file that has one"
            )
        coding = int(file[feature].attrs["dataCodingFormat"])
        if coding not in {_REGULAR, _POINTS}:
            kind = _FORMATS.get(coding, f"coding format {coding}")
            raise UnusableError(
                f"its {feature} is of {kind}, not on a grid; give a file of coding format 2 or 3"
            )
        instances = [own for name, own in file[feature].items() if name.startswith(f"{feature}.")]
        if len(instances) != 1:
            raise UnusableError(f"it has {len(instances)} grids of {feature}; give a file with one")
        variables = _variables(file, feature, instances[0], coding)
        dims, coordinates = _places(file, instances[0], coding)
        about = {**file.attrs, **file[feature].attrs}
        named = {code: (dims, *own) for code, own in variables.items()}
        return xr.Dataset(
            named | coordinates[1],
            {**coordinates[0], **_moments(instances[0]), **_depth(about)},
            _credit(about),
        )


def is_from_s100(dataset: Dataset) -> bool:
    """Whether `as_dataset` made a dataset."""
    return _KIND in dataset.attrs


def option_of(dataset: Dataset) -> str:
    """Say where an S-100 dataset is to be given; "" for others."""
    options = {"surfaceCurrentSpeed": "currents", "waterLevelHeight": "tide", "depth": "depths"}
    option = next((own for name, own in options.items() if name in dataset.data_vars), "")
    return f"; it is for --{option}" if option and is_from_s100(dataset) else ""


def joined(tiles: Sequence[Dataset]) -> Dataset:
    """Return tiles of the same times as one mesh of all their points.

    Each tile has a lattice of its own: the number of its columns depends on the latitude.
    """
    import xarray as xr

    flat = []
    for tile in tiles:
        x, y = tile["lon"], tile["lat"]
        if x.dims != y.dims:
            y, x = xr.broadcast(y, x)
        placed = tile.drop_vars(("lon", "lat", "corners"), errors="ignore")
        placed = placed.assign(lon=x.variable, lat=y.variable)
        if x.ndim > 1:
            placed = placed.stack(node=x.dims, create_index=False)
        flat.append(placed)
    whole = xr.concat(flat, "node", data_vars="minimal", coords="minimal", compat="override")
    corners, about = _mesh_of(whole["lon"].values, whole["lat"].values)
    whole = whole.assign(corners=(("cell", "corner"), corners, about)).set_coords(("lon", "lat"))
    issued = [tile.attrs[_ISSUED] for tile in tiles if _ISSUED in tile.attrs]
    return whole.assign_attrs({_ISSUED: max(issued)} if issued else {})


def _text(value: Any) -> str:  # noqa: ANN401 - bytes or str, as h5py gives either
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _groups(instance: Group) -> list[Group]:
    """Return the groups of an instance with the values, one for each time."""
    return [instance[name] for name in sorted(instance) if name.startswith("Group_")]


def _variables(
    file: Group, feature: str, instance: Group, coding: int
) -> dict[str, tuple[FloatArray, dict[str, str]]]:
    """Return the values (time, ...) of each known code, as they are stored, with attributes."""
    stated = {_text(row["code"]): row for row in file["Group_F"][feature][:]}
    groups = _groups(instance)
    size = sum(group["values"].size for group in groups)
    if not size or size > _MAX_VALUES:
        raise UnusableError(f"it has {size:,} values; there must be 1 to {_MAX_VALUES:,}")
    read = np.stack([group["values"][:] for group in groups])
    if coding == _REGULAR:
        scan = _text(file[feature].attrs.get("sequencingRule.scanDirection", _SCAN[0]))
        start = _text(instance.attrs.get("startSequence", "0,0"))
        if scan.lower().replace(" ", "") not in _SCAN or start.replace(" ", "") != "0,0":
            raise UnusableError(
                f"its values run along {scan} from {start}; only longitude first is read"
            )
    found: dict[str, tuple[FloatArray, dict[str, str]]] = {}
    for code, attributes in _VARIABLES.items():
        if code not in (read.dtype.names or ()) or code not in stated:
            continue
        values = np.asarray(read[code])
        fill = values.dtype.type(float(_text(stated[code]["fillValue"])))
        unit = _text(stated[code]["uom.name"])
        about = {"units": unit, "cell_methods": "time: point", **attributes}
        found[code] = (np.where(values == fill, values.dtype.type(np.nan), values), about)
    if not found:
        raise UnusableError(f"its {feature} has none of {', '.join(_VARIABLES)}")
    return found


def _places(
    file: Group, instance: Group, coding: int
) -> tuple[tuple[str, ...], tuple[dict[str, Any], dict[str, Any]]]:
    """Return the dimensions of values, and the coordinates and corners of cells for them."""
    attributes = instance.attrs
    if coding == _POINTS:
        points = instance["Positioning/geometryValues"][:]
        lon, lat = (np.asarray(points[name], float) for name in ("longitude", "latitude"))
        nodes = {"lat": ("node", lat, _NORTH), "lon": ("node", lon, _EAST)}
        return ("time", "node"), (nodes, {"corners": (("cell", "corner"), *_mesh_of(lon, lat))})
    axes: list[FloatArray] = [
        float(attributes[f"gridOrigin{axis}itude"])
        + float(attributes[f"gridSpacing{axis}itudinal"])
        * np.arange(float(attributes[f"numPoints{axis}itudinal"]))
        for axis in ("Lat", "Long")
    ]
    crs = int(file.attrs.get("horizontalCRS", file.attrs.get("horizontalDatumValue", _DEGREES)))
    dims, coordinates = placed(axes[1], axes[0], crs)
    return ("time", *dims), (coordinates, {})


def placed(x: FloatArray, y: FloatArray, crs: Any) -> tuple[tuple[str, ...], dict[str, Any]]:  # noqa: ANN401 - what pyproj takes
    """Return dimensions and coordinates of a grid with axes x (nx,) and y (ny,) in a CRS."""
    from pyproj import CRS, Transformer

    if CRS.from_user_input(crs).equals(CRS.from_epsg(_DEGREES), ignore_axis_order=True):
        return ("lat", "lon"), {"lat": ("lat", y, _NORTH), "lon": ("lon", x, _EAST)}
    turned = Transformer.from_crs(crs, "OGC:CRS84", always_xy=True)
    lon, lat = turned.transform(*np.meshgrid(x, y))
    return ("y", "x"), {"lat": (("y", "x"), lat, _NORTH), "lon": (("y", "x"), lon, _EAST)}


def _mesh_of(lon: FloatArray, lat: FloatArray) -> tuple[IndexArray, dict[str, str]]:
    """Return triangles (m, 3) between points, without those that reach across gaps, as UGRID's."""
    from scipy.spatial import Delaunay

    points = np.stack([lon * np.cos(np.radians(lat.mean())), lat], axis=-1)
    triangles = Delaunay(points).simplices.astype(np.intp)
    corners = points[triangles]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(axis=1)
    about = {"cf_role": "face_node_connectivity", "start_index": "0"}
    return np.asarray(triangles[edges <= _LONGEST_EDGE * np.median(edges)]), about


def _moments(instance: Group) -> dict[str, Any]:
    """Return the coordinate of the times of the groups, seconds since 1970."""
    stamps = [re.sub(r"\D", "", _text(group.attrs["timePoint"])) for group in _groups(instance)]
    if min(map(len, stamps)) < 14:
        return {}
    seconds = [datetime.strptime(f"{s[:14]}+0000", "%Y%m%d%H%M%S%z").timestamp() for s in stamps]
    return {"time": ("time", np.array(seconds), {"standard_name": "time", **_SINCE})}


def _depth(about: Mapping[str, Any]) -> dict[str, Any]:
    """Return the coordinate of the depth of currents, if the file counts it from the surface."""
    if (
        "surfaceCurrentDepth" not in about
        or about.get("depthTypeIndex", _BELOW_SURFACE) != _BELOW_SURFACE
    ):
        return {}
    depth_m = abs(float(about["surfaceCurrentDepth"]))
    return {"depth": ((), depth_m, {"standard_name": "depth", "units": "m", "positive": "down"})}


def _credit(about: Mapping[str, Any]) -> dict[str, str]:
    """Return a file's attributes by the CF conventions, with its time of issue."""
    product = _text(about.get("productSpecification", "S-100"))
    place = _text(about.get("geographicIdentifier", ""))
    method = about.get("methodCurrentsProduct", about.get("methodWaterLevelProduct", ""))
    issued = "".join(
        re.sub(r"\D", "", _text(about.get(key, "")))[:size]
        for key, size in (("issueDate", 8), ("issueTime", 6))
    )
    known = {"title": f"{place.replace('_', ' ')} ({product})", "source": _text(method)}
    known[_KIND] = product
    if len(issued) == 14:
        moment = datetime.strptime(issued, "%Y%m%d%H%M%S")  # noqa: DTZ007 - S-100's times are UTC
        known[_ISSUED] = moment.isoformat()
    datum = {key: _text(about[key]) for key in ("verticalDatum",) if key in about}
    return known | datum
