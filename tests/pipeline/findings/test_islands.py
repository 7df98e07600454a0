"""Islands of the catalogue are found in a chart's land, and nothing else has their names."""

import csv

import numpy as np
import pytest
import shapely
from hypothesis import given, strategies as st
from scipy.sparse.csgraph import minimum_spanning_tree
from shapely.affinity import translate
from shapely.geometry import Polygon

import renew
from pipeline.findings.other_ways import narrow_gaps
from pipeline.findings.way_names import Island, island_places, islands
from pipeline.geo.projection import Projection
from pipeline.model import Water
from pipeline.scenario import catalogue
from tests import islands as known
from tests.strategies import examples

STILL = renew.UniformCurrent(0.0, 0.0)
JAMAICA = next(island for island in islands() if island.name == "Jamaica")
WEST, SOUTH, EAST, NORTH = JAMAICA.bounds
# Within the sea around Jamaica; the next land is 1.3 degrees from it.
AROUND = shapely.box(WEST - 0.5, SOUTH - 0.5, EAST + 0.5, NORTH + 0.5)


def drawn(island: Island) -> Polygon:
    """Draw an island as a diamond in its bounds."""
    west, south, east, north = island.bounds
    x, y = (west + east) / 2, (south + north) / 2
    return Polygon([(west, y), (x, north), (east, y), (x, south)])


def names(region: Polygon, *land: Polygon) -> dict[int, str]:
    """Names of land (lon/lat degrees) by its index, in a region that cuts it."""
    projection = Projection.for_region(region)
    clipped = [shapely.intersection(region, one) for one in land]
    plane = projection.geometry_to_plane(np.array(clipped, dtype=object))
    extent = projection.geometry_to_plane(region)
    water = Water(renew.Chart(extent, []), tuple(plane), projection)
    return {
        index: place.name
        for place in island_places(water)
        for index, one in enumerate(land)
        if shapely.contains_xy(one, place.lon, place.lat)
    }


def test_every_island_of_the_catalogue_is_on_the_globe_and_in_its_bounds() -> None:
    assert len(islands()) > 600
    for island in islands():
        west, south, east, north = island.bounds
        assert -90 <= south <= island.lat <= north <= 90, island
        assert -180 <= west <= island.lon <= east <= 190, island
        assert island.area_km2 >= 1


# A town on each of ten islands that people know.
TOWNS = {
    "Busuanga": (120.20, 12.00),
    "Samos": (26.943, 37.690),
    "Chios": (26.136, 38.368),
    "Kos": (27.29, 36.89),
    "Naxos": (25.52, 37.07),
    "Skye": (-6.19, 57.41),
    "Funen": (10.39, 55.40),
    "Okinawa": (127.98, 26.59),
    "Martinique": (-61.06, 14.61),
    "Guam": (144.79, 13.48),
}


def test_known_islands_are_where_their_towns_are() -> None:
    for name, (lon, lat) in TOWNS.items():
        around = [
            island
            for island in islands()
            if island.bounds[0] < lon < island.bounds[2]
            and island.bounds[1] < lat < island.bounds[3]
        ]
        assert min(around, key=lambda island: island.area_km2).name == name


def test_no_island_stands_twice_under_two_names() -> None:
    boxes = shapely.STRtree([shapely.box(*island.bounds) for island in islands()])
    one, other = boxes.query(boxes.geometries, "intersects")
    one, other = one[one < other], other[one < other]
    common = shapely.area(shapely.intersection(boxes.geometries[one], boxes.geometries[other]))
    both = shapely.area(boxes.geometries)[one] + shapely.area(boxes.geometries)[other] - common
    alike = [(islands()[a].name, islands()[b].name) for a, b in zip(one, other, strict=True)]
    found = {pair for pair, share in zip(alike, common / both, strict=True) if share > 0.35}
    assert found == {("Streymoy", "Eysturoy")}


@pytest.mark.slow
def test_the_table_is_what_its_script_makes_and_no_outline_has_another_name() -> None:
    land = shapely.STRtree(known.world())
    table = known.rows(land)
    with (catalogue.root() / "islands.csv").open(encoding="utf-8", newline="") as file:
        assert table == list(csv.DictReader(file))
    points = shapely.points([(float(row["lon"]), float(row["lat"])) for row in table])
    for name, town in TOWNS.items():
        near = land.geometries[land.query(shapely.Point(town), "dwithin", 0.02)]
        inside = shapely.contains(max(near, key=shapely.area), points)
        assert [row["name"] for row, is_in in zip(table, inside, strict=True) if is_in] == [name]
    with pytest.raises(ValueError, match="Samos: no land of 100 km2 at"):
        known.outline(land, "Samos", 26.82, 37.75, 100.0)


