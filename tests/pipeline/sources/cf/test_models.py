"""Currents of coastal models and services, in the forms in which they are published.

One analytic current is written in each form, read, and planned in; a fault that a reader could make
is planted into files, and must be seen in what is read.
"""

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import shapely
import xarray as xr

import renew
from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.findings.note_words import note_texts
from pipeline.model import CurrentGrid, Land
from pipeline.scenario.season import Season
from pipeline.sources.cf import contents, mesh
from pipeline.sources.cf.adapter import CfFiles
from pipeline.sources.cf.dataset import open_dataset
from pipeline.sources.cf.fields import FieldReader
from pipeline.sources.cf.mesh import SourceMesh, Table
from pipeline.sources.current_field import LandMask
from tests.pipeline.sources.cf import model_files
from tests.pipeline.sources.cf.model_files import (
    FORMS,
    SPEED_M_S,
    VORTEX_DEG,
    curved,
    on_cells,
    on_nodes,
    regular,
    staggered,
    velocity,
    write_s111,
)

REGION = shapely.box(132.2, 16.8, 133.8, 18.2)
STEP = VORTEX_DEG / 20
# Linear interpolation in cells of size h is off by h² / 8 times the second derivatives; both those
# along x and along y, and in the corners of cells a little more.
BOUND_M_S = 2.5 * SPEED_M_S * (np.pi / 20) ** 2 / 8
METRES = 111_195.0
SHRINK = math.cos(math.radians(17.5))


def read(
    path: Path | tuple[Path, ...],
    region: shapely.Polygon = REGION,
    pair: tuple[str, str] | None = None,
    **about: Any,
) -> CurrentGrid:
    """Read a file as the current of a voyage; RequestError if it is refused."""
    changing = {"time_method": "changing", "departure": "2024-03-15T03:00Z", "max_hours": 6}
    paths = tuple(map(str, path if isinstance(path, tuple) else (path,)))
    season = Season.model_validate({"name": "it", "currents": [paths], **(about or changing)})
    source = CfFiles(paths, pair=pair)
    if reason := source.uncovered_reason(region, season):
        raise RequestError(reason)
    return source.current(region, season, Land((), (), 0.0), Path())


def written(data: xr.Dataset, path: Path) -> Path:
    data.to_netcdf(path, engine="netcdf4", format="NETCDF3_64BIT")
    return path


def largest_error(grid: CurrentGrid) -> float:
    """Return the largest difference from the formula, m/s."""
    true = velocity(*np.meshgrid(grid.lon, grid.lat))
    return float(
        max(np.nanmax(np.abs(own - part)) for own, part in zip((grid.u, grid.v), true, strict=True))
    )


def form(kind: str, step: float, folder: Path) -> Path:
    """Write the current in a form."""
    if kind.startswith("S-111"):
        coding, edition = (int(kind[6]), kind[-3:])
        return write_s111(folder / "form.h5", step, coding, edition)
    return written(FORMS[kind](step), folder / "form.nc")


KINDS = (*FORMS, "S-111 2 of 1.0", "S-111 2 of 2.0", "S-111 3 of 1.2")


@pytest.mark.gate_share(2)
@pytest.mark.parametrize("kind", KINDS)
def test_each_form_is_read_within_the_error_of_interpolation(tmp_path: Path, kind: str) -> None:
    errors = [largest_error(read(form(kind, step, tmp_path))) for step in (STEP, STEP / 2)]
    assert errors[0] < BOUND_M_S
    assert errors[1] < errors[0] / 3 or errors[0] < 2e-6


# --- plans --------------------------------------------------------------------------------------


def planned(current: Any) -> renew.Route:  # noqa: ANN401 - a field, or a function
    """Plan between islands in a plane of the region."""
    islands = [shapely.box(-12e3, -8e3, 9e3, 11e3), shapely.box(30e3, -40e3, 38e3, -25e3)]
    chart = renew.Chart(shapely.box(-70e3, -65e3, 70e3, 65e3), islands)
    vessel = renew.Vessel(speed=1.5, turn_rate=math.radians(5), length=7.0)
    return renew.plan(chart, current, vessel, (-60e3, -45e3), (60e3, 50e3), classes=2).best


def in_plane(grid: CurrentGrid) -> renew.GriddedCurrent:
    """Return the first field in the plane."""
    x, y = (grid.lon - 133.0) * SHRINK * METRES, (grid.lat - 17.5) * METRES
    return renew.GriddedCurrent(x, y, grid.u[0], grid.v[0])


