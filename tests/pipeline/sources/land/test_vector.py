"""Land from the user's files: the same in any format and CRS, and nothing is guessed."""

import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pyproj
import pytest
import shapely

from pipeline.errors import RequestError
from pipeline.findings.note_words import note_text, note_texts
from pipeline.model import Land
from pipeline.scenario import catalogue
from pipeline.scenario.region import ChartSource, ChartSpec
from pipeline.sources.land.shapes import BEYOND_M
from pipeline.sources.land.vector import VectorFile
from pipeline.sources.registry import land_source
from tests.pipeline.sources import mutations
from tests.true_scale import GEOD

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
    with pytest.raises(RequestError, match=r"1 point and 1 line near.*radius_m = 20"):
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
    swapped = shapely.transform(ISLAND, lambda points: points[:, ::-1])
    with pytest.raises(RequestError, match="latitude stands before longitude"):
        land(write(tmp_path / "swapped.geojson", swapped))


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


# --- Damaged vector files are refused with one line that says what is wrong, where, and the remedy.


RING = [[118.6, 9.5], [119.4, 9.6], [119.3, 10.4], [118.7, 10.3], [118.6, 9.5]]
AREA = shapely.Polygon(RING).area


def read(path: Path | str, **options: object) -> Land:
    """Read a chart as a run does."""
    chart = ChartSpec.model_validate({"source": {"path": str(path), **options}})
    source = land_source(chart, 1.0)
    assert source.identity
    return source.land(REGION)


def refusal(path: Path | str, **options: object) -> str:
    """Return the only line with which a chart is refused."""
    with pytest.raises(RequestError) as caught:
        read(path, **options)
    (line,) = caught.value.faults
    return line


def geojson(folder: Path, *geometries: object) -> Path:
    """Write a GeoJSON file: a good polygon, then these geometries."""
    features = [
        {"type": "Feature", "properties": {}, "geometry": geometry}
        for geometry in (polygon(RING), *geometries)
    ]
    path = folder / "land.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}), "utf-8")
    return path


def polygon(*rings: object) -> dict[str, Any]:
    """Make a polygon as GeoJSON."""
    return {"type": "Polygon", "coordinates": list(rings)}


def nested(geometry: dict[str, Any], depth: int) -> dict[str, Any]:
    """Put a geometry into collections of collections."""
    for _ in range(depth):
        geometry = {"type": "GeometryCollection", "geometries": [geometry]}
    return geometry


def with_point(*point: object) -> dict[str, Any]:
    """Make a polygon with a point in place of its third."""
    return polygon([*RING[:2], list(point), *RING[3:]])


BAD: dict[str, tuple[object, list[str]]] = {
    "unclosed ring": (
        polygon(RING[:-1]),
        ["do not form a closed linestring", "feature 1, near 118.6, 9.5"],
    ),
    "unclosed hole": (
        polygon(RING, [[118.9, 9.9], [119.1, 9.9], [119.0, 10.1]]),
        ["do not form a closed linestring", "feature 1"],
    ),
    "ring of one point": (polygon(RING[:1]), ["can't be built", "feature 1, near 118.6, 9.5"]),
    "text as coordinates": (with_point("a", "b"), ["string for '\"b\"'", "in feature 1"]),
    "coordinates that are one text": (
        {"type": "Polygon", "coordinates": "here"},
        ["'\"here\"'", "in feature 1"],
    ),
    "a polygon as a multipolygon": (
        {"type": "MultiPolygon", "coordinates": [RING]},
        ["invalid Point", "in feature 1"],
    ),
    "unknown type": ({"type": "Circle", "coordinates": RING}, ["Unsupported geometry type"]),
    "NaN": (with_point(119.3, float("nan")), ["no finite number", "feature 1, near 118.6, 9.5"]),
    "infinite": (with_point(119.3, float("inf")), ["feature 1 lies in", "9.5 to inf"]),
    "far too large": (with_point(1e300, 10.4), ["impossible in its CRS (WGS 84)", "to 1e+300"]),
    "beyond a pole": (with_point(119.3, 91.0), ["impossible in its CRS", "9.5 to 91", "EPSG:"]),
    "all far too large": (polygon([[1e12, 1e12]] * 4), ["feature 1 lies in 1e+12 to 1e+12"]),
    "a point without a radius": (
        nested({"type": "Point", "coordinates": [119.8, 10.8]}, 4),
        ["1 point near the region", "radius_m"],
    ),
}


@pytest.mark.parametrize("kind", BAD)
def test_damaged_geometries_are_refused(tmp_path: Path, kind: str) -> None:
    geometry, parts = BAD[kind]
    line = refusal(geojson(tmp_path, geometry))
    for part in ("land.geojson", *parts):
        assert part in line
    assert re.search("correct|make polygons", line)


GOOD: dict[str, tuple[object, int]] = {
    "none": (None, 1),
    "an empty collection": ({"type": "GeometryCollection", "geometries": []}, 0),
    "a collection": (nested(polygon(RING), 3), 0),
    "heights": (polygon([[*point, 5.0] for point in RING]), 0),
    "some heights": (polygon([RING[0], [*RING[1], 5.0], *RING[2:]]), 0),
    "four numbers for a point": (polygon([[*point, 5.0, 6.0] for point in RING]), 1),
    "an empty ring": (polygon([]), 0),
}


