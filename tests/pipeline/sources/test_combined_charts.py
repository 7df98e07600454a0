"""Several charts as one, grids of depths from files, and what is too shallow by them."""

import math
import re
import shutil
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import shapely
import xarray as xr
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as hnp
from numpy.testing import assert_allclose
from pydantic import ValidationError
from scipy import ndimage

from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.findings.note_words import note_text
from pipeline.model import Credit, Land, Note, Zone
from pipeline.model.inputs import DepthRule
from pipeline.scenario.loading import load_scenario
from pipeline.scenario.region import ChartSource, ChartSpec
from pipeline.sources import combined_charts
from pipeline.sources.cf.dataset import open_dataset
from pipeline.sources.combined_charts import (
    DepthFile,
    Heights,
    Overlay,
    SoundedChart,
    overlay,
    shallow_polygons,
)
from pipeline.sources.land.osm import OsmLand
from pipeline.sources.registry import land_source
from tests.pipeline.conftest import ACROSS_BOX
from tests.pipeline.small_region import small_region
from tests.pipeline.sources import depth_grids
from tests.pipeline.sources.land.test_vector import write

SCENARIO = (
    small_region("mine")
    + """[chart]
source = {source}
[[seasons]]
name = "summer"
valid = "2024-07"
currents = ["embedded-palawan"]
"""
)
ROCK = shapely.box(118.45, 10.25, 118.46, 10.26)


def chart(
    *polygons: shapely.Polygon,
    name: str = "one",
    accuracy_m: float = 10.0,
    uncharted: shapely.Polygon | None = None,
) -> Land:
    """Make the land of one source."""
    zones = () if uncharted is None else (Zone("uncharted", "", "", uncharted),)
    credit = Credit(name, "land", name, "")
    return Land(polygons, (credit,), accuracy_m, (Note.of("gdal-warning", source=name),), zones)


def fault(folder: Path, source: str) -> str:
    """Return the fault of a scenario with a chart.source."""
    path = folder / "mine.toml"
    path.write_text(SCENARIO.format(source=source), encoding="utf-8")
    with pytest.raises(RequestError) as caught:
        load_scenario(str(path))
    (line,) = caught.value.faults
    return line


def test_areas_and_credits_add_up_and_the_worst_accuracy_counts() -> None:
    one, two = shapely.box(0, 0, 2, 2), shapely.box(1, 1, 3, 3)
    both = overlay([chart(one), chart(two, name="two", accuracy_m=60.0)])
    assert shapely.union_all(both.polygons).equals(shapely.union(one, two))
    assert [credit.name for credit in both.credits] == ["one", "two"]
    assert both.accuracy_m == 60.0
    assert both.notes == tuple(Note.of("gdal-warning", source=name) for name in ("one", "two"))
    assert both.zones == ()


def test_only_what_no_chart_covers_is_no_go() -> None:
    west, middle = shapely.box(0, 0, 2, 1), shapely.box(1, 0, 2, 1)
    alone = overlay([chart(uncharted=west)])
    assert shapely.union_all(alone.polygons).equals(west)
    two = overlay([chart(uncharted=west), chart(name="two", uncharted=shapely.box(1, 0, 3, 1))])
    assert shapely.union_all(two.polygons).equals(middle)
    assert [zone.kind for zone in two.zones] == ["uncharted"]
    assert overlay([chart(uncharted=west), chart(name="two")]).polygons == ()


def test_a_file_on_top_of_openstreetmap(tmp_path: Path) -> None:
    file = write(tmp_path / "rocks.geojson", ROCK)
    path = tmp_path / "mine.toml"
    path.write_text(SCENARIO.format(source='["osm-land", "./rocks.geojson"]'), encoding="utf-8")
    scenario = load_scenario(str(path))
    assert [one.name or one.path for one in scenario.chart.source] == ["osm-land", str(file)]
    both = land_source(scenario.chart, None)
    assert isinstance(both, Overlay)
    osm, rocks = both.sources
    assert isinstance(osm, OsmLand)
    (rock,) = rocks.land(shapely.box(*ACROSS_BOX)).polygons
    assert rock.equals(ROCK)
    assert set(osm.identity) | set(rocks.identity) <= set(both.identity)


