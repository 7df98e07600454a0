"""No-go zones from S-57 cells, and voyages on them."""

import json
import shutil
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyogrio
import pyproj
import pytest
import shapely
from typer.testing import CliRunner

from pipeline.cli.main import app
from pipeline.errors import RequestError
from pipeline.findings.note_words import note_texts
from pipeline.geo.projection import Projection
from pipeline.model import Land
from pipeline.model.inputs import NOT_KNOWN, DepthRule
from pipeline.run import Outcome, run
from pipeline.scenario.loading import load_scenario
from pipeline.scenario.region import ChartSource, ChartSpec
from pipeline.sources.land import s57
from pipeline.sources.land.s57 import Cell, Objects, S57Chart, base_files, find_cells, read_cell
from pipeline.sources.registry import land_source
from pipeline.stages.lanes import against_lanes
from pipeline.voyage.one_line import go
from tests.pipeline.results import rows_of
from tests.true_scale import GEOD, clearance_m

BOSTON = shapely.box(-71.02, 42.305, -70.955, 42.37)
RULE = DepthRule(2.0)
# A synthetic harbour, a hundredth of a degree wide, at 1:10,000.
HARBOUR = shapely.box(0.0, 0.0, 0.01, 0.01)
AROUND = shapely.box(-0.01, -0.01, 0.02, 0.02)


@pytest.fixture(scope="module")
def cells(shared: Path) -> Path:
    """Give the folder of real cells; skip where it is absent."""
    folder = shared / "data" / "charts"
    if not folder.is_dir():
        pytest.skip("needs ../shared/data/charts (two NOAA cells), which is not here")
    return folder


@pytest.fixture(scope="module")
def harbour(cells: Path) -> Land:
    """Give the no-go areas of Boston harbour for a safety depth of 2 m."""
    return S57Chart(cells, RULE).land(BOSTON)


@pytest.fixture
def boston(cells: Path, tmp_path: Path) -> Path:
    """Give a copy of the Boston cell and its five updates, to be damaged."""
    for file in cells.glob("US5BOSCD.*"):
        shutil.copyfile(file, tmp_path / file.name)
    return tmp_path


def objects(*geometries: shapely.Geometry, **columns: object) -> Objects:
    """Objects of one class; an attribute is one value for all, or a list."""
    array = np.array(geometries, dtype=object)
    values = {
        name: np.array(value if isinstance(value, list) else [value] * len(array), dtype=object)
        for name, value in columns.items()
    }
    return Objects(array, values)


def cell(
    classes: dict[str, Objects] | None = None, name: str = "XX5TEST", scale: int = 10_000
) -> Cell:
    """Make a cell over the harbour, 5 m deep unless other classes are given."""
    given = {"DEPARE": objects(HARBOUR, DRVAL1=5.0), **(classes or {})}
    return Cell(name, "1", "0", "2026-01-01", scale, HARBOUR, given)


def no_go(*given: Cell, rule: DepthRule = RULE) -> shapely.Geometry:
    """Return the no-go area of cells inside the harbour."""
    land = s57.land(given, AROUND, HARBOUR, rule)
    return shapely.intersection(shapely.union_all(land.polygons), HARBOUR)


def layer(base: Path, name: str, column: str) -> tuple[npt.NDArray[np.object_], np.ndarray]:
    """Read a layer by GDAL, unchanged: geometries, and one column."""
    meta, _, wkb, data = pyogrio.raw.read(
        base, layer=name, SPLIT_MULTIPOINT="ON", ADD_SOUNDG_DEPTH="ON"
    )
    return shapely.from_wkb(wkb), data[list(meta["fields"]).index(column)]


@pytest.mark.parametrize(
    ("name", "depth_m"), [("US5BOSCD", 2.0), pytest.param("US4MD81M", 3.0, marks=pytest.mark.slow)]
)
def test_no_sounding_in_the_water_is_shallower_than_the_safety_depth(
    cells: Path, name: str, depth_m: float
) -> None:
    points, depths = layer(cells / f"{name}.000", "SOUNDG", "DEPTH")
    region = shapely.box(*shapely.total_bounds(points))
    land = S57Chart(cells / f"{name}.000", DepthRule(depth_m)).land(region)
    water = shapely.difference(region, shapely.union_all(land.polygons))
    inside = shapely.intersects(water, shapely.force_2d(points))
    assert inside.sum() > 100
    assert depths[inside].min() >= depth_m
    # And deep water is not no-go: most deep soundings lie in the water.
    assert inside[depths > depth_m + 1].mean() > 0.85