@pytest.mark.parametrize("kind", GOOD)
def test_odd_but_valid_geometries_are_read(tmp_path: Path, kind: str) -> None:
    geometry, notes = GOOD[kind]
    land = read(geojson(tmp_path, geometry), accuracy_m=5)
    assert shapely.union_all(land.polygons).area == pytest.approx(AREA)
    assert not any(shapely.has_z(one) for one in land.polygons)
    assert len(land.notes) == notes, land.notes


def test_deep_collections_lose_nothing(tmp_path: Path) -> None:
    """A point below four collections is land as well, and so is a line of no length."""
    point = nested({"type": "Point", "coordinates": [119.8, 10.8]}, 4)
    line = {"type": "LineString", "coordinates": [[119.7, 9.2], [119.7, 9.2]]}
    land = shapely.union_all(read(geojson(tmp_path, point, line), radius_m=50).polygons)
    assert land.covers(shapely.MultiPoint([(119.8, 10.8), (119.7, 9.2)]))


@pytest.mark.parametrize(
    ("content", "part"),
    [
        ("", "can't be read"),
        ("{", "can't be read"),
        ('{"type": "FeatureCollection"}', "Missing 'features' member"),
        ('{"type": "FeatureCollection", "features": []}', "no feature with a geometry"),
        ("[" * 5000 + "]" * 5000, "can't be read"),
        ('{"type": "Polygon", "coordinates": [[[' + "9" * 5000, "can't be read"),
    ],
)
def test_files_without_land_are_refused(tmp_path: Path, content: str, part: str) -> None:
    path = tmp_path / "land.geojson"
    path.write_text(content, "utf-8")
    line = refusal(path)
    assert part in line
    assert len(line) < 600


@pytest.mark.parametrize("suffix", [".gpkg", ".shp", ".fgb", ".geojson"])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.5])
def test_truncated_files_are_refused(tmp_path: Path, suffix: str, share: float) -> None:
    file = mutations.make_charts(tmp_path, None)[suffix]
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    assert f"land{suffix}" in refusal(file)


def test_a_file_with_another_formats_name_is_read_by_its_content(tmp_path: Path) -> None:
    file = geojson(tmp_path)
    other = file.rename(tmp_path / "land.json")
    assert shapely.union_all(read(other).polygons).area == pytest.approx(AREA)
    renamed = mutations.make_charts(tmp_path, None)[".gpkg"].rename(tmp_path / "land.shp")
    assert len(read(renamed, radius_m=5).polygons) == 22


def test_an_attribute_table_alone_has_no_layer(tmp_path: Path) -> None:
    path = tmp_path / "land.gpkg"
    pyogrio.raw.write(path, None, field_data=[np.arange(3)], fields=["id"], geometry_type=None)
    assert "has no layer with geometries" in refusal(path)


def test_measured_coordinates_are_read(tmp_path: Path) -> None:
    path = tmp_path / "land.gpkg"
    text = "POLYGON M (({}))".format(", ".join(f"{x} {y} 7" for x, y in RING))
    wkb = [shapely.to_wkb(shapely.from_wkt(text), flavor="iso"), None]
    pyogrio.raw.write(
        path,
        np.array(wkb, dtype=object),
        field_data=[np.arange(2)],
        fields=["id"],
        geometry_type="Measured Polygon",
        crs="EPSG:4326",
    )
    with pytest.warns(UserWarning, match="Measured"):
        pyogrio.read_info(path)
    land = read(path, accuracy_m=5)
    assert shapely.union_all(land.polygons).area == pytest.approx(AREA)
    assert note_texts(land.notes) == ["land.gpkg: 1 feature has no geometry, and so no land"]


# --- what is no file ----------------------------------------------------------------------------


def test_a_sidecar_file_that_would_block_is_refused(tmp_path: Path) -> None:
    file = mutations.make_charts(tmp_path, None)[".shp"]
    file.with_suffix(".dbf").unlink()
    os.mkfifo(file.with_suffix(".dbf"))
    assert "land.dbf is a FIFO" in refusal(file)


def test_a_folder_without_cells_is_no_chart(tmp_path: Path) -> None:
    (tmp_path / "land.geojson").mkdir()
    assert "holds no S-57 cell" in refusal(tmp_path / "land.geojson")
    # Not the missing draught, which is no fault of a folder without depths.
    chart = ChartSpec.model_validate({"source": {"path": str(tmp_path)}})
    with pytest.raises(RequestError, match="holds no S-57 cell"):
        land_source(chart, None)


def test_files_that_may_not_be_read_are_refused(tmp_path: Path) -> None:
    file = geojson(tmp_path)
    file.chmod(0)
    if os.access(file, os.R_OK):
        pytest.skip("this user may read every file")
    assert "may not be read; allow it, as with `chmod +r`" in refusal(file)


def test_a_chart_whose_bytes_cannot_be_read() -> None:
    said = refusal("/proc/self/mem")
    assert "Input/output error" in said
    assert "export it again" in said
