"""The grid of a variable: two axes, curved lines of points, or the cells of a mesh.

Names are those of CF 1.11 and UGRID 1.0, and of models that write neither: FVCOM (`nv`, `lonc`),
SCHISM and ADCIRC (`element`), ROMS (`lon_u` beside `lon_rho`), NEMO (`nav_lon`, `glamu`).
"""

import re
from collections.abc import Mapping

import numpy as np

from pipeline._types import DataArray, Dataset, FloatArray, IndexArray
from pipeline.sources.cf.axes import axis_role, coordinate_axis, grid_fault
from pipeline.sources.cf.dataset import reading
from pipeline.sources.cf.mesh import SAME_SHARE, Axes, SourceMesh, corner_triangles

# Names of longitudes without attributes, as models write them; those of latitudes have "lat".
_LONGITUDE = re.compile(r"(nav_|x?)(lon|lat)(g|gitude|itude)?(_?(rho|u|v|t|c|cell|node))?")
_CURVED = re.compile(r"(glam|gphi)[tuvf]")
# Names of the corners of cells, where no attribute says so.
_CORNERS = re.compile(r"nv|element|ele|triangles|tri|.*_?face_nodes")
SURFACE = {"nschism_vgrid_layers": -1, "nvrt": -1, "siglay": 0}
"""Dimensions of levels without a coordinate, and the place of the surface: SCHISM counts from the
bottom, FVCOM from the surface."""
# Beginnings of the names of dimensions along a grid's own x and y.
_ALONG_X = ("xi", "x", "i", "nx", "lon")
_ALONG_Y = ("eta", "y", "j", "ny", "lat")
# Largest number of points: an ocean at 1/12 degree has 13 million.
_MAX_POINTS = 20_000_000
# Least number of corners of a cell, and the largest that is taken for one.
_CORNERS_OF_CELL = (3, 12)


def role_of(dataset: Dataset, name: str) -> str:
    """Return a variable's role as `axis_role` does, also by the names that models give."""
    role, plain = axis_role(dataset, name), name.lower()
    if role or dataset.variables[name].attrs.get("standard_name"):
        return role
    if _LONGITUDE.fullmatch(plain):
        return "lon" if "lon" in plain else "lat"
    return {"glam": "lon", "gphi": "lat"}[plain[:4]] if _CURVED.fullmatch(plain) else ""


def coordinates(dataset: Dataset, array: DataArray) -> dict[str, dict[str, str]]:
    """Return for each dimension of a variable the coordinates along it, by their roles.

    The first choice is the one of the dimension's own name; the others are auxiliary.
    """
    found: dict[str, dict[str, str]] = {}
    for dim in map(str, array.dims):
        own = axis_role(dataset, dim)
        if own and dim in dataset.variables and dataset.variables[dim].ndim == 1:
            found[dim] = {own: dim}
            continue
        along = _named_first(dataset, array, (dim,))
        found[dim] = {role: name for role, name in along.items() if role}
        if not found[dim] and own:
            found[dim] = {own: dim}
    return found


def _named_first(dataset: Dataset, array: DataArray, dims: tuple[str, ...]) -> dict[str, str]:
    """Return the variables along just some dimensions by role, those that `array` names first."""
    named = str(array.encoding.get("coordinates") or array.attrs.get("coordinates", "")).split()
    listed = [*(name for name in named if name in dataset.variables), *map(str, dataset.variables)]
    by_role: dict[str, str] = {}
    for name in listed:
        if set(dataset.variables[name].dims) == set(dims) and name != array.name:
            by_role.setdefault(role_of(dataset, name), name)
    return by_role


def grid_of(
    dataset: Dataset, array: DataArray, about: Mapping[str, Mapping[str, str]]
) -> Axes | SourceMesh:
    """Return the axes of a variable, or the mesh that it is on.

    `about` is what `coordinates` returns. Raises ValueError if the file does not say where the
    values are.
    """
    mapping = dataset.variables.get(array.attrs.get("grid_mapping", ""))
    is_turned = mapping is not None and "rotated" in mapping.attrs.get("grid_mapping_name", "")
    along = {role: dim for dim, own in about.items() if len(own) == 1 for role in own}
    if "lon" in along and "lat" in along and not is_turned:
        lat, lon = along["lat"], along["lon"]
        lons = coordinate_axis(dataset, about[lon]["lon"], period=360.0)
        return Axes((lat, lon), lons, coordinate_axis(dataset, about[lat]["lat"]))
    if (lines := _curved_lines(dataset, array)) is not None:
        return _straight_axes(lines) or lines
    of_mesh = array.attrs.get("mesh", "") in dataset.variables
    for dim in map(str, reversed(array.dims)):
        is_of_points = len(about[dim]) > 1 and {"lon", "lat"} <= about[dim].keys()
        if is_of_points or (of_mesh and not about[dim] and dim.lower() not in SURFACE):
            return _cells_of_mesh(dataset, array, dim)
    raise ValueError(grid_fault(array, array.attrs["grid_mapping"] if is_turned else ""))


def _curved_lines(dataset: Dataset, array: DataArray) -> SourceMesh | None:
    """Return the points on curved lines on which a variable is; None where it is on none."""
    dims = tuple(map(str, array.dims))
    pairs = [(one, other) for i, one in enumerate(dims) for other in dims[i + 1 :]]
    for pair in reversed(pairs):
        names = _named_first(dataset, array, pair)
        if "lon" in names and "lat" in names:
            first, second = (name.lower().split("_")[0] for name in pair)
            is_along_x = first in _ALONG_X and second in _ALONG_Y
            y, x = pair[::-1] if is_along_x else pair
            lon, lat = (_degrees(dataset, names[role], (y, x)) for role in ("lon", "lat"))
            return SourceMesh((y, x), lon, lat)
    return None


