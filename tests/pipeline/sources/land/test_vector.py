"""Land from the user's files: the same in any format and CRS, and nothing is guessed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyogrio
import pyproj
import pytest
import shapely

from pipeline.errors import RequestError
from pipeline.findings.note_words import note_text, note_texts
from pipeline.scenario import catalogue
from pipeline.scenario.region import ChartSource, ChartSpec
from pipeline.sources.land.shapes import BEYOND_M
from pipeline.sources.land.vector import VectorFile
from pipeline.sources.registry import land_source

GEOD = pyproj.Geod(ellps="WGS84")
# Files of pyogrio's own tests: Natural Earth's countries, and curves.
FIXTURES = Path(pyogrio.__file__).parent / "tests" / "fixtures"
NATURAL_EARTH = FIXTURES / "naturalearth_lowres" / "naturalearth_lowres.shp"

REGION = shapely.box(118.0, 9.0, 120.0, 11.0)
LAKE = [(118.9, 9.9), (119.1, 9.9), (119.0, 10.1)]
ISLAND = shapely.Polygon([(118.6, 9.5), (119.4, 9.6), (119.3, 10.4), (118.7, 10.3)], [LAKE])
FIJI = shapely.box(177.0, -19.0, 183.0, -15.0)
ACROSS = shapely.Polygon([(179.0, -17.5), (181.2, -17.4), (181.0, -16.2), (179.1, -16.5)])


def write(
    path: Path,
    *geometries: shapely.Geometry,
    crs: str | None = "EPSG:4326",
    layer: str | None = None,
    append: bool = False,
) -> Path:
    """Write geometries to a file whose format its name says."""
    kinds = {geometry.geom_type + " Z" * geometry.has_z for geometry in geometries}
    pyogrio.raw.write(
        path,
        shapely.to_wkb(np.array(geometries, dtype=object)),
        field_data=[np.arange(len(geometries))],
        fields=["id"],
        geometry_type=kinds.pop() if len(kinds) == 1 else "Unknown",
        crs=crs,
        layer=layer,
        append=append,
    )
    return path


def in_crs(geometry: shapely.Geometry, crs: str) -> shapely.Geometry:
    """Project a geometry as another program would: its edges cut to about 100 m first."""
    there = pyproj.Transformer.from_crs(4326, crs, always_xy=True)
    fine = shapely.segmentize(geometry, 0.001)
    return shapely.transform(fine, lambda xy: np.column_stack(there.transform(*xy.T)))


def land(path: Path, region: shapely.Polygon = REGION, **options: object) -> shapely.Geometry:
    """Return the land of a file as one geometry."""
    source = ChartSource.model_validate({"path": str(path), **options})
    return shapely.union_all(VectorFile(path, source).land(region).polygons)


def difference_share(one: shapely.Geometry, other: shapely.Geometry) -> float:
    """Return the area that only one of two has, as a share of the second's."""
    return float(shapely.symmetric_difference(one, other).area / other.area)


@pytest.mark.parametrize("suffix", [".gpkg", ".geojson", ".shp", ".fgb"])
def test_any_format(tmp_path: Path, suffix: str) -> None:
    assert difference_share(land(write(tmp_path / f"land{suffix}", ISLAND)), ISLAND) < 1e-6


@pytest.mark.parametrize(
    "crs",
    ["EPSG:32651", "EPSG:3857", "EPSG:4253", "ESRI:54009", "EPSG:3123", "EPSG:2227", "EPSG:4807"],
)
def test_any_crs(tmp_path: Path, crs: str) -> None:
    region = REGION if crs != "EPSG:2227" else shapely.box(-122.6, 37.4, -122.0, 38.0)
    island = ISLAND if region is REGION else shapely.box(-122.5, 37.6, -122.3, 37.8)
    file = write(tmp_path / "land.gpkg", in_crs(island, crs), crs=crs)
    assert difference_share(land(file, region), island) < 1e-3


def test_edges_that_are_curved_in_degrees_are_cut(tmp_path: Path) -> None:
    # A straight edge of 200 km in Mercator is no straight line on a stereographic plane.
    corners = [(118.1, 9.1), (119.9, 9.1), (119.9, 10.9), (118.1, 10.9)]
    there = pyproj.Transformer.from_crs(4326, "EPSG:3995", always_xy=True)
    planar = shapely.Polygon([there.transform(*corner) for corner in corners])
    found = land(write(tmp_path / "arctic.gpkg", planar, crs="EPSG:3995"))
    middles = shapely.segmentize(planar, planar.length / 400)
    back = shapely.transform(
        middles,
        lambda xy: np.column_stack(there.transform(xy[:, 0], xy[:, 1], direction="INVERSE")),
    )
    assert difference_share(found, back) < 1e-5