def formula(xy: FloatArray) -> FloatArray:
    """Return the formula's current in the plane."""
    lon, lat = 133.0 + xy[..., 0] / METRES / SHRINK, 17.5 + xy[..., 1] / METRES
    return np.stack(velocity(lon, lat), axis=-1)


@pytest.fixture(scope="module")
def own_plan() -> renew.Route:
    """Give the plan in the formula itself."""
    return planned(formula)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_plan_in_each_form_is_the_formulas_own(
    tmp_path: Path, own_plan: renew.Route, kind: str
) -> None:
    routes = [planned(in_plane(read(form(kind, step, tmp_path)))) for step in (STEP, STEP / 2)]
    off = [abs(route.fuel / own_plan.fuel - 1) for route in routes]
    assert off[0] < 3e-3
    # Fourfold, but for the optimiser's own tolerance.
    assert off[1] < off[0] / 3 + 5e-6
    for route in routes:
        assert route.homotopy == own_plan.homotopy
        apart = shapely.hausdorff_distance(
            *(shapely.LineString(one.path) for one in (route, own_plan))
        )
        assert apart < 250


# --- planted faults -----------------------------------------------------------------------------


def _eastward(step: float) -> xr.Dataset:
    """Return components on curved lines that are east and north, as ROMS names them."""
    data = curved(step).rename(vozocrtx="u_eastward", vomecrty="v_northward")
    parts = velocity(data.nav_lon.values, data.nav_lat.values)
    for name, part in zip(("u_eastward", "v_northward"), parts, strict=True):
        data[name] = data[name].copy(data=np.broadcast_to(part, data[name].shape))
        data[name].attrs = {"units": "meter second-1", "long_name": name.replace("_", " ")}
    return data


def _turned(by: Callable[[FloatArray], FloatArray]) -> Callable[..., tuple[FloatArray, FloatArray]]:
    """Return what turns components by a function of the right angle."""

    def turned(self: Table, along: FloatArray, across: FloatArray) -> tuple[FloatArray, FloatArray]:
        assert self.turn is not None
        angle = by(np.arctan2(self.turn[1], self.turn[0])).reshape(self.shape)
        cos, sin = np.cos(angle), np.sin(angle)
        return along * cos - across * sin, along * sin + across * cos

    return turned


def _swapped(self: FieldReader, first: FloatArray, second: FloatArray) -> list[FloatArray]:
    return _RIGHT(self, first, second)[::-1]


def _shifted(self: Table, variable: xr.Variable, dims: tuple[str, ...]) -> FloatArray:
    return np.roll(_PART(self, variable, dims), 1, axis=-1)


_RIGHT, _PART = FieldReader._east_and_north, Table.read
# Faults of a reader: what is replaced by what, and the form in which it is seen.
FAULTS: dict[str, tuple[object, str, object, str]] = {
    "angle ignored": (Table, "turned", _turned(np.zeros_like), "turned and curved"),
    "angle of the wrong sign": (Table, "turned", _turned(np.negative), "turned and curved"),
    "angle in degrees": (Table, "turned", _turned(np.degrees), "turned and curved"),
    "swapped": (FieldReader, "_east_and_north", _swapped, "triangles, on nodes"),
    "faces off by one": (Table, "read", _shifted, "staggered"),
    "turned twice": (contents, "_frame", lambda *_: "lines", "eastward"),
    "direction from": (contents, "_frame", lambda *_: "from", "S-111 2 of 1.0"),
}


@pytest.mark.gate_share(3)
@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    owner, name, wrong, kind = FAULTS[fault]
    monkeypatch.setattr(owner, name, wrong)
    path = tmp_path / "eastward.nc"
    path = written(_eastward(STEP), path) if kind == "eastward" else form(kind, STEP, tmp_path)
    try:
        grid = read(path)
    except RequestError as refused:
        assert "the components are swapped" in str(refused)  # noqa: PT017 - or it is read
        return
    assert largest_error(grid) > 3 * BOUND_M_S


def test_eastward_components_on_curved_lines_are_not_turned(tmp_path: Path) -> None:
    assert largest_error(read(written(_eastward(STEP), tmp_path / "east.nc"))) < BOUND_M_S