def test_rocks_wrecks_and_marks_are_no_go(cells: Path, harbour: Land) -> None:
    no_go_area = shapely.union_all(harbour.polygons)
    for name in ("UWTROC", "OBSTRN", "WRECKS", "BOYLAT", "BCNLAT", "PILPNT", "LNDARE"):
        geometry, _ = layer(cells / "US5BOSCD.000", name, "OBJNAM" if name != "UWTROC" else "RCID")
        if name in {"UWTROC", "OBSTRN", "WRECKS"}:
            _, depth = layer(cells / "US5BOSCD.000", name, "VALSOU")
            geometry = geometry[~(depth.astype(float) >= RULE.safety_depth_m)]
        there = geometry[shapely.intersects(geometry, BOSTON)]
        assert len(there) > 0, name
        points = there[shapely.get_dimensions(there) == 0]
        assert shapely.covers(no_go_area, points).all(), name
        assert shapely.area(shapely.difference(there, no_go_area)).max() < 1e-12, name


def test_the_credit_names_the_newest_update(harbour: Land) -> None:
    (credit,) = harbour.credits
    assert "US5BOSCD (1:12,000) edition 4, update 5, issued 2026-01-08" in credit.text
    assert "not for navigation" in credit.text
    assert "US4MD81M" not in credit.text, "Chesapeake Bay is elsewhere"


def test_accuracy_and_restrictions_are_the_cells_own(cells: Path, harbour: Land) -> None:
    assert harbour.accuracy_m == 6.0
    names = {zone.name for zone in harbour.zones if zone.kind == "restricted"}
    assert "Right Whale Critical Habitat" in names
    areas, codes = layer(cells / "US4MD81M.000", "RESARE", "RESTRN")
    prohibited = next(area for area, code in zip(areas, codes, strict=True) if "'7'" in str(code))
    bay = S57Chart(cells, RULE).land(prohibited.centroid.buffer(0.01))
    assert bay.accuracy_m == 40.0
    assert "entry prohibited" in {zone.rule for zone in bay.zones}
    assert any("entry is prohibited" in note for note in note_texts(bay.notes))


def test_what_no_cell_covers_is_no_go_and_noted(cells: Path) -> None:
    west = shapely.box(-71.06, 42.31, -70.99, 42.36)
    source = land_source(
        ChartSpec.model_validate({"source": str(cells), "under_keel_clearance_m": 1.0}), 1.0
    )
    land = source.land(west)
    blank = shapely.union_all([z.area for z in land.zones if z.kind == "uncharted"])
    assert blank.contains(shapely.Point(-71.04, 42.33))
    assert shapely.union_all(land.polygons).contains(shapely.Point(-71.04, 42.33))
    assert "no S-57 cell covers 50.0% of the region: it is no-go" in note_texts(land.notes)


def test_a_region_without_any_cell_is_refused(cells: Path) -> None:
    with pytest.raises(RequestError, match=r"covers any of the region.*US5BOSCD"):
        S57Chart(cells, RULE).land(shapely.box(10, 50, 11, 51))


def test_a_deeper_draught_leaves_less_water(cells: Path, harbour: Land) -> None:
    areas = [
        shapely.union_all(land.polygons).intersection(BOSTON).area
        for land in (harbour, S57Chart(cells, DepthRule(10.0)).land(BOSTON))
    ]
    assert areas[-1] > 1.2 * areas[0]


def test_longitudes_may_be_a_turn_further(cells: Path, harbour: Land) -> None:
    there = S57Chart(cells, RULE).land(shapely.affinity.translate(BOSTON, 360))
    one, two = (shapely.union_all(land.polygons) for land in (harbour, there))
    assert two.area == pytest.approx(one.area, rel=1e-6)
    assert two.bounds[0] == pytest.approx(one.bounds[0] + 360)


def test_a_missing_update_is_refused(boston: Path) -> None:
    (boston / "US5BOSCD.003").unlink()
    with pytest.raises(RequestError, match=r"update \.005 is there.*\.003 is missing"):
        S57Chart(boston, RULE).land(BOSTON)