@pytest.mark.parametrize("turn", [0.0, 360.0])
def test_longitudes_from_minus_180_or_from_0(tmp_path: Path, turn: float) -> None:
    island = shapely.box(-71.0, 9.5, -70.0, 10.5)
    file = write(tmp_path / "land.gpkg", shapely.affinity.translate(island, turn))
    for region_turn in (0.0, 360.0):
        region = shapely.affinity.translate(shapely.box(-72.0, 9.0, -69.0, 11.0), region_turn)
        there = shapely.affinity.translate(island, region_turn)
        assert difference_share(land(file, region), there) < 1e-9


def test_halves_on_both_sides_of_180_degrees_and_planes_across_it(tmp_path: Path) -> None:
    west = shapely.intersection(ACROSS, shapely.box(170, -20, 180, -10))
    east = shapely.affinity.translate(
        shapely.intersection(ACROSS, shapely.box(180, -20, 190, -10)), -360
    )
    halves = write(tmp_path / "halves.geojson", west, east)
    assert difference_share(land(halves, FIJI), ACROSS) < 1e-9
    plane = write(tmp_path / "fiji.gpkg", in_crs(ACROSS, "EPSG:3832"), crs="EPSG:3832")
    assert difference_share(land(plane, FIJI), ACROSS) < 1e-3
    there = shapely.affinity.translate(FIJI, -360)
    assert difference_share(land(plane, there), shapely.affinity.translate(ACROSS, -360)) < 1e-3


# Viti Levu's size across 180 degrees, not split there: longitudes to 180, and to 360.
UNSPLIT = [(179.8, -17.0), (-179.9, -17.0), (-179.9, -16.5), (179.8, -16.5)]
SPLIT = shapely.box(179.8, -17.0, 180.1, -16.5)


@pytest.mark.parametrize("winding", [1, -1])
@pytest.mark.parametrize("suffix", [".geojson", ".gpkg", ".shp"])
def test_an_area_across_180_degrees_that_is_not_split(
    tmp_path: Path, winding: int, suffix: str
) -> None:
    lake = [(179.95, -16.8), (-179.95, -16.8), (-179.95, -16.7), (179.95, -16.7)]
    # A Shapefile has the lake as another area, since it seems to lie outside.
    has_lake = suffix != ".shp"
    island = shapely.Polygon(UNSPLIT[::winding], [lake] * has_lake)
    right = SPLIT.difference(shapely.box(179.95, -16.8, 180.05, -16.7)) if has_lake else SPLIT
    # A small island beside it is near every one of these regions.
    others = [shapely.box(lon, -16.9, lon + 0.1, -16.8) for lon in (150.0, -0.05, 179.6)]
    file = write(tmp_path / f"land{suffix}", island, *others)
    for turn in (0, -360):
        region = shapely.affinity.translate(shapely.box(179.7, -17.2, 180.3, -16.0), turn)
        found = shapely.intersection(land(file, region), region)
        assert difference_share(found, shapely.affinity.translate(right, turn)) < 1e-9
    # The region may lie where the file's longitudes have no bounds.
    inside = land(file, shapely.box(180.02, -17.0, 180.04, -16.9))
    assert inside.covers(shapely.Point(180.03, -16.95))
    for elsewhere in others[:2]:
        assert difference_share(land(file, elsewhere), elsewhere) < 1e-9
    source = VectorFile(file, ChartSource(path=str(file)))
    notes = source.land(FIJI).notes
    said = "\n".join(note_texts([note for note in notes if note.is_decision]))
    assert f"land{suffix}: 1 part has an edge longer than 180 degrees" in said
    assert "180 degrees" not in "\n".join(note_texts(source.land(others[0]).notes))


def test_what_goes_round_the_earth_is_left_as_it_is(tmp_path: Path) -> None:
    ring = [(-180, -90), (180, -90), (180, -70), (60, -60), (-60, -65), (-180, -70)]
    around = write(tmp_path / "land.gpkg", shapely.Polygon(ring))
    for lon in (-170.0, 0.0, 100.0, 178.0):
        region = shapely.box(lon, -75.0, lon + 2, -72.0)
        assert land(around, region).covers(region)