def test_an_island_has_its_name_and_an_islet_beside_it_has_not() -> None:
    islet = shapely.box(WEST + 0.05, NORTH - 0.05, WEST + 0.1, NORTH)
    assert names(AROUND, islet, drawn(JAMAICA)) == {1: "Jamaica"}
    assert names(AROUND, islet) == {}


@pytest.mark.parametrize("wider", [0.4, 2.0])
def test_other_land_around_its_point_has_no_islands_name(wider: float) -> None:
    """Land that is wider than the island, cut by the region or not: a continent."""
    assert names(AROUND, shapely.box(*AROUND.bounds).buffer(wider - 0.5)) == {}
    inland = shapely.box(WEST + 0.5, NORTH - 0.2, EAST + 0.5, NORTH + 0.5)
    assert names(inland, drawn(JAMAICA).buffer(wider)) == {}


def test_an_island_that_the_region_cuts_has_its_name_if_two_sides_agree() -> None:
    eastern = shapely.box(WEST + 1.4, SOUTH - 0.5, EAST + 0.5, NORTH + 0.5)
    assert not shapely.contains_xy(eastern, JAMAICA.lon, JAMAICA.lat)
    island = drawn(JAMAICA)
    x, y = shapely.get_coordinates(island.centroid)[0]
    blunt = shapely.union(island, shapely.box(x, SOUTH, x + 0.5, NORTH))
    assert names(eastern, blunt) == {0: "Jamaica"}
    corner = shapely.box(EAST - 0.05, SOUTH - 0.5, EAST + 0.5, y)
    assert names(corner, shapely.box(EAST - 0.3, SOUTH + 0.4, EAST, NORTH)) == {}


def test_of_two_pieces_that_may_be_an_island_neither_has_its_name() -> None:
    """The region cuts a bay's two shores apart, and the island's own point lies outside."""
    eastern = shapely.box(EAST - 0.3, SOUTH - 0.5, EAST + 0.5, NORTH + 0.5)
    pieces = [shapely.box(EAST - 0.4, low, EAST, low + 0.3) for low in (SOUTH, NORTH - 0.3)]
    assert len(names(eastern, *pieces)) == 0


def test_an_island_across_180_degrees_has_its_name_in_either_longitudes() -> None:
    taveuni = next(island for island in islands() if island.name == "Taveuni")
    west, south, east, north = taveuni.bounds
    assert west < 180 < east
    around = shapely.box(west - 0.5, south - 0.5, east + 0.5, north + 0.5)
    for turn in (0.0, -360.0):
        region, land = translate(around, turn), translate(drawn(taveuni), turn)
        assert names(region, land) == {0: "Taveuni"}


# --- Bottlenecks between islands, beside a minimum spanning tree of all distances between them ---


def discs(seed: int, count: int = 25) -> np.ndarray:
    """Return islands in a square of 100 m, some of which overlap."""
    rng = np.random.default_rng(seed)
    places = shapely.points(rng.uniform(0, 100, (count, 2)))
    return np.asarray(shapely.buffer(places, rng.uniform(0.5, 6, count), quad_segs=12))


def width(line: np.ndarray) -> float:
    return float(np.linalg.norm(line[1] - line[0]))


@examples(30, 100)
@given(st.integers(0, 10_000))
def test_the_gaps_are_those_of_a_minimum_spanning_tree(seed: int) -> None:
    bodies = shapely.get_parts(shapely.union_all(discs(seed)))
    tree = minimum_spanning_tree(shapely.distance(bodies[:, None].copy(), bodies)).data
    widest = 9.0
    found = narrow_gaps(discs(seed), widest, lambda _: True)
    widths = [width(line) for line, _ in found]
    assert widths == pytest.approx(sorted(tree[tree <= widest]), abs=1e-9)
    for line, _ in found:
        apart = shapely.distance(bodies[:, None], shapely.points(line)).min(axis=0)
        assert apart == pytest.approx([0, 0], abs=1e-9)


def test_a_rock_in_a_strait_leaves_the_wider_side_as_the_strait() -> None:
    west, east, rock = (
        shapely.box(0, 0, 10, 100),
        shapely.box(20, 0, 60, 100),
        shapely.box(13, 50, 14, 51),
    )
    (first, rock_m), (second, west_m) = narrow_gaps(
        np.array([west, rock, east]), 50.0, lambda _: True
    )
    assert (width(first), width(second)) == (3.0, 6.0)
    assert rock_m == pytest.approx(np.hypot(1, 1))
    assert west_m == pytest.approx(np.hypot(14, 100))


def test_an_open_gap_joins_nothing() -> None:
    islands = shapely.box([0, 12, 25], 0, [10, 22, 35], 10)
    found = narrow_gaps(islands, 5.0, lambda line: bool(abs(line[0, 0] - 10) > 0.1))
    assert [width(line) for line, _ in found] == [3.0]
    assert narrow_gaps(np.empty(0, dtype=object), 5.0, lambda _: True) == []