def test_the_command_lines_chart_replaces_the_scenarios(tmp_path: Path) -> None:
    file = write(tmp_path / "rocks.geojson", ROCK)
    scenario = load_scenario("palawan-season", charts=[{"path": str(file)}])
    assert [one.path for one in scenario.chart.source] == [str(file)]
    with pytest.raises(RequestError, match=r"none\.gpkg' does not exist"):
        load_scenario("palawan-season", charts=[{"path": str(tmp_path / "none.gpkg")}])


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("osm-land", ChartSource(name="osm-land")),
        ("./land", ChartSource(path="./land")),
        ("land.gpkg", ChartSource(path="land.gpkg")),
        ("~/charts", ChartSource(path="~/charts")),
        ({"path": "land.gpkg", "layer": "coast"}, ChartSource(path="land.gpkg", layer="coast")),
    ],
)
def test_one_source_is_a_list_of_one(given: object, expected: ChartSource) -> None:
    assert ChartSpec.model_validate({"source": given}).source == (expected,)
    again = ChartSpec.model_validate({"source": [given]})
    assert ChartSpec.model_validate(again.model_dump(mode="json")) == again


@pytest.mark.parametrize("given", [[], {}, [{"layer": "coast"}], [3], ""])
def test_an_empty_source_is_refused(given: object) -> None:
    with pytest.raises(ValidationError):
        ChartSpec.model_validate({"source": given})


@pytest.mark.parametrize(
    ("source", "parts"),
    [
        ('"osm-lnad"', ["chart.source", "did you mean 'osm-land'", "./charts"]),
        ('["osm-land", "osm-lnad"]', ["chart.source[1]", "did you mean 'osm-land'"]),
        ('"embedded-palawan"', ["gives currents, not land"]),
        ('"./none.gpkg"', ["none.gpkg", "does not exist", "S-57 cells"]),
        ('{ path = "land.gpkg", layr = "x" }', ["unknown key", "layr", "did you mean 'layer'"]),
        ('{ layer = "coast" }', ["neither 'name' nor 'path'", "give one of the two"]),
        ('{ path = "land.gpkg", radius_m = -1 }', ["radius_m = -1", "is not above 0"]),
    ],
)
def test_faults_name_the_source_and_the_remedy(
    tmp_path: Path, source: str, parts: list[str]
) -> None:
    line = fault(tmp_path, source)
    for part in parts:
        assert part in line


# --- Files of depths: both conventions read the same; other files are refused in one line.


Writer = Callable[[Path, FloatArray, FloatArray, FloatArray], Path]

LON, LAT = np.arange(-2.0, 2.01, 0.1), np.arange(49.0, 51.01, 0.1)
HEIGHT = np.rint(np.add.outer(30 * (LAT - 50), 40 * LON) - 20)
HEIGHT[3:5, 6:9] = np.nan


@pytest.mark.parametrize("writer", [depth_grids.gebco, depth_grids.emodnet])
@pytest.mark.parametrize("turns", [-1, 0, 1])
def test_both_conventions_give_heights_in_the_longitudes_asked_for(
    tmp_path: Path, writer: Writer, turns: int
) -> None:
    found = DepthFile.open(writer(tmp_path / "grid.nc", LON, LAT, HEIGHT))
    heights = found.heights((-1.05 + 360 * turns, 49.25, 1.05 + 360 * turns, 50.55))
    assert heights is not None
    x, y = slice(10, 31), slice(3, 16)
    assert_allclose(heights.lon, LON[x] + 360 * turns, atol=1e-9)
    assert_allclose(heights.lat, LAT[y], atol=1e-9)
    assert_allclose(heights.height_m, HEIGHT[y, x], atol=0.006)
    assert np.isnan(heights.height_m).sum() == np.isnan(HEIGHT[y, x]).sum()
    assert found.title == "A sea floor made up for a test"