def test_holes_are_kept_and_heights_dropped(tmp_path: Path) -> None:
    found = land(write(tmp_path / "land.gpkg", shapely.force_3d(ISLAND, 7.0)))
    assert not found.has_z
    assert not found.intersects(shapely.Point(119.0, 9.95))


def test_mainland_is_cut_near_the_region(tmp_path: Path) -> None:
    world = write(tmp_path / "world.gpkg", shapely.box(60, -60, 119, 80))
    west, south, east, north = land(world).bounds
    assert east == 119
    assert (south, north) == pytest.approx((9 - 0.18, 11 + 0.18), abs=0.01)
    _, _, beyond = GEOD.inv(west, 10, 118, 10)
    assert beyond == pytest.approx(BEYOND_M, rel=0.02)


def test_invalid_rings_are_repaired_and_reported(tmp_path: Path) -> None:
    bowtie = shapely.Polygon([(118.2, 9.2), (119.2, 10.2), (119.2, 9.2), (118.2, 10.2)])
    file = write(tmp_path / "land.gpkg", bowtie, ISLAND)
    found = VectorFile(file, ChartSource(path=str(file))).land(REGION)
    assert all(polygon.is_valid for polygon in found.polygons)
    assert shapely.union_all(found.polygons).covers(shapely.Point(118.3, 9.5))
    assert "land.gpkg: 1 area was invalid and was repaired" in note_text(found.notes[0])


def test_points_and_lines_need_a_radius(tmp_path: Path) -> None:
    rock, wall = shapely.Point(119.5, 10.5), shapely.LineString([(119.6, 9.2), (119.6, 9.3)])
    file = write(tmp_path / "marks.geojson", rock, wall, ISLAND)
    with pytest.raises(RequestError, match=r"1 points and 1 lines near.*radius_m = 20"):
        land(file)
    found = land(file, radius_m=30.0)
    area, _ = GEOD.geometry_area_perimeter(shapely.intersection(found, rock.buffer(0.01)))
    assert abs(area) == pytest.approx(np.pi * 30**2, rel=0.04)
    assert found.covers(wall)
    assert found.covers(ISLAND)


def test_a_layer_is_chosen_and_not_guessed(tmp_path: Path) -> None:
    file = write(tmp_path / "two.gpkg", ISLAND, layer="coast")
    write(file, shapely.box(118.1, 9.1, 118.2, 9.2), layer="piers", append=True)
    with pytest.raises(RequestError, match=r"2 layers with geometries \(coast, piers\); name one"):
        land(file)
    assert difference_share(land(file, layer="coast"), ISLAND) < 1e-9
    with pytest.raises(RequestError, match="no layer 'cost': did you mean 'coast'"):
        land(file, layer="cost")


def test_a_missing_crs_is_asked_for(tmp_path: Path) -> None:
    file = write(tmp_path / "land.shp", in_crs(ISLAND, "EPSG:32651"), crs="EPSG:32651")
    file.with_suffix(".prj").unlink()
    with pytest.raises(RequestError, match=r"does not give its CRS.*crs = "):
        land(file)
    assert difference_share(land(file, crs="EPSG:32651"), ISLAND) < 1e-3
    with pytest.raises(RequestError, match="pyproj does not know"):
        land(file, crs="EPSG:0")


def test_a_file_of_another_region_or_in_a_wrong_crs_is_refused(tmp_path: Path) -> None:
    file = write(tmp_path / "land.gpkg", ISLAND)
    with pytest.raises(RequestError, match=r"nothing near the region .*118\.6, 9\.5"):
        land(file, shapely.box(0, 0, 1, 1))
    metres = write(tmp_path / "metres.gpkg", in_crs(ISLAND, "EPSG:32651"))
    with pytest.raises(RequestError, match=r"impossible in its CRS \(WGS 84\).*right CRS"):
        land(metres)


@pytest.mark.parametrize("content", [b"", b"hello", b"SQLite format 3\x00"])
def test_no_vector_file_is_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "land.gpkg"
    file.write_bytes(content)
    with pytest.raises(RequestError, match=r"land\.gpkg can't be read"):
        land(file)