def test_on_turned_lines_components_must_say_what_they_are(tmp_path: Path) -> None:
    data = curved(STEP).rename(vozocrtx="u", vomecrty="v")
    for name in "uv":
        data[name].attrs = {"units": "m s-1"}
    with pytest.raises(RequestError, match=r"turned by up to .* sea_water_x_velocity"):
        read(written(data, tmp_path / "unsaid.nc"))
    for name, axis in (("u", "x"), ("v", "y")):
        data[name].attrs["standard_name"] = f"sea_water_{axis}_velocity"
    assert largest_error(read(written(data, tmp_path / "said.nc"))) < BOUND_M_S


# --- land ---------------------------------------------------------------------------------------


def _with_island(how: str) -> tuple[xr.Dataset, float, float]:
    """Return the staggered form with an island, and where it was moved to, degrees.

    Zeros that nothing marks are taken for land where the world's land is: beside Luzon.
    """
    east, north = (-11.6, -2.2) if how == "zeros" else (0.0, 0.0)
    data = staggered(STEP)
    for name in "uv":
        lon, lat = data[f"lon_{name}"].values + east, data[f"lat_{name}"].values + north
        if how == "zeros":
            land = LandMask.world().is_land(lon.ravel(), lat.ravel()).reshape(lon.shape)
        else:
            land = np.hypot((lon - 133.0) * SHRINK, lat - 17.5) < 0.12
        dims, about = data[name].dims[1:], data[name].attrs
        data = data.assign_coords({f"lon_{name}": (dims, lon), f"lat_{name}": (dims, lat)})
        data[name] = data[name].where(
            ~xr.DataArray(land, dims=dims), np.nan if how == "gaps" else 0.0
        )
        data[name].attrs = about
        if how == "mask":
            data[f"mask_{name}"] = (dims, (~land).astype("f8"))
    return data, east, north