def _straight_axes(mesh: SourceMesh) -> Axes | None:
    """Return the axes of lines that are not curved."""
    lines = ((mesh.dims, mesh.lon, mesh.lat), (mesh.dims[::-1], mesh.lon.T, mesh.lat.T))
    for (lat_dim, lon_dim), lon, lat in lines:
        if min(lon.shape) < 2 or not np.isfinite(lon + lat).all():
            continue
        slack = SAME_SHARE * min(np.abs(np.diff(lon[0])).min(), np.abs(np.diff(lat[:, 0])).min())
        is_straight = (
            np.abs(lon - lon[:1]).max() <= slack and np.abs(lat - lat[:, :1]).max() <= slack
        )
        if slack > 0 and is_straight:
            return Axes((lat_dim, lon_dim), lon[0], lat[:, 0])
    return None


def _cells_of_mesh(dataset: Dataset, array: DataArray, dim: str) -> SourceMesh:
    """Return the mesh on whose nodes or cells a variable is, along one dimension.

    Raises ValueError if the file does not say which points make a cell, or where its nodes are.
    """
    topology = dataset.variables.get(array.attrs.get("mesh", ""))
    about = {} if topology is None else topology.attrs
    name = about.get("face_node_connectivity", "") or _corners_by_name(dataset)
    if name not in dataset.variables:
        raise ValueError(
            f"{array.name} is at points along {dim}, and nothing says which of them make a cell; "
            "give the file with its corners of cells, or that of its mesh beside it: nv of FVCOM, "
            "or UGRID's face_node_connectivity"
        )
    corners, cell_dim = _corners(dataset, name)
    nodes = _node_positions(
        dataset, about.get("node_coordinates", ""), cell_dim, int(corners.max()) + 1
    )
    triangles, cells = corner_triangles(corners)
    if dim != cell_dim and nodes[0].size != array.sizes[dim]:
        raise ValueError(
            f"{array.name} is along {dim} ({array.sizes[dim]}), neither the {nodes[0].size} nodes "
            f"nor the {len(corners)} cells of its mesh; give components on nodes or cells"
        )
    if dim != cell_dim:
        return SourceMesh((dim,), nodes[0], nodes[1], triangles)
    present = corners >= 0
    middles = [
        np.where(present, side[corners], 0.0).sum(axis=1) / present.sum(axis=1) for side in nodes
    ]
    return SourceMesh((dim,), middles[0], middles[1], triangles, nodes[0], nodes[1], cells)


def _corners_by_name(dataset: Dataset) -> str:
    """Return the variable with the corners of cells, by its role or its name; "" without one."""
    for name, variable in dataset.variables.items():
        if variable.attrs.get("cf_role") == "face_node_connectivity":
            return str(name)
    return next(
        (
            str(name)
            for name, one in dataset.variables.items()
            if one.ndim == 2 and _CORNERS.fullmatch(str(name).lower())
        ),
        "",
    )


def _corners(dataset: Dataset, name: str) -> tuple[IndexArray, str]:
    """Return the corners (cells, k), from 0 on, -1 where a cell has fewer, and their dimension."""
    variable = dataset.variables[name]
    with reading():
        values = np.asarray(variable.values, dtype=float)
    least, most = _CORNERS_OF_CELL
    is_across = least <= values.shape[0] <= most and values.shape[1] > values.shape[0]
    values = values.T if is_across else values
    if not least <= values.shape[1] <= most:
        raise ValueError(f"{name} is no list of corners: {values.shape[0]} x {values.shape[1]}")
    known = np.isfinite(values) & (values >= 0)
    begin = float(variable.attrs.get("start_index", values[known].min() if known.any() else 0))
    # Counted from 1, FVCOM pads cells with 0; UGRID pads with a fill value.
    corners = np.where(known & (values >= begin), values - begin, -1).astype(np.intp)
    return corners, str(variable.dims[1 if is_across else 0])


def _node_positions(
    dataset: Dataset, named: str, cell_dim: str, count: int
) -> tuple[FloatArray, FloatArray]:
    """Return the positions of nodes, degrees; ValueError where the file has none."""
    names = [name for name in named.split() if name in dataset.variables] or [
        str(name)
        for name, variable in dataset.variables.items()
        if variable.ndim == 1 and cell_dim not in variable.dims and variable.size >= count
    ]
    found: dict[str, str] = {}
    for name in names:
        found.setdefault(role_of(dataset, name), name)
    if not {"lon", "lat"} <= found.keys():
        raise ValueError(
            "its mesh has no nodes in degrees of longitude and latitude; give the file with them, "
            "as lon and lat"
        )
    lon, lat = (
        _degrees(dataset, found[role], tuple(map(str, dataset.variables[found[role]].dims)))
        for role in ("lon", "lat")
    )
    return lon, lat


def _degrees(dataset: Dataset, name: str, dims: tuple[str, ...]) -> FloatArray:
    """Read positions in the order of some dimensions, NaN where there are none."""
    variable = dataset.variables[name]
    if variable.size > _MAX_POINTS:
        raise ValueError(f"{name} has {variable.size:,} values, more than {_MAX_POINTS:,}")
    if variable.dtype.kind not in "iuf":
        raise ValueError(f"{name} holds no numbers; give degrees")
    with reading():
        values = np.asarray(variable.transpose(*dims).values, dtype=float)
    values[~(np.abs(values) <= 720)] = np.nan  # fill values that are not named as such
    if not np.isfinite(values).any():
        raise ValueError(f"{name} has no degrees; give the file with the positions of its points")
    return values