@pytest.mark.parametrize(
    ("name", "attributes", "sign"),
    [
        ("elevation", {}, 1.0),
        ("depth", {}, -1.0),
        ("depth", {"positive": "up"}, 1.0),
        ("depth", {"positive": "UP"}, 1.0),
        ("bathy", {"standard_name": "depth", "positive": "Up"}, 1.0),
        ("z", {"standard_name": "height_above_geoid"}, 1.0),
        ("z", {"standard_name": "height", "positive": "up"}, 1.0),
        ("Band1", {"positive": "down"}, -1.0),
        ("h", {"long_name": "bathymetry at RHO-points"}, -1.0),
        ("bathy", {"standard_name": "sea_floor_depth_below_geoid"}, -1.0),
        ("bathy", {"standard_name": "sea_floor_depth_below_sea_surface"}, -1.0),
        (
            "elevation",
            {
                "standard_name": "height_above_reference_ellipsoid",
                "long_name": "Elevation relative to sea level",
            },
            1.0,
        ),
    ],
)
def test_a_variable_is_found_by_its_standard_name_or_its_own(
    tmp_path: Path, name: str, attributes: dict[str, str], sign: float
) -> None:
    file = tmp_path / "grid.nc"
    depth_grids.dataset(LON, LAT, HEIGHT, name, units="m", **attributes).to_netcdf(file)
    heights = DepthFile.open(file).heights((-1.05, 49.25, 1.05, 50.55))
    assert heights is not None
    assert_allclose(heights.height_m, sign * HEIGHT[3:16, 10:31])


@pytest.mark.parametrize(
    ("name", "attributes", "parts"),
    [
        ("salinity", {"units": "1e-3"}, ["no depths among salinity (no standard name)", "GEBCO"]),
        ("elevation", {}, ["elevation has no unit", "say so", "other.nc,positive=up"]),
        ("Band1", {}, ["does not say whether it counts up", "other.nc,positive=up for heights"]),
        (
            "h",
            {"long_name": "layer thickness", "units": "m"},
            ["h does not say", "other.nc,positive=up", "positive=down"],
        ),
        ("elevation", {"units": "feet"}, ["elevation is in 'feet', not in m", "convert it"]),
        (
            "elevation",
            {"units": "m", "standard_name": "height_above_reference_ellipsoid"},
            ["no depths among elevation (height_above_reference_ellipsoid)"],
        ),
    ],
)
def test_what_has_no_depths_is_refused_with_what_was_found(
    tmp_path: Path, name: str, attributes: dict[str, str], parts: list[str]
) -> None:
    file = tmp_path / "other.nc"
    depth_grids.dataset(LON, LAT, HEIGHT, name, **attributes).to_netcdf(file)
    with pytest.raises(RequestError) as caught:
        DepthFile.open(file)
    (fault,) = caught.value.faults
    assert fault.startswith("chart.depths: other.nc: ")
    assert all(part in fault for part in parts), fault
    if "positive=" in fault:
        assert DepthFile.open(file, "up").sign == 1.0


def test_several_grids_are_refused_unless_one_has_the_usual_name(tmp_path: Path) -> None:
    both = depth_grids.dataset(LON, LAT, HEIGHT, "a", units="m", standard_name="height_above_geoid")
    both["b"] = both["a"]
    both.to_netcdf(tmp_path / "two.nc")
    with pytest.raises(RequestError, match=r"several grids of depths \(a .*, b .*\); keep one"):
        DepthFile.open(tmp_path / "two.nc")
    both.rename(b="elevation").to_netcdf(tmp_path / "named.nc")
    assert DepthFile.open(tmp_path / "named.nc").variable == "elevation"