def _lost_beside_land(path: Path, east: float, north: float) -> float:
    """Return the most by which a current of the file is slower than the formula's, as a share."""
    region = shapely.affinity.translate(REGION, east, north)
    grid = read(path, region, valid="2024-03-15")
    assert np.isnan(grid.u).any()
    true = np.hypot(*velocity(*np.meshgrid(grid.lon - east, grid.lat - north)))
    own = np.hypot(grid.u[0], grid.v[0])
    return float(np.nanmax((1 - own / true)[true > SPEED_M_S / 2]))


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("how", ["gaps", "mask", "zeros"])
def test_faces_on_land_are_not_averaged_as_zero(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    data, east, north = _with_island(how)
    path = written(data, tmp_path / "island.nc")
    # A value beside land is that of a cell's wet corners: it is as old as half a cell away.
    assert _lost_beside_land(path, east, north) < np.pi / 20 * 1.2

    def dry_as_zero(weights: Any, values: FloatArray) -> FloatArray:  # noqa: ANN401 - sparse
        found = (weights @ np.nan_to_num(values).T).T
        return np.where((weights.sum(axis=1) > 0) & (found != 0), found, np.nan)

    monkeypatch.setattr(mesh, "_averaged", dry_as_zero)
    assert _lost_beside_land(path, east, north) > 0.4


def test_nothing_leaks_across_land() -> None:
    # Two basins, of 1 and of -1 m/s, on both sides of a wall one point wide.
    x, y = np.meshgrid(np.arange(41) * 0.01, np.arange(41) * 0.01)
    values = np.where(x < 0.2, 1.0, -1.0)
    values[:, 20] = np.nan
    turned = SourceMesh(("y", "x"), x + 0.3 * y, y)
    lon, lat = np.arange(0.0, 0.5, 0.003), np.arange(0.0, 0.4, 0.003)
    found = turned.table(lon, lat).interpolated(values[None])[0]
    assert set(np.unique(found[np.isfinite(found)]).round(9)) == {-1.0, 1.0}
    from scipy.spatial import Delaunay

    points = np.stack([x.ravel(), y.ravel()], axis=-1)
    corners = Delaunay(points).simplices
    # Of cells without the wall the basins have no edge in common.
    apart = corners[~(x.ravel()[corners] == 0.2).any(axis=1)]
    middles = points[apart].mean(axis=1)
    cells = SourceMesh(
        ("nele",), middles[:, 0], middles[:, 1], apart, x.ravel(), y.ravel(), np.arange(len(apart))
    )
    found = cells.table(lon, lat).interpolated(np.where(middles[:, 0] < 0.2, 1.0, -1.0)[None])[0]
    assert np.isnan(found[:, (lon > 0.19) & (lon < 0.21)]).all()
    assert set(np.unique(found[np.isfinite(found)]).round(9)) == {-1.0, 1.0}


def test_cells_that_fall_dry_at_times_have_gaps_then(tmp_path: Path) -> None:
    data = curved(STEP)
    for name in ("vozocrtx", "vomecrty"):
        data[name] = data[name].copy()
        data[name][1, 70:90, 70:110] = np.nan
    grid = read(
        written(data, tmp_path / "dry.nc"),
        departure="2024-03-15T00:00Z",
        time_method="changing",
        max_hours=12,
    )
    assert any("filled from the times before and after" in text for text in note_texts(grid.notes))
    assert np.isfinite(grid.u).all()
    # Beside dry points the value is that of the wet ones, in the same cell.
    assert largest_error(grid) < SPEED_M_S * np.pi / 20 / 2


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("filler", [np.nan, 0.0])
def test_points_on_land_may_have_no_position(tmp_path: Path, filler: float) -> None:
    data = curved(STEP)
    blank = (slice(80, 100), slice(88, 101))
    for name in ("nav_lon", "nav_lat"):
        data[name].values[blank] = filler
    for name in ("vozocrtx", "vomecrty"):
        data[name] = data[name].copy()
        data[name][:, *blank] = np.nan
    grid = read(written(data, tmp_path / "blank.nc"))
    assert np.isnan(grid.u).mean() > 0.02
    # Beside the blank a slope of the lines is one-sided.
    assert largest_error(grid) < 2 * BOUND_M_S


def test_a_table_reaches_across_180_degrees(tmp_path: Path) -> None:
    data = curved(STEP)
    data = data.assign_coords(nav_lon=(("y", "x"), (data.nav_lon.values + 47.0 + 180) % 360 - 180))
    grid = read(written(data, tmp_path / "pacific.nc"), shapely.box(179.2, 16.8, 180.8, 18.2))
    true = velocity(*np.meshgrid(grid.lon - 47.0, grid.lat))
    assert np.nanmax(np.abs(grid.u[0] - true[0])) < BOUND_M_S


# --- names, pairs, archives ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "units", "degrees"),
    [
        (("ssu", "ssv"), "m/sec", "degrees_E"),
        (("uos", "vos"), "meter/sec", "degreeE"),
        (("UCUR", "VCUR"), "metres per second", "degree_east"),
        (("EWCT", "NSCT"), "m.s**-1", "degrees_east"),
        (("u_eastward", "v_northward"), "meter second-1", "degree_E"),
    ],
)
def test_names_and_units_as_they_are_spelled(
    tmp_path: Path, names: tuple[str, str], units: str, degrees: str
) -> None:
    data = regular(0.1).rename(uo=names[0], vo=names[1])
    for name in names:
        data[name].attrs = {"units": units}
    data = data.rename(lon="east", lat="up")
    data["east"].attrs["units"] = degrees
    data["up"].attrs["units"] = re.sub("east$", "north", re.sub("E$", "N", degrees))
    assert largest_error(read(written(data, tmp_path / "spelled.nc"))) < 1e-6


def test_a_pair_can_be_named(tmp_path: Path) -> None:
    data = regular(0.1)
    data = data.assign(a=data.uo * 1.0, b=data.vo * 1.0, uo=data.uo * 0.1, vo=data.vo * 0.1)
    for name, other in (("a", "uo"), ("b", "vo")):
        data[name].attrs = {"units": "m s-1"}
        data[other].attrs = {"units": "m s-1", "standard_name": ""}
    path = written(data, tmp_path / "pairs.nc")
    assert largest_error(read(path)) > 0.4
    grid = read(path, pair=("a", "b"))
    assert largest_error(grid) < 1e-6
    assert any("is a and b of the file, as asked" in text for text in note_texts(grid.notes))
    with pytest.raises(RequestError, match="no variable c, but a "):
        read(path, pair=("a", "c"))
    data["a"].attrs["long_name"] = "10 metre U wind component"
    with pytest.raises(RequestError, match="are no current: the file calls one '10 metre U wind"):
        read(written(data, tmp_path / "wind.nc"), pair=("a", "b"))