@pytest.mark.parametrize("name", ["curvepolygon", "multisurface"])
def test_curves_become_polygons(name: str) -> None:
    if not FIXTURES.is_dir():
        pytest.skip("needs pyogrio's own fixtures, which this build of it leaves out")
    file = FIXTURES / f"{name}.gpkg"
    bounds = pyogrio.read_info(file, force_total_bounds=True)["total_bounds"]
    region = shapely.box(*bounds).buffer(1.0)
    found = land(file, region, crs="EPSG:4326")
    assert found.area > 0
    assert found.is_valid


def test_natural_earth_by_its_entry() -> None:
    if not NATURAL_EARTH.is_file():
        pytest.skip("needs pyogrio's own fixtures, which this build of it leaves out")
    given = {"name": "natural-earth", "path": str(NATURAL_EARTH)}
    source = land_source(ChartSpec.model_validate({"source": given}), None)
    found = source.land(shapely.box(8, 36, 20, 46))
    (credit,) = found.credits
    assert (credit.text, credit.licence) == ("Made with Natural Earth", "Public domain")
    entry = catalogue.source("natural-earth")
    assert isinstance(entry, catalogue.VectorSpec)
    assert found.accuracy_m == entry.accuracy_m
    whole = shapely.union_all(found.polygons)
    for lon, lat, is_land in [(12.5, 42.5, True), (9.0, 40.0, True), (12.0, 40.0, False)]:
        assert whole.intersects(shapely.Point(lon, lat)) is is_land
    assert found.notes == ()


def test_an_accuracy_that_is_not_given_is_assumed_and_noted(tmp_path: Path) -> None:
    file = write(tmp_path / "land.gpkg", ISLAND)
    without = VectorFile(file, ChartSource(path=str(file))).land(REGION)
    assert without.accuracy_m == 50.0
    assert "assumed to be accurate to 50 m" in note_text(without.notes[0])
    given = VectorFile(file, ChartSource(path=str(file), accuracy_m=3.0)).land(REGION)
    assert (given.accuracy_m, given.notes) == (3.0, ())


def test_the_identity_follows_the_content_and_the_options(tmp_path: Path) -> None:
    file = write(tmp_path / "land.shp", ISLAND)
    first = VectorFile(file, ChartSource(path=str(file))).identity
    assert VectorFile(file, ChartSource(path=str(file))).identity == first
    assert VectorFile(file, ChartSource(path=str(file), radius_m=5.0)).identity != first
    file.with_suffix(".prj").write_text(pyproj.CRS("EPSG:4253").to_wkt("WKT1_ESRI"))
    assert VectorFile(file, ChartSource(path=str(file))).identity != first


def test_the_credit_is_the_users(tmp_path: Path) -> None:
    file = write(tmp_path / "land.gpkg", ISLAND)
    source = ChartSource(path=str(file), credit="© Harbour office", licence="CC BY 4.0")
    credit = VectorFile(file, source).credit
    assert (credit.text, credit.licence) == ("© Harbour office", "CC BY 4.0")


@pytest.mark.parametrize("column", ["NAME", "OBJNAM"])
def test_names_of_land_come_with_it(tmp_path: Path, column: str) -> None:
    """Of several areas with one name the largest keeps it; land without a name gets none."""
    small = shapely.box(118.1, 9.1, 118.2, 9.2)
    shapes = [shapely.MultiPolygon([small, ISLAND]), shapely.box(119.5, 9.0, 119.6, 9.1)]
    path = tmp_path / "land.gpkg"
    pyogrio.raw.write(
        path,
        shapely.to_wkb(np.array(shapes, dtype=object)),
        field_data=[np.array(["Isla  Larga", None], dtype=object)],
        fields=[column],
        geometry_type="Unknown",
        crs="EPSG:4326",
    )
    (place,) = VectorFile(path, ChartSource(path=str(path))).land(REGION).places
    assert place.name == "Isla Larga"
    assert ISLAND.contains(shapely.Point(place.lon, place.lat))
    assert place.area_deg2 == pytest.approx(ISLAND.area)


def test_names_of_a_real_file_lie_in_the_regions_longitudes() -> None:
    source = ChartSource(path=str(NATURAL_EARTH))
    places = {place.name: place for place in VectorFile(NATURAL_EARTH, source).land(FIJI).places}
    assert 177 < places["Fiji"].lon < 183
    assert -19 < places["Fiji"].lat < -15


def test_a_file_without_names_has_no_places(tmp_path: Path) -> None:
    path = write(tmp_path / "land.geojson", ISLAND)
    assert VectorFile(path, ChartSource(path=str(path))).land(REGION).places == ()