def test_a_curvilinear_grid_text_and_damage_are_refused(tmp_path: Path) -> None:
    plain = depth_grids.dataset(LON, LAT, HEIGHT, "elevation", units="m")
    bent = plain.rename(lon="x", lat="y").drop_vars(["x", "y"])
    bent["longitude"] = (("y", "x"), np.broadcast_to(LON, HEIGHT.shape))
    bent.to_netcdf(tmp_path / "bent.nc")
    (tmp_path / "text.nc").write_text("no NetCDF at all")
    plain.to_netcdf(tmp_path / "cut.nc", format="NETCDF3_CLASSIC")
    whole = (tmp_path / "cut.nc").read_bytes()
    (tmp_path / "cut.nc").write_bytes(whole[: len(whole) // 2])
    for name, reason in (
        ("bent.nc", "nothing says at which longitude"),
        ("text.nc", "neither NetCDF, Zarr, GRIB nor S-100"),
        ("cut.nc", "bytes before its last value"),
        ("absent.nc", "does not exist"),
    ):
        with pytest.raises(RequestError, match=reason) as caught:
            DepthFile.open(tmp_path / name)
        assert len(caught.value.faults) == 1


def test_a_geotiff_is_refused_with_the_command_that_makes_netcdf_of_it(tmp_path: Path) -> None:
    if shutil.which("gdalwarp") is None:
        pytest.skip("GDAL's commands are not installed")
    heights = np.where(np.isnan(HEIGHT), -9999.0, HEIGHT)
    depth_grids.dataset(LON, LAT, heights, "elevation").to_netcdf(tmp_path / "0.nc")
    made = ["gdal_translate", "-q", "-a_srs", "EPSG:4326", "-a_nodata", "-9999", "0.nc", "1.tif"]
    subprocess.run(made, check=True, cwd=tmp_path)
    with pytest.raises(RequestError, match="convert it to NetCDF") as caught:
        DepthFile.open(tmp_path / "1.tif")
    (command,) = re.findall(r"`(.*?)`", str(caught.value))
    subprocess.run([*command.split(), "-q", "1.tif", "1.nc"], check=True, cwd=tmp_path)
    found = DepthFile.open(tmp_path / "1.nc", "up").heights((-180, -90, 180, 90))
    assert found is not None
    np.testing.assert_array_equal(np.isnan(found.height_m), np.isnan(HEIGHT))
    np.testing.assert_allclose(found.height_m, HEIGHT, atol=1e-3)


def test_of_curved_lines_the_highest_around_counts(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    i, j = np.meshgrid(np.arange(60), np.arange(50))
    lon, lat = -0.5 + 0.02 * (i - 0.4 * j), 49.6 + 0.012 * (j + 0.3 * i)
    depth = rng.uniform(5.0, 60.0, lon.shape)
    depth[20:24, 30:34] = np.nan
    about = {"units": "meter", "long_name": "bathymetry at RHO-points"}
    data = xr.Dataset({"h": (("eta_rho", "xi_rho"), depth, about)})
    data = data.assign(lon_rho=(("eta_rho", "xi_rho"), lon), lat_rho=(("eta_rho", "xi_rho"), lat))
    data.to_netcdf(tmp_path / "roms.nc")
    heights = DepthFile.open(tmp_path / "roms.nc").heights((-0.4, 49.75, 0.0, 50.0))
    assert heights is not None
    known = np.isfinite(heights.height_m)
    assert known.mean() > 0.9
    # No sounding is deeper in the table than in the file, at any node within half a cell.
    x, y = np.meshgrid(heights.lon, heights.lat)
    half = [np.diff(axis)[0] / 2 for axis in (heights.lon, heights.lat)]
    for at in zip(lon.ravel(), lat.ravel(), -depth.ravel(), strict=True):
        near = (np.abs(x - at[0]) <= half[0]) & (np.abs(y - at[1]) <= half[1])
        assert np.isnan(at[2]) or (heights.height_m[near] >= at[2]).all()
    assert np.nanmax(heights.height_m) <= np.nanmax(-depth)


def test_s102_is_read_with_its_own_datum(shared: Path) -> None:
    path = shared / "data" / "s100" / "noaa_s102_US004MI1CI.h5"
    found = DepthFile.open(path)
    assert (found.variable, found.sign, found.datum) == ("depth", -1.0, "MLLW")
    heights = found.heights((-83.165, 42.295, -83.15, 42.31))
    assert heights is not None
    with h5py.File(path) as file:
        stored = file["BathymetryCoverage/BathymetryCoverage.01/Group_001/values"][:]["depth"]
    with open_dataset(path) as data:
        read = data["depth"].values[0]
        assert np.array_equal(read, np.where(stored == 1e6, np.nan, stored), equal_nan=True)
    assert np.nanmax(heights.height_m) == pytest.approx(-stored.min())
    chart = ChartSpec(depths=str(path), datum="LAT")
    with pytest.raises(RequestError, match=r"--datum.*US004MI1CI\.h5 states MLLW"):
        land_source(chart, 2.0)


def test_too_many_cells_are_refused_and_a_region_without_cells_gives_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = DepthFile.open(depth_grids.gebco(tmp_path / "grid.nc", LON, LAT, HEIGHT))
    assert found.heights((10.0, 49.0, 11.0, 50.0)) is None
    monkeypatch.setattr(combined_charts, "_MAX_CELLS", 100)
    with pytest.raises(RequestError, match=r"21 x 41 cells in the region, more than 100; shrink"):
        found.heights((-3.0, 48.0, 3.0, 52.0))


# --- Shallow cells as polygons, which cover each cell and one cell around it, and no more.


CELL = 0.01


def grid(shallow: np.ndarray) -> Heights:
    """Return 2 m of depth where it is shallow, 50 m elsewhere."""
    ny, nx = shallow.shape
    height = np.where(shallow, -2.0, -50.0)
    lon, lat = (CELL * np.arange(size, dtype=np.float64) for size in (nx, ny))
    return Heights(10 + lon, 55 + lat, height)


@given(hnp.arrays(bool, st.tuples(st.integers(2, 12), st.integers(2, 12))))
def test_every_shallow_cell_is_covered_with_a_cell_around_and_no_deep_one_far_off(
    shallow: np.ndarray,
) -> None:
    heights = grid(shallow)
    polygons = shallow_polygons(heights, 5.0)
    assert shapely.is_valid(polygons).all()
    if not shallow.any():
        assert not len(polygons)
        return
    area = shapely.union_all(polygons)
    rows, columns = np.nonzero(shallow)
    x, y, half = heights.lon[columns], heights.lat[rows], CELL / 2
    cells = shapely.union_all(shapely.box(x - half, y - half, x + half, y + half))
    around = cells.buffer(0.999 * CELL, quad_segs=32)
    assert shapely.difference(around, area).area < 1e-12
    # The polygons cover nothing beyond the 3 x 3 cells around shallow ones.
    taken = ndimage.binary_dilation(shallow, np.ones((3, 3)))
    rows, columns = np.nonzero(~taken)
    if len(rows):
        centres = shapely.points(heights.lon[columns], heights.lat[rows])
        assert not shapely.intersects(area, centres).any()


def test_land_is_shallow_and_what_has_no_figure_is_not() -> None:
    heights = grid(np.zeros((5, 30), dtype=bool))
    heights.height_m[2, 4], heights.height_m[2, 14], heights.height_m[2, 24] = 100.0, np.nan, -5.0
    (land,) = shallow_polygons(heights, 5.0)
    assert land.contains(shapely.Point(heights.lon[4], heights.lat[2]))


def test_a_million_cells_take_less_than_two_seconds() -> None:
    rng = np.random.default_rng(1)
    noise = ndimage.gaussian_filter(rng.normal(size=(1000, 1000)), 4)
    begun = time.process_time()
    polygons = shallow_polygons(grid(noise > 0.02), 5.0)
    assert time.process_time() - begun < 2.0
    assert len(polygons) > 100


@pytest.mark.parametrize("safety_depth_m", [1.9, 2.0, 2.1])
def test_water_as_deep_as_is_needed_is_deep_enough(safety_depth_m: float) -> None:
    shallow = np.zeros((5, 5), dtype=bool)
    shallow[2, 2] = True
    assert len(shallow_polygons(grid(shallow), safety_depth_m)) == (safety_depth_m > 2.0)


# --- A chart with a grid of depths: what becomes no-go, what is noted, and what is refused.


REGION = shapely.box(-1.0, 49.5, 1.0, 50.5)
ISLAND = shapely.box(-0.2, 49.9, 0.2, 50.1)
STEP = 0.02
SOUNDED_LON, SOUNDED_LAT = np.arange(-1.5, 1.51, STEP), np.arange(49.0, 51.01, STEP)


@dataclass(frozen=True)
class Island:
    """One island, whatever the region."""

    identity: tuple[str, ...] = ("island",)

    def land(self, region: shapely.Polygon) -> Land:
        """Return the island."""
        del region
        return Land((ISLAND,), (Credit("an island", "land", "", ""),), 60.0)


def sea_floor() -> FloatArray:
    """Give 40 m of depth, the island 20 m high, and a shoal of 3 m in the south-east."""
    x, y = np.meshgrid(SOUNDED_LON, SOUNDED_LAT)
    height = np.full(x.shape, -40.0)
    height[(abs(x) <= 0.2) & (abs(y - 50) <= 0.1)] = 20.0
    height[(abs(x - 0.6) <= 0.05) & (abs(y - 49.7) <= 0.05)] = -3.0
    return height


def sounded(file: Path, safety_depth_m: float = 5.0) -> SoundedChart:
    return SoundedChart(Island(), DepthFile.open(file), DepthRule(safety_depth_m), "")


@pytest.mark.parametrize(
    ("of_cells", "of_grid", "of_both"),
    [
        ("MLLW", "", ""),
        ("MLLW", "LAT", "LAT and MLLW"),
        ("MLLW", "MLLW", "MLLW"),
        ("", "LAT", "LAT"),
    ],
)
def test_a_grid_beside_cells_does_not_take_their_datum(
    tmp_path: Path, of_cells: str, of_grid: str, of_both: str
) -> None:
    @dataclass(frozen=True)
    class Cells(Island):
        def land(self, region: shapely.Polygon) -> Land:
            return replace(super().land(region), datum=of_cells)

    file = depth_grids.emodnet(tmp_path / "grid.nc", SOUNDED_LON, SOUNDED_LAT, sea_floor())
    source = SoundedChart(Cells(), DepthFile.open(file), DepthRule(5.0), of_grid)
    assert source.land(REGION).datum == of_both


def test_shallow_water_joins_the_land_and_is_shown(tmp_path: Path) -> None:
    land = sounded(
        depth_grids.emodnet(tmp_path / "grid.nc", SOUNDED_LON, SOUNDED_LAT, sea_floor())
    ).land(REGION)
    no_go = shapely.union_all(land.polygons)
    assert no_go.contains(shapely.Point(0.6, 49.7))
    assert no_go.contains(ISLAND)
    assert no_go.area < ISLAND.buffer(2 * STEP).area + (0.1 + 4 * STEP) ** 2
    (zone,) = land.zones
    assert zone.kind == "shoal"
    assert zone.area.contains(shapely.Point(0.6, 49.7))
    assert shapely.intersection(zone.area, ISLAND).area == pytest.approx(0, abs=1e-12)
    assert [credit.name for credit in land.credits] == [
        "an island",
        "A sea floor made up for a test",
    ]
    assert "less than 5 m deep" in note_text(land.notes[0])
    assert "one cell of 2" in note_text(land.notes[0])  # 0.02 degrees: 2.2 km
    assert len(land.notes) == 1
    assert land.depths is not None
    assert land.depths.at(np.array([[0.6, 49.7], [0.0, 50.0], [5.0, 50.0]])).tolist() == [
        True,
        True,
        False,
    ]


def test_an_incomplete_grid_is_noted_and_its_gaps_stay_water(tmp_path: Path) -> None:
    floor = sea_floor()
    floor[:, SOUNDED_LON < -0.5] = np.nan
    south = SOUNDED_LAT < 50.3
    land = sounded(
        depth_grids.gebco(tmp_path / "grid.nc", SOUNDED_LON, SOUNDED_LAT[south], floor[south])
    ).land(REGION)
    x, y = 1 - 0.5 / 2, 0.8 / 1.0  # of the region's width and height
    assert f"has no depths for {1 - x * y:.0%}"[:-2] in note_text(land.notes[1])
    no_go = shapely.union_all(land.polygons)
    assert not no_go.intersects(shapely.box(-1.0, 49.5, -0.5, 50.5))
    assert land.depths is not None
    assert not land.depths.at(np.array([[-0.8, 50.0], [0.5, 50.4]])).any()


def test_a_grid_of_another_place_or_with_the_other_sign_is_refused(tmp_path: Path) -> None:
    file = depth_grids.gebco(tmp_path / "grid.nc", SOUNDED_LON, SOUNDED_LAT, sea_floor())
    with pytest.raises(RequestError, match=r"grid\.nc covers nothing of the region; give a grid"):
        sounded(file).land(shapely.box(10, 49.5, 12, 50.5))
    upside_down = depth_grids.gebco(tmp_path / "wrong.nc", SOUNDED_LON, SOUNDED_LAT, -sea_floor())
    with pytest.raises(RequestError, match=r"100% of the region's water lies above the sea.*up"):
        sounded(upside_down).land(REGION)


@pytest.mark.parametrize(
    ("lowest_m", "is_refused"),
    [(-32768.0, True), (-9999.0, True), (-999.0, True), (-99999.0, True), (-10_900.0, False)],
)
@pytest.mark.parametrize("sign", [1, -1])
def test_a_fill_value_that_is_not_declared_is_no_deep_water(
    tmp_path: Path, sign: int, lowest_m: float, *, is_refused: bool
) -> None:
    floor = sea_floor()
    floor[40:46, 40:46] = lowest_m
    data = depth_grids.dataset(
        SOUNDED_LON, SOUNDED_LAT, sign * floor, "elevation" if sign > 0 else "depth", units="m"
    )
    data.to_netcdf(file := tmp_path / "grid.nc")
    if not is_refused:
        assert sounded(file).land(REGION).polygons
        return
    with pytest.raises(RequestError, match=rf"`cdo setctomiss,{sign * lowest_m:g}`"):
        sounded(file).land(REGION)
    sounded(file).land(shapely.box(0.3, 49.6, 0.9, 50.4))  # which has none
    # A floor that falls to -999 m step by step is one.
    floor[40:46, 40:46] = np.linspace(-990.0, -999.0, 36).reshape(6, 6)
    data["elevation" if sign > 0 else "depth"].values[:] = sign * floor
    data.to_netcdf(deep := tmp_path / "deep.nc")
    assert sounded(deep).land(REGION).polygons


def test_the_identity_follows_the_file_and_the_depth(tmp_path: Path) -> None:
    file = depth_grids.gebco(tmp_path / "grid.nc", SOUNDED_LON, SOUNDED_LAT, sea_floor())
    first = sounded(file).identity
    assert first == sounded(file).identity
    assert first != sounded(file, 6.0).identity
    assert (
        first
        != sounded(depth_grids.gebco(file, SOUNDED_LON, SOUNDED_LAT, sea_floor() - 1)).identity
    )


def test_a_chart_with_depths_needs_a_draught(tmp_path: Path) -> None:
    file = depth_grids.gebco(tmp_path / "grid.nc", SOUNDED_LON, SOUNDED_LAT, sea_floor())
    chart = ChartSpec(depths=str(file), under_keel_clearance_m=1.5)
    with pytest.raises(RequestError, match=r"vessel\.draught_m is missing.*\(--draught\)"):
        land_source(chart, None)
    source = land_source(chart, 4.0)
    assert isinstance(source, SoundedChart)
    assert math.isclose(source.rule.safety_depth_m, 5.5)


def test_damaged_files_are_read_or_refused_with_one_line(tmp_path: Path) -> None:
    file = depth_grids.gebco(
        tmp_path / "grid.nc", SOUNDED_LON[::4], SOUNDED_LAT[::4], sea_floor()[::4, ::4]
    )
    with xr.open_dataset(file) as data:
        data.load().to_netcdf(tmp_path / "classic.nc", format="NETCDF3_CLASSIC")
    whole = (tmp_path / "classic.nc").read_bytes()
    rng = np.random.default_rng(20261122)
    outcomes = set()
    for _ in range(80):
        damaged = bytearray(whole)
        for _ in range(rng.integers(1, 6)):
            end = 1600 if rng.random() < 0.7 else len(whole)  # mostly in the header
            damaged[rng.integers(end)] = rng.integers(256)
        file.write_bytes(bytes(damaged))
        try:
            sounded(file).land(REGION)
        except RequestError as error:
            (fault,) = error.faults
            assert fault.startswith("chart.depths: ")
            assert "\n" not in fault
            outcomes.add("refused")
        else:
            outcomes.add("read")
    assert outcomes == {"read", "refused"}