def test_speed_and_direction_are_read_from_netcdf(tmp_path: Path) -> None:
    data = regular(0.1)
    speed, bearing = np.hypot(data.uo, data.vo), np.degrees(np.arctan2(data.uo, data.vo)) % 360
    data = xr.Dataset({"spd": speed, "dir": bearing}, data.coords)
    data["spd"].attrs = {"units": "knots", "standard_name": "sea_water_speed"}
    data["spd"] = data["spd"].copy(data=data["spd"].values * 3600 / 1852)
    for said, off in (
        ("sea_water_velocity_to_direction", 0.0),
        ("sea_water_velocity_from_direction", 180.0),
    ):
        data["dir"] = ((bearing + off) % 360).assign_attrs(units="degree", standard_name=said)
        assert largest_error(read(written(data, tmp_path / f"{off:g}.nc"))) < 1e-6


def test_faces_without_positions_are_refused_with_what_is_lacking(tmp_path: Path) -> None:
    data = staggered(STEP).drop_vars(["lon_u", "lat_u", "lon_v", "lat_v"])
    with pytest.raises(RequestError, match=r"u is along .*give the file with its lon and lat"):
        read(written(data, tmp_path / "rho.nc"))


def test_levels_of_fvcom_are_at_each_node(tmp_path: Path) -> None:
    path = written(on_cells(STEP), tmp_path / "shares.nc")
    assert any("of siglay the index 0" in text for text in note_texts(read(path).notes))


def _schism(step: float) -> xr.Dataset:
    """Return the current as SCHISM 5.10 writes it: layers from the bottom, and its own names."""
    data = on_nodes(step)
    layers = {"ucx": "horizontalVelX", "ucy": "horizontalVelY"}
    for name, own in layers.items():
        parts = [0.1 * data[name], data[name]]
        data[own] = xr.concat(parts, "nSCHISM_vgrid_layers").transpose("time", "nodes", ...)
        data[own].attrs = {"mesh": "mesh", "location": "node", "units": "m s-1"}
    return data.drop_vars([*layers])