def test_updates_of_another_edition_are_named_and_may_be_removed(boston: Path) -> None:
    base = boston / "US5BOSCD.000"
    old = base.read_bytes()
    at = old.index(b"US5BOSCD.000\x1f4\x1f") + len(b"US5BOSCD.000\x1f")
    base.write_bytes(old[:at] + b"5" + old[at + 1 :])
    with pytest.raises(RequestError, match=r"of edition 5, and the updates \.001, .*edition 4;"):
        S57Chart(boston, RULE).land(BOSTON)
    for update in boston.glob("US5BOSCD.00[1-5]"):
        update.unlink()
    assert S57Chart(boston, RULE).land(BOSTON).polygons


def test_a_cancelled_cell_is_refused(boston: Path) -> None:
    # S-57 3.1, B.1, 5.7: the cancelling update has the data set's general information alone, with
    # the edition 0.
    last = (boston / "US5BOSCD.005").read_bytes()
    head = int(last[:5])
    body = head + int(last[head + 12 : head + 17])
    general = last[body:].split(b"\x1e")[1].replace(b"\x1f4\x1f5\x1f", b"\x1f0\x1f6\x1f")
    fields = (
        (b"0001", b"\x01\x00\x1e"),
        (b"DSID", general.replace(b"SCD.005", b"SCD.006") + b"\x1e"),
    )
    entries, at = b"", 0
    for tag, content in fields:
        entries += tag + f"{len(content):03d}{at:03d}".encode()
        at += len(content)
    start = 24 + len(entries) + 1
    leader = f"{start + at:05d} D     {start:05d}   3304".encode()
    record = leader + entries + b"\x1e" + b"".join(content for _, content in fields)
    (boston / "US5BOSCD.006").write_bytes(last[:head] + record)
    with pytest.raises(RequestError, match=r"^US5BOSCD\.000: the cell is cancelled"):
        S57Chart(boston, RULE).land(BOSTON)


@pytest.mark.parametrize("suffix", [".000", ".002"])
def test_a_truncated_cell_is_refused(boston: Path, suffix: str) -> None:
    file = boston / f"US5BOSCD{suffix}"
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(RequestError, match=r"US5BOSCD\.000 can't be read.*fetch the cell"):
        S57Chart(boston, RULE).land(BOSTON)


def test_an_update_changes_the_identity(boston: Path) -> None:
    before = S57Chart(boston, RULE).identity
    (boston / "US5BOSCD.005").unlink()
    assert S57Chart(boston, RULE).identity != before
    assert S57Chart(boston, DepthRule(3.0)).identity != S57Chart(boston, RULE).identity