def _delft(step: float) -> xr.Dataset:
    """Return the current on cells of three and four corners, by the UGRID conventions."""
    x, y = model_files.axes(step)
    number = np.arange(x.size * y.size).reshape(y.size, x.size)
    squares = np.stack(
        [number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1
    )
    whole, halved = squares[::2].reshape(-1, 4), squares[1::2].reshape(-1, 4)
    empty = np.full((len(halved), 1), -999)
    corners = np.concatenate(
        [whole, *(np.hstack([halved[:, own], empty]) for own in ([0, 1, 2], [0, 2, 3]))]
    )
    lon, lat = (side.ravel() for side in np.meshgrid(x, y))
    present = corners >= 0
    middles = [(side[corners] * present).sum(1) / present.sum(1) for side in (lon, lat)]
    topology = {
        "cf_role": "mesh_topology",
        "node_coordinates": "mesh2d_node_x mesh2d_node_y",
        "face_node_connectivity": "mesh2d_face_nodes",
    }
    about = {"mesh": "mesh2d", "location": "face", "units": "m s-1"}
    u, v = (np.broadcast_to(part, (3, part.size)) for part in velocity(*middles))
    faces = ("mesh2d_nFaces", "mesh2d_nMax_face_nodes")
    return xr.Dataset(
        {
            "mesh2d": ((), 0, topology),
            "mesh2d_ucx": (("time", faces[0]), u, about),
            "mesh2d_ucy": (("time", faces[0]), v, about),
            "mesh2d_face_nodes": (faces, corners, {"start_index": 0, "_FillValue": -999}),
            "mesh2d_node_x": ("mesh2d_nNodes", lon, {"standard_name": "longitude"}),
            "mesh2d_node_y": ("mesh2d_nNodes", lat, {"standard_name": "latitude"}),
        },
        {"time": np.array(model_files.TIMES, "datetime64[ns]")},
    )


@pytest.mark.parametrize("make", [_schism, _delft])
def test_meshes_as_models_name_them(tmp_path: Path, make: Callable[[float], xr.Dataset]) -> None:
    assert largest_error(read(written(make(STEP), tmp_path / "mesh.nc"))) < 1.5 * BOUND_M_S


@pytest.mark.parametrize(
    ("make", "apart"),
    [(_schism, "mesh face_nodes node_x node_y"), (staggered, "lon_u lat_u lon_v lat_v")],
)
def test_a_grid_may_lie_in_a_file_of_its_own(
    tmp_path: Path, make: Callable[[float], xr.Dataset], apart: str
) -> None:
    data = make(STEP).reset_coords()
    names = [name for name in apart.split() if name in data]
    assert len(names) > 2
    for variable in data.variables.values():
        variable.attrs.pop("coordinates", None)
    grid = written(data[names], tmp_path / "grid.nc")
    flow = written(data.drop_vars(names), tmp_path / "flow.nc")
    with pytest.raises(RequestError, match=r"of its (grid|mesh) beside it"):
        read(flow)
    whole = read((flow, grid))
    assert largest_error(whole) < 1.5 * BOUND_M_S
    assert {name for name, _ in whole.files} == {"flow.nc", "grid.nc"}


def test_a_mesh_without_times_is_read(tmp_path: Path) -> None:
    path = written(_delft(STEP).isel(time=0, drop=True), tmp_path / "still.nc")
    grid = read(path, valid="2024-03-15")
    assert largest_error(grid) < 1.5 * BOUND_M_S
    assert any(note.kind == "time-assumed" for note in grid.notes)


def test_components_on_the_edges_of_a_mesh_are_refused(tmp_path: Path) -> None:
    data = on_nodes(0.1)
    for name in ("ucx", "ucy"):
        data[name] = data[name].isel(nodes=slice(None, -1)).rename(nodes="edges")
    with pytest.raises(RequestError, match=r"along edges \(\d+\), neither the \d+ nodes"):
        read(written(data, tmp_path / "edges.nc"))


def test_points_without_cells_are_refused_with_what_is_lacking(tmp_path: Path) -> None:
    path = written(on_cells(STEP).drop_vars("nv"), tmp_path / "points.nc")
    with pytest.raises(RequestError, match="nothing says which of them make a cell"):
        read(path)


# --- S-100 --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("coding", "edition"), [(2, "1.0"), (2, "2.0"), (3, "1.2")])
def test_s111_values_are_those_that_h5py_reads(tmp_path: Path, coding: int, edition: str) -> None:
    """The structures but that of edition 1.0, format 2, are from the standard's text."""
    path = write_s111(tmp_path / "a.h5", 0.1, coding, edition)
    with h5py.File(path, "r+") as file:
        values = file["SurfaceCurrent/SurfaceCurrent.01/Group_002/values"]
        some = values[:]
        some.flat[7] = (-9999.0, -9999.0)
        values[...] = some
    with open_dataset(path) as data:
        for code in ("surfaceCurrentSpeed", "surfaceCurrentDirection"):
            assert data[code].dtype == np.float32
            assert np.isnan(data[code].values[1].ravel()[7])
            kept = np.isfinite(data[code].values[1])
            assert kept.sum() == some.size - 1
            assert (data[code].values[1][kept] == some[code][kept]).all()


def test_tiles_of_s111_are_one_field_and_a_later_forecast_wins(tmp_path: Path) -> None:
    # The tiles' lattices differ, as those of different latitudes do.
    south = write_s111(tmp_path / "s.h5", STEP, tile=(-90.0, 17.4))
    north = write_s111(tmp_path / "n.h5", STEP * 0.97, tile=(17.4, 90.0))
    grid = read((north, south))
    assert np.isfinite(grid.u).all()
    assert largest_error(grid) < BOUND_M_S
    assert {name for name, _ in grid.files} == {"s.h5", "n.h5"}
    again = write_s111(tmp_path / "s2.h5", STEP, tile=(-90.0, 17.4), issueTime="02:00:00")
    with h5py.File(again, "r+") as file:
        for group in file["SurfaceCurrent/SurfaceCurrent.01"].values():
            values = group["values"][:]
            values["surfaceCurrentSpeed"] *= np.float32(0.5)
            group["values"][...] = values
    region = shapely.box(132.2, 16.8, 133.8, 17.3)
    once, twice = (read(paths, region) for paths in ((south,), (again, south)))
    np.testing.assert_allclose(twice.u, once.u / 2, atol=1e-7)
    assert any("to a later forecast" in text for text in note_texts(twice.notes))


def test_the_unit_and_the_fill_value_of_s111_are_those_it_states(tmp_path: Path) -> None:
    path = write_s111(tmp_path / "a.h5", 0.1)
    with h5py.File(path, "r+") as file:
        about = file["Group_F/SurfaceCurrent"][:]
        about["uom.name"][0], about["fillValue"] = b"m/s", b"-1.5"
        file["Group_F/SurfaceCurrent"][...] = about
        for group in file["SurfaceCurrent/SurfaceCurrent.01"].values():
            values = group["values"][:]
            values["surfaceCurrentSpeed"] *= np.float32(1852 / 3600)
            values[:2] = (-1.5, -1.5)
            group["values"][...] = values
    assert largest_error(read(path)) < 1e-4
    with open_dataset(path) as data:
        assert np.isnan(data["surfaceCurrentSpeed"].values[:, :2]).all()


def _stations(file: h5py.File) -> None:
    file["SurfaceCurrent"].attrs["dataCodingFormat"] = np.uint8(8)


def _scanned(file: h5py.File) -> None:
    file["SurfaceCurrent"].attrs["sequencingRule.scanDirection"] = "latitude,longitude"


def _twice(file: h5py.File) -> None:
    file.copy("SurfaceCurrent/SurfaceCurrent.01", file["SurfaceCurrent"], "SurfaceCurrent.02")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_stations, "is of fixed stations, not on a grid; give a file of coding format 2 or 3"),
        (_scanned, "its values run along latitude,longitude"),
        (_twice, "it has 2 grids of SurfaceCurrent"),
    ],
)
def test_s111_of_other_kinds_is_refused_by_name(
    tmp_path: Path, change: Callable[[h5py.File], None], said: str
) -> None:
    path = write_s111(tmp_path / "a.h5", 0.1)
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(RequestError, match=said):
        read(path)


def test_the_official_s111_is_what_h5py_reads(shared: Path) -> None:
    path = shared / "data" / "s100" / "noaa_s111_dbofs_US4DE1BB.h5"
    with h5py.File(path) as file:
        groups = file["SurfaceCurrent/SurfaceCurrent.01"]
        values = np.stack([groups[f"Group_{n:03}/values"][:] for n in range(1, 49)])
    with open_dataset(path) as data:
        for code in values.dtype.names or ():
            stored = np.where(values[code] == np.float32(-9999), np.float32(np.nan), values[code])
            assert np.array_equal(data[code].values, stored, equal_nan=True)
    # Its only water is in the corner of the tile.
    about: dict[str, Any] = {"time_method": "changing", "departure": "2026-03-20T20:30Z"}
    grid = read(path, shapely.box(-75.316, 38.925, -75.307, 38.99), **about)
    texts = note_texts(grid.notes)
    assert any("knots" in text for text in texts)
    assert any("4.5 m depth" in text for text in texts)
    speed = np.hypot(grid.u, grid.v)
    ours = speed[np.isfinite(speed)]
    theirs = values["surfaceCurrentSpeed"].astype(float) * 1852 / 3600
    assert np.isin(ours.round(6), theirs.round(6)).all()


def test_the_official_mesh_keeps_its_cells_values(shared: Path) -> None:
    path = shared / "data" / "meshes" / "pygnome_small_trigrid_example.nc"
    grid = read(path, shapely.box(-88.28, 30.34, -88.23, 30.38), valid="2015-01-15T03:00Z")
    with xr.open_dataset(path, decode_times=False) as data:
        lon, lat = data.lonc.values, data.latc.values
        u = data.u.values[0]
    near = np.hypot((grid.lon[:, None] - lon) * 0.86, 0).T
    rows = np.hypot(grid.lat[:, None] - lat, 0).T
    # The node nearest to a cell's middle has about its value.
    column, row = near.argmin(axis=1), rows.argmin(axis=1)
    close = (near.min(axis=1) < 3e-4) & (rows.min(axis=1) < 3e-4)
    off = np.abs(grid.u[0, row, column] - u)[close]
    assert np.isfinite(off).sum() > 20
    assert np.nanmedian(off) < 0.004


def test_the_forms_have_no_divergence() -> None:
    """The formula is a stream function's, or the checks of directions would doubt it."""
    k = 1e-5
    east = (velocity(133.0 + k / SHRINK, 17.4)[0] - velocity(133.0, 17.4)[0]) / k
    north = (velocity(133.0, 17.4 + k)[1] - velocity(133.0, 17.4)[1]) / k
    assert abs(east + north) < 1e-4
    assert model_files.VORTEX_DEG == 20 * STEP