def test_no_cell_and_repeated_cells_are_refused(boston: Path, tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(RequestError, match="no S-57 cell"):
        S57Chart(empty, RULE).land(BOSTON)
    again = boston / "again"
    again.mkdir()
    shutil.copyfile(boston / "US5BOSCD.000", again / "US5BOSCD.000")
    with pytest.raises(RequestError, match="cell US5BOSCD is there more than once"):
        S57Chart(boston, RULE).land(BOSTON)


def test_updates_without_their_cell_beside_them_are_refused(boston: Path) -> None:
    (update,) = boston.glob("US5BOSCD.005")
    assert base_files(update) == (boston / "US5BOSCD.000",)
    assert ChartSource(path=str(update)).is_s57
    assert not ChartSource(path="harbour_v1.2").is_s57
    (boston / "5").mkdir()
    update.rename(boston / "5" / update.name)
    with pytest.raises(RequestError, match="cells are not beside them, of US5BOSCD: put"):
        find_cells(boston)
    with pytest.raises(RequestError, match=r"5/US5BOSCD\.000 does not exist"):
        find_cells(boston / "5" / update.name)


def test_cells_are_found_below_the_folder(boston: Path) -> None:
    below = boston / "ENC_ROOT" / "US5BOSCD"
    below.mkdir(parents=True)
    for file in boston.glob("US5BOSCD.*"):
        file.rename(below / file.name)
    assert [base.name for base in base_files(boston)] == ["US5BOSCD.000"]
    assert read_cell(base_files(boston)[0], BOSTON, ["DEPARE"]) is not None
    assert read_cell(base_files(boston)[0], shapely.box(10, 50, 11, 51), ["DEPARE"]) is None


def test_depths_need_a_draught(cells: Path) -> None:
    with pytest.raises(RequestError, match=r"vessel\.draught_m is missing"):
        land_source(ChartSpec.model_validate({"source": str(cells)}), None)
    chart = ChartSpec.model_validate({"source": str(cells), "under_keel_clearance_m": 0.5})
    assert any("safety_depth_m=1.4," in part for part in land_source(chart, 0.9).identity)


def test_only_water_known_to_be_deep_enough_is_water() -> None:
    left, middle, right = (shapely.box(x, 0, x + 0.0025, 0.01) for x in (0, 0.0025, 0.005))
    depths = objects(left, middle, right, DRVAL1=[1.9, 2.0, None])
    found = no_go(cell({"DEPARE": depths}))
    assert found.equals(HARBOUR.difference(middle)), "shallow, unknown and unsurveyed are no-go"


def test_depth_areas_are_kept_with_both_limits(harbour: Land) -> None:
    limits = {(one.kind, one.least_m, one.greatest_m) for one in harbour.depth_areas}
    # As the cell has them: the dredged main channel, and flats that dry by up to 3.2 m.
    assert any(kind == "dredged" and least > 9 for kind, least, _ in limits)
    assert any(kind == "natural" and least < 0 <= greatest for kind, least, greatest in limits)
    deep = shapely.union_all(
        [one.area for one in harbour.depth_areas if one.least_m >= RULE.safety_depth_m]
    )
    no_go = shapely.union_all(harbour.polygons)
    water = BOSTON.difference(no_go)
    assert water.difference(deep).area < 1e-9 * BOSTON.area
    assert all(one.area.area > 0 for one in harbour.depth_areas)


def test_where_depth_areas_overlap_the_shallower_counts() -> None:
    shoal = shapely.box(0.002, 0.002, 0.004, 0.004)
    assert no_go(cell({"DRGARE": objects(shoal, DRVAL1=1.0)})).equals(shoal)


@pytest.mark.parametrize("name", ["OBSTRN", "WRECKS", "UWTROC"])
@pytest.mark.parametrize(
    ("depth", "is_no_go"), [(None, True), (1.9, True), (-0.5, True), (2.0, False)]
)
def test_sunken_objects_are_no_go_unless_known_to_be_deep(
    name: str, depth: float | None, *, is_no_go: bool
) -> None:
    at = shapely.Point(0.005, 0.005)
    found = no_go(cell({name: objects(at, VALSOU=depth)}))
    assert (not found.is_empty) is is_no_go
    if is_no_go:
        # At least 10 m around the point: half a millimetre of 1:10,000 is less.
        corners = shapely.get_coordinates(found)
        _, _, apart = GEOD.inv(*np.broadcast_to(at.coords[0], corners.shape).T, *corners.T)
        assert 10.0 <= apart.min() < apart.max() < 10.5
        edge = shapely.get_coordinates(shapely.segmentize(found.exterior, 1e-6))
        _, _, apart = GEOD.inv(*np.broadcast_to(at.coords[0], edge.shape).T, *edge.T)
        assert apart.min() >= 10.0 - 1e-3


@pytest.mark.parametrize(
    ("name", "scale", "radius_m"),
    [
        ("PILPNT", 10_000, 10),
        ("BCNLAT", 80_000, 40),
        ("BOYSPP", 10_000, 25),
        ("LNDARE", 50_000, 25),
        ("LNDMRK", 50_000, 25),  # a wind turbine
    ],
)
def test_points_are_as_wide_as_the_chart_draws_them(name: str, scale: int, radius_m: float) -> None:
    found = no_go(cell({name: objects(shapely.Point(0.005, 0.005))}, scale=scale))
    area, _ = GEOD.geometry_area_perimeter(found)
    assert abs(area) == pytest.approx(np.pi * radius_m**2, rel=0.04)
    assert abs(area) > np.pi * radius_m**2


def test_lines_in_the_water_are_no_go_and_those_on_its_edge_add_nothing() -> None:
    wall = shapely.LineString([(0.002, 0.005), (0.008, 0.005)])
    assert no_go(cell({"SLCONS": objects(wall)})).covers(wall)
    land = shapely.box(0, 0, 0.01, 0.002)
    water = shapely.box(0, 0.002, 0.01, 0.01)
    shore = shapely.LineString([(0, 0.002), (0.004, 0.002), (0.01, 0.002)])
    quay = cell(
        {"DEPARE": objects(water, DRVAL1=5.0), "LNDARE": objects(land), "COALNE": objects(shore)}
    )
    assert no_go(quay).equals(land)


def test_the_larger_scale_takes_precedence_where_cells_overlap() -> None:
    rock = objects(shapely.Point(0.002, 0.005), VALSOU=None)
    west = shapely.box(0, 0, 0.005, 0.01)
    shoal = objects(HARBOUR, DRVAL1=0.0)
    coarse = cell({"DEPARE": shoal, "UWTROC": rock}, "XX4COARSE", 50_000)
    fine = Cell(
        "XX5FINE", "1", "0", "2020-01-01", 10_000, west, {"DEPARE": objects(west, DRVAL1=5.0)}
    )
    for order in ((coarse, fine), (fine, coarse)):
        land = s57.land(order, AROUND, HARBOUR, RULE)
        found = shapely.intersection(shapely.union_all(land.polygons), HARBOUR)
        assert found.equals(HARBOUR.difference(west)), "hidden by the larger scale"
        assert land.accuracy_m == 25.0


def test_of_cells_of_one_scale_the_later_issue_takes_precedence() -> None:
    old = Cell(
        "XX5OLD", "1", "0", "2019-01-01", 10_000, HARBOUR, {"DEPARE": objects(HARBOUR, DRVAL1=0.0)}
    )
    assert no_go(old, cell()).is_empty


def test_poor_surveys_are_noted() -> None:
    east = shapely.box(0.005, 0, 0.01, 0.01)
    land = s57.land([cell({"M_QUAL": objects(east, CATZOC=5.0)})], AROUND, HARBOUR, RULE)
    assert any("50% of the water is charted from poor" in note for note in note_texts(land.notes))


def test_traffic_lanes_are_zones_but_not_no_go() -> None:
    lane = objects(shapely.box(0.002, 0, 0.004, 0.01), OBJNAM="", RESTRN="")
    given = cell({"TSSLPT": lane})
    assert no_go(given).is_empty
    zones = s57.land([given], AROUND, HARBOUR, RULE).zones
    assert [z.name for z in zones if z.kind == "traffic"] == ["traffic lane"]


def test_an_area_that_may_not_be_entered_is_named_whatever_its_class() -> None:
    box = shapely.box(0.002, 0, 0.004, 0.01)
    farm, cables = objects(box, OBJNAM="", RESTRN="7"), objects(box, OBJNAM="", RESTRN="2,6")
    land = s57.land([cell({"OSPARE": farm, "CBLARE": cables})], AROUND, HARBOUR, RULE)
    assert [(z.name, z.rule) for z in land.zones if z.kind == "restricted"] == [
        ("offshore production area", "entry prohibited")
    ]
    (told,) = note_texts(note for note in land.notes if note.kind in NOT_KNOWN)
    assert told.endswith("or to be avoided: offshore production area")


def test_bridges_and_cables_over_the_water_are_counted() -> None:
    ashore, across = (
        shapely.LineString([(0.02, 0), (0.03, 0)]),
        shapely.LineString([(0, 0), (1, 1)]),
    )
    given = cell({"BRIDGE": objects(ashore, across), "CBLOHD": objects(across)})
    assert no_go(given).is_empty
    # A kind that is not known is told in the files for plotters, too.
    notes = s57.land([given], AROUND, HARBOUR, RULE).notes
    (told,) = note_texts(note for note in notes if note.kind in NOT_KNOWN)
    assert told.startswith("2 bridges and cables cross the water of the chart: whether")


def test_a_bridge_is_told_once_in_the_notes_and_in_the_files(cells: Path, tmp_path: Path) -> None:
    outcome = go(
        "42.348N 71.018W", "42.34N 71.005W", speed="6kn", length="7m", turning_circle="30m",
        draught="1m", charts=cells / "US5BOSCD.000", currents=("still",), output=tmp_path, name="b",
    )  # fmt: skip
    texts = note_texts(outcome.fetched.notes)
    assert len(texts) == len({*texts})
    (told,) = (text for text in texts if "passes below" in text)
    manifest = json.loads((outcome.directory / "manifest.json").read_bytes())
    assert manifest["unknown"].count(told) == 1
    assert told in (outcome.directory / "b-still.rtz").read_text("utf-8")


def test_a_planted_lane_has_its_course_and_who_sails_against_it_is_told() -> None:
    """A lane of 500 m to the north, beside one to the south, in a harbour of a kilometre."""
    lanes = objects(
        shapely.box(0.002, 0.002, 0.004, 0.008), shapely.box(0.006, 0.002, 0.008, 0.008),
        OBJNAM=["up", "down"], RESTRN="", ORIENT=[0.0, 180.0],
    )  # fmt: skip
    zones = s57.land([cell({"TSSLPT": lanes})], AROUND, HARBOUR, RULE).zones
    assert [z.course_deg for z in zones if z.kind == "traffic"] == [0.0, 180.0]

    def told(*line: tuple[float, float]) -> list[tuple[str, float]]:
        return [(one.zone.name, one.length_m) for one in against_lanes(np.array(line), zones)]

    up, down = ((0.003, 0.0), (0.003, 0.01)), ((0.007, 0.01), (0.007, 0.0))
    length_m = GEOD.inv(0.003, 0.002, 0.003, 0.008)[2]
    assert told(*up) == told(*down) == []
    for name, line in (("up", up), ("down", down)):
        ((lane, against_m),) = told(*line[::-1])
        assert lane == name
        assert against_m == pytest.approx(length_m, rel=1e-6)
    # Across both, and around through both with the traffic.
    assert told((0.0, 0.004), (0.01, 0.006)) == told((0.01, 0.006), (0.0, 0.004)) == []
    assert told(*up, *down) == []
    (found,) = against_lanes(np.array(up[::-1]), zones)
    assert (found.place.x, found.place.y) == pytest.approx((0.003, 0.005))


@pytest.mark.parametrize("turn", [0.0, 17.3, 45.0, 80.1])
def test_there_is_no_barrier_where_cells_of_two_scales_meet(turn: float) -> None:
    # A seam at any angle; corners are rounded as in cells, and some vertices are in one cell only.
    corner = shapely.affinity.rotate(shapely.box(0.0, 0.0, 0.02, 0.02), turn, origin=(0.004, 0.003))
    west = shapely.set_precision(shapely.intersection(corner, HARBOUR), 1e-7)
    north, south = (
        shapely.set_precision(shapely.intersection(west, shapely.box(-1, low, 1, low + 1)), 1e-7)
        for low in (0.0061234, 0.0061234 - 1)
    )
    deep = objects(north, south, DRVAL1=5.0)
    fine = Cell("XX5FINE", "1", "0", "2026-01-01", 10_000, west, {"DEPARE": deep})
    assert no_go(cell(scale=50_000), fine).area < 1e-20


def test_there_is_no_barrier_between_neighbouring_cells() -> None:
    halves = []
    for name, low, shelf in (("XX5WEST", 0.0, 0.0031), ("XX5EAST", 0.005, 0.0072)):
        half = shapely.box(low, 0, low + 0.005, 0.01)
        parts = objects(
            *(shapely.box(low, y, low + 0.005, top) for y, top in ((0, shelf), (shelf, 0.01))),
            DRVAL1=5.0,
        )
        halves.append(Cell(name, "1", "0", "2026-01-01", 10_000, half, {"DEPARE": parts}))
    assert no_go(*halves).is_empty


def test_land_keeps_the_names_that_the_chart_gives() -> None:
    named, unnamed = (
        shapely.box(0.002, 0.002, 0.004, 0.004),
        shapely.box(0.006, 0.002, 0.007, 0.004),
    )
    given = cell({"LNDARE": objects(named, unnamed, OBJNAM=["Deer Island", ""])})
    (place,) = s57.land([given], AROUND, HARBOUR, RULE).places
    assert place.name == "Deer Island"
    assert named.contains(shapely.Point(place.lon, place.lat))


# --- The catalogue's chart scenarios end to end, on the currents and cells in ../shared ---


@pytest.fixture(scope="module")
def oscar(shared: Path) -> Path:
    """Give the monthly climatology of OSCAR; skip where it is absent."""
    file = shared / "data" / "currents" / "oscar_climatology_1992-2012_monthly_third_deg.nc"
    if not file.is_file():
        pytest.skip("needs ../shared/data/currents, which is not here")
    return file


def assert_valid(outcome: Outcome) -> None:
    """Every season has routes on both sides of an island, without routes or turns over land."""
    assert outcome.exit_code == 0
    rows = rows_of(outcome.result)
    for case in outcome.result.cases:
        assert len({row.main_passage for row in case.measures.routes}) == 2
    assert all(row.land_m == 0 for row in rows)
    assert all(row.collisions == 0 for row in rows)


@pytest.mark.parametrize(
    ("name", "width", "height"), [("hansando", 1533, 1619), ("far-east", 1360, 1270)]
)
def test_the_region_is_as_large_as_the_papers(name: str, width: float, height: float) -> None:
    scenario = load_scenario(name)
    assert scenario.region is not None
    plane = Projection.for_region(scenario.region.shape, scenario.scale)
    west, south, east, north = scenario.region.shape.bounds
    middle = (west + east) / 2, (south + north) / 2
    edges = plane.to_plane(
        [(west, middle[1]), (east, middle[1]), (middle[0], south), (middle[0], north)]
    )
    assert np.linalg.norm(edges[1] - edges[0]) == pytest.approx(width, rel=0.03)
    assert np.linalg.norm(edges[3] - edges[2]) == pytest.approx(height, rel=0.03)


def test_a_scenario_on_cells_asks_for_them(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["run", "boston-enc", "--output", str(tmp_path / "outputs")])
    assert result.exit_code == 2
    assert "--charts" in result.stderr
    assert "`renew show` prints" in result.stderr
    assert "NOAA ENC" in load_scenario("boston-enc").description
    assert "US5BOSCD" in load_scenario("boston-enc").description
    assert not (tmp_path / "outputs").exists()


@pytest.mark.slow
def test_hansando(oscar: Path, tmp_path: Path) -> None:
    assert_valid(run(load_scenario("hansando", currents=[oscar]), tmp_path))


@pytest.mark.slow
def test_far_east(oscar: Path, tmp_path: Path) -> None:
    outcome = run(load_scenario("far-east", currents=[oscar]), tmp_path)
    assert_valid(outcome)
    assert any(
        "as fast as the vessel (1 m/s) or faster" in note
        for note in note_texts(outcome.fetched.notes)
    )


@pytest.mark.slow
def test_boston_by_its_soundings_and_marks(oscar: Path, shared: Path, tmp_path: Path) -> None:
    cells = tmp_path / "cells"
    cells.mkdir()
    for file in (shared / "data" / "charts").glob("US5BOSCD.*"):
        shutil.copyfile(file, cells / file.name)
    scenario = load_scenario("boston-enc", charts=[{"path": str(cells)}], currents=[oscar])
    outcome = run(scenario, tmp_path / "outputs")
    assert_valid(outcome)
    assert scenario.region is not None
    assert scenario.vessel.draught_m is not None
    depth_m = scenario.vessel.draught_m + scenario.chart.under_keel_clearance_m
    package = outcome.directory / "routes.gpkg"
    meta, _, wkb, columns = pyogrio.raw.read(package, layer="routes", columns=["clearance_m"])
    assert list(meta["fields"]) == ["clearance_m"]
    land = S57Chart(cells, DepthRule(depth_m)).land(scenario.region.shape)
    for line, reported in zip(shapely.from_wkb(wkb), columns[0], strict=True):
        assert clearance_m(shapely.get_coordinates(line), land.polygons) == pytest.approx(
            reported, abs=1.0
        )
    # Checked in UTM, which the pipeline does not use here: rocks, wrecks and marks are further from
    # the routes than their radius plus the coast's accuracy, and no shallow sounding is near.
    to_utm = pyproj.Transformer.from_crs(4326, 32619, always_xy=True)

    def in_metres(geometry: shapely.Geometry) -> shapely.Geometry:
        flat = shapely.force_2d(geometry)
        return shapely.transform(flat, lambda xy: np.column_stack(to_utm.transform(*xy.T)))

    routes = in_metres(shapely.union_all(shapely.from_wkb(wkb)))
    for name, min_m in (("UWTROC", 16), ("WRECKS", 16), ("BOYLAT", 31), ("PILPNT", 16)):
        meta, _, wkb, columns = pyogrio.raw.read(cells / "US5BOSCD.000", layer=name)
        geometry = in_metres(shapely.from_wkb(wkb))
        fields = list(meta["fields"])
        if "VALSOU" in fields:
            geometry = geometry[~(columns[fields.index("VALSOU")].astype(float) >= depth_m)]
        assert shapely.distance(geometry, routes).min() >= min_m, name
    _, _, wkb, (depth,) = pyogrio.raw.read(
        cells / "US5BOSCD.000",
        layer="SOUNDG",
        columns=["DEPTH"],
        SPLIT_MULTIPOINT="ON",
        ADD_SOUNDG_DEPTH="ON",
    )
    near = shapely.dwithin(in_metres(shapely.from_wkb(wkb)), routes, 20.0)
    assert near.sum() > 10
    assert depth[near].min() >= depth_m
