"""Maps: their graticule, arrows, widths and layers."""

import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import pytest
import shapely
from hypothesis import given, strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import same_color
from matplotlib.image import imread
from matplotlib.lines import Line2D
from matplotlib.text import Text

from pipeline.findings.result import RunResult
from pipeline.formats.appearance import COLOURS, DARK, season_colour
from pipeline.formats.figures.chart_map import side_room_pt
from pipeline.formats.figures.kinds import Kind, figure
from pipeline.formats.figures.map_marks import (
    arrow_outlines,
    arrows,
    graticule,
    nice_step,
    scale_bar_m,
    speed_limits,
)
from pipeline.formats.figures.season_map import case_svg, overview_figure
from pipeline.geo.projection import Projection
from tests.pipeline.formats import small_run
from tests.pipeline.formats.figures.legible import assert_texts_apart, ink_at_the_edge, is_land
from tests.true_scale import GEOD


@given(st.floats(1e-9, 1e9))
def test_nice_steps_are_round_and_near(value: float) -> None:
    up, down = nice_step(value), nice_step(value, down=True)
    assert down <= value * (1 + 1e-8)
    assert up >= value * (1 - 1e-8)
    for step in (up, down):
        digit = step / 10.0 ** math.floor(math.log10(step) + 1e-9)
        assert min(abs(digit - round_) for round_ in (1, 2, 5)) < 1e-6
        assert 1 / 2.6 < step / value < 2.6


@pytest.mark.parametrize("latitude", [0.0, 10.0, -45.0, 70.0])
@pytest.mark.parametrize("scale", [1.0, 5000.0])
def test_lines_are_where_their_labels_say(latitude: float, scale: float) -> None:
    region = shapely.box(100, latitude, 107, latitude + 6)
    projection = Projection.for_region(region, scale)
    extent = projection.geometry_to_plane(region.segmentize(0.1))
    lines = graticule(projection, extent)
    assert sum(line.is_meridian for line in lines) >= 3
    for line in lines:
        lonlat = projection.to_lonlat(np.concatenate(line.parts))
        number = float(line.label.split("°")[0]) * (-1 if line.label[-1] in "SW" else 1)
        # A line is clipped at the extent, whose edges bend by less than this.
        constant = lonlat[:, 0 if line.is_meridian else 1]
        assert constant == pytest.approx(np.full(len(constant), number), abs=2e-3)
        assert shapely.distance(shapely.Point(line.foot), extent) < 2e-3 * extent.length


def test_a_meridian_on_the_edge_is_labelled_at_its_foot() -> None:
    """The region begins at 119 E; the chart's straight edge and that meridian cross."""
    region = shapely.box(119.0, 9.0, 120.2, 10.0)
    projection = Projection.for_region(region)
    extent = projection.geometry_to_plane(region)
    [edge] = [line for line in graticule(projection, extent) if line.label == "119°00′E"]
    assert edge.foot[1] < extent.bounds[1] + 0.01 * (extent.bounds[3] - extent.bounds[1])


@pytest.mark.parametrize(
    ("box", "labels"),
    [
        ((179.0, -1.0, 181.0, 1.0), {"179°00′E", "179°30′E", "180°00′", "179°30′W", "0°00′"}),
        ((10.0, 54.0, 10.1, 54.05), {"10°00′E", "10°02′E", "54°02′N"}),
        ((0.0, 0.0, 0.004, 0.004), {"0°00′00″", "0°00′02″E", "0°00′02″N"}),
    ],
)
def test_labels_have_the_steps_precision(box: tuple[float, ...], labels: set[str]) -> None:
    region = shapely.box(*box)
    projection = Projection.for_region(region)
    lines = graticule(projection, projection.geometry_to_plane(region))
    assert labels <= {line.label for line in lines}


def test_a_plane_in_metres_gets_a_grid_in_metres() -> None:
    lines = graticule(Projection.at(0, 0), shapely.box(0, 0, 100, 100), in_metres=True)
    assert [line.label for line in lines if line.is_meridian] == [
        *("0 m", "20 m", "40 m", "60 m", "80 m", "100 m")
    ]
    assert [line.foot for line in lines if line.label == "40 m"] == [(40.0, 0.0), (0.0, 40.0)]


@pytest.mark.parametrize("latitude", [0.0, 45.0, 75.0])
@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_the_scale_bar_is_true(latitude: float, scale: float) -> None:
    region = shapely.box(-3, latitude, 4, latitude + 5)
    projection = Projection.for_region(region, scale)
    bounds = projection.geometry_to_plane(region.segmentize(0.1)).bounds
    length_m, length = scale_bar_m(projection, bounds)
    middle = np.array([(bounds[0] + bounds[2]) / 2, (bounds[1] + bounds[3]) / 2])
    half = np.array([length / 2, 0])
    ends = projection.to_lonlat(np.stack([middle - half, middle + half]))
    *_, measured = GEOD.inv(*ends[0], *ends[1])
    assert measured == pytest.approx(length_m, rel=2e-3)
    assert 0.1 < length / (bounds[2] - bounds[0]) <= 0.3


def test_arrows_are_on_water_and_show_the_planners_current(result: RunResult) -> None:
    case = result.case("summer")
    places, velocity = arrows(case)
    land = shapely.union_all(result.water.land)
    assert len(places) > 150
    assert not shapely.intersects_xy(land, places).any()
    assert velocity == pytest.approx(result.case("summer").case.current(places))
    limits = speed_limits(result)
    assert np.hypot(*velocity.T).max() <= limits[-1]
    for outline, low, high in zip(
        arrow_outlines(case, limits), (0.0, *limits), limits, strict=False
    ):
        inside = (np.hypot(*velocity.T) > low) & (np.hypot(*velocity.T) <= high)
        assert len(shapely.get_parts(outline)) == inside.sum()


def test_an_arrow_points_along_the_current(result: RunResult) -> None:
    case = result.case("winter")
    places, velocities = arrows(case)
    whole = arrow_outlines(case, (10.0,))[0]
    for arrow, position, velocity in zip(shapely.get_parts(whole), places, velocities, strict=True):
        corners = shapely.get_coordinates(arrow)
        tip = corners[np.argmax((corners - position) @ velocity)]
        ahead = (tip - position) / np.linalg.norm(tip - position)
        assert ahead == pytest.approx(velocity / np.linalg.norm(velocity), abs=1e-6)
    # Turned, not skewed.
    assert np.ptp(shapely.area(shapely.get_parts(whole))) < 1e-9 * whole.area


@pytest.fixture(scope="module")
def with_long_labels() -> RunResult:
    """A run on a chart so small that its grid has seconds, with everything a legend can hold."""
    result = small_run.with_zones(small_run.parts())
    rule = "keep to starboard"
    return replace(
        result,
        fetched=replace(
            result.fetched,
            land=replace(
                result.fetched.land,
                zones=tuple(replace(zone, rule=rule) for zone in result.fetched.land.zones),
            ),
        ),
    )


@pytest.mark.parametrize("kind", Kind)
def test_nothing_is_cut(with_long_labels: RunResult, kind: Kind) -> None:
    drawn = figure(with_long_labels.case("winter"), kind)
    assert ink_at_the_edge(drawn) == 0


def test_ink_at_the_edge_is_found(result: RunResult) -> None:
    """The measure itself: a label moved over the edge is seen."""
    drawn = figure(result.case("winter"), Kind.ROUTES)
    assert ink_at_the_edge(drawn) == 0
    drawn.text(0.0, 0.5, "cut", ha="center")
    assert ink_at_the_edge(drawn) > 0


@pytest.mark.parametrize("kind", Kind)
def test_the_smallest_text_can_be_read_in_print(result: RunResult, kind: Kind) -> None:
    """In points on paper; titles may shrink to fit."""
    drawn = figure(result.case("winter"), kind)
    FigureCanvasAgg(drawn).draw()  # type: ignore[no-untyped-call]
    sizes = [
        float(text.get_fontsize())
        for text in drawn.findobj(Text)
        if text.get_text().strip() and text.get_visible()
    ]
    assert min(sizes) >= 6


def test_the_best_route_has_its_seasons_colour(result: RunResult) -> None:
    for number, entry in enumerate(result.results):
        for kind in Kind:
            drawn = figure(result.case(entry.name), kind)
            colours = [line.get_color() for line in drawn.findobj(Line2D)]
            assert any(same_color(colour, season_colour(number)) for colour in colours), kind
            assert not any(same_color(colour, COLOURS["best"]) for colour in colours), kind


def test_the_legend_has_what_is_too_shallow(with_long_labels: RunResult) -> None:
    (legend,) = figure(with_long_labels.case("winter"), Kind.ROUTES).legends
    assert "too shallow" in [text.get_text() for text in legend.get_texts()]


@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("kind", Kind)
def test_texts_do_not_overlap_or_leave_the_figure(kind: Kind, *, planar: bool) -> None:
    result = small_run.parts(planar=planar)
    assert_texts_apart(figure(result.case(result.results[0].name), kind))


def test_land_has_the_colour_of_land_where_it_lies(planar_result: RunResult) -> None:
    drawn = figure(planar_result.case("gyre"), Kind.ROUTES)
    assert is_land(drawn, (57, 43))
    assert not is_land(drawn, (5, 95))


HOSTILE = "<script>alert(1)</script> ../ \N{ROCKET} \u202egnp.exe $x_{" + "long " * 60


def share(picture: npt.NDArray[np.float64], role: str) -> float:
    """Share of a picture's pixels that have the colour of a role, or one given, near enough."""
    colour = COLOURS.get(role, role)
    wanted = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return float((np.abs(picture[..., :3] - wanted).max(axis=-1) < 0.02).mean())


def test_every_role_has_a_colour_of_its_own_and_a_dark_one() -> None:
    assert set(COLOURS) == set(DARK)
    assert len(set(COLOURS.values())) == len(COLOURS)


def test_the_picture_shows_land_as_large_as_it_is(result: RunResult, tmp_path: Path) -> None:
    overview_figure([result.case("winter")]).savefig(tmp_path / "map.png", dpi=200)
    picture = imread(tmp_path / "map.png")
    best = season_colour(1)
    sea = sum(share(picture, role) for role in ("water", "land", best, "speed0", "speed1"))
    extent = result.water.chart.extent
    land = shapely.union_all(result.water.land).intersection(extent).area / extent.area
    # Part of the picture is margin; on the map itself land has its true share, less what arrows and
    # lines cover.
    assert share(picture, "land") / sea == pytest.approx(land, rel=0.2)
    assert 0.002 < share(picture, best) < 0.02
    assert share(picture, "other") > 0.0005


def test_the_best_route_runs_where_it_was_planned(result: RunResult) -> None:
    """The thick line's points in the SVG are the route's, up to one linear map."""
    svg = case_svg(result.case("summer"), identity="a", label="")
    thick = re.search(
        rf'd="([^"]*)"[^>]*stroke: var\(--map-best, {COLOURS["best"]}\); stroke-width: 2.2', svg
    )
    assert thick is not None
    drawn = np.array(re.findall(r"-?\d+(?:\.\d+)?", thick[1]), dtype=float).reshape(-1, 2)
    path = result.case("summer").routes[0].route.path
    xmin, ymin, xmax, ymax = result.water.chart.bounds
    for place, whole in ((drawn[0], path[0]), (drawn[-1], path[-1])):
        across = (whole[0] - xmin) / (xmax - xmin), (whole[1] - ymin) / (ymax - ymin)
        # Margins: as wide as the grid's labels at the sides; 10 above, 40 below.
        left_pt, right_pt = side_room_pt(result)
        width = 374 - left_pt - right_pt
        assert place[0] == pytest.approx(left_pt + across[0] * width, abs=0.2)
        height = width * (ymax - ymin) / (xmax - xmin)
        assert place[1] == pytest.approx(10 + (1 - across[1]) * height, abs=0.2)


def test_the_svg_is_well_formed_and_asks_for_nothing(result: RunResult) -> None:
    svg = case_svg(result.case("summer"), identity="one", label='a "label" & <more>')
    tree = ET.fromstring(svg)  # noqa: S314 - our own
    assert tree.get("role") == "img"
    assert tree.get("aria-label") == 'a "label" & <more>'
    ids = [element.get("id") for element in tree.iter() if element.get("id")]
    assert len(ids) == len(set(ids))
    assert all(name.startswith("one-") for name in ids if name)
    used = re.findall(r'(?:href="#|url\(#)([^")]+)', svg)
    assert used
    assert set(used) <= set(ids)
    assert re.findall(r"https?://[^\"]*", svg) == ["http://www.w3.org/2000/svg"]
    assert "<style" not in svg
    assert "<script" not in svg
    assert {"svg", "g", "path", "use", "defs", "clipPath", "rect", "text"} >= {
        element.tag.rpartition("}")[2] for element in tree.iter()
    }
    # The page can set every colour.
    assert set(re.findall(r"(?<!, )#[0-9a-f]{6}", svg)) == set()
    for role in ("water", "land", "soft", "best", "other", "ink", "speed2"):
        assert f"var(--map-{role}, " in svg


def test_text_stays_text_in_the_pages_own_font(result: RunResult) -> None:
    before = mpl.rcParams["svg.fonttype"]
    svg = case_svg(result.case("summer"), identity="one", label="")
    assert mpl.rcParams["svg.fonttype"] == before
    texts = {e.text for e in ET.fromstring(svg).iter("{http://www.w3.org/2000/svg}text")}  # noqa: S314
    assert {"9°00′N", "120°00′E", "0"} <= texts
    assert "font-family" not in svg
    sizes = set(re.findall(r"font-size: [^;]+;", svg))
    assert sizes == {"font-size: calc(8.2px * var(--text, 1));"}


def test_zones_are_outlined_in_their_colours_and_only_where_there_are_any(
    result: RunResult,
) -> None:
    plain = case_svg(result.case("summer"), identity="x", label="")
    zoned = case_svg(small_run.with_zones(result).case("summer"), identity="x", label="")
    for role in ("restricted", "traffic"):
        assert f"var(--map-{role}" not in plain
        drawn = [line for line in zoned.splitlines() if f"var(--map-{role}" in line]
        # The second traffic scheme is outside the chart.
        assert len(drawn) == 1
        assert all(mark in drawn[0] for mark in ("stroke-dasharray", "fill-opacity: 0.06"))
    legends = []
    for case in (result, small_run.with_zones(result)):
        (legend,) = overview_figure(case.cases).legends
        legends.append([text.get_text() for text in legend.get_texts()])
    assert [text for text in legends[1] if text not in legends[0]] == [
        "too shallow",
        "restricted",
        "traffic scheme",
    ]


def test_the_same_run_gives_the_same_picture(result: RunResult) -> None:
    pictures = {case_svg(result.case("winter"), identity="x", label="") for _ in range(2)}
    assert len(pictures) == 1


def test_a_hostile_title_breaks_no_picture(result: RunResult, tmp_path: Path) -> None:
    seasons = tuple(spec.model_copy(update={"title": HOSTILE}) for spec in result.scenario.seasons)
    hostile = replace(result, scenario=result.scenario.model_copy(update={"seasons": seasons}))
    overview_figure(hostile.cases).savefig(tmp_path / "overview.png", dpi=50)
    plain = tmp_path / "plain.png"
    overview_figure(result.cases).savefig(plain, dpi=50)
    assert imread(tmp_path / "overview.png").shape == imread(plain).shape


def test_a_plane_a_failed_season_and_one_without_current_are_drawn(
    result: RunResult, planar_result: RunResult, tmp_path: Path
) -> None:
    overview_figure(planar_result.cases).savefig(tmp_path / "planar.png", dpi=50)
    assert share(imread(tmp_path / "planar.png"), "land") > 0.01
    failed = small_run.with_a_failed_season(result)
    failed = replace(failed, planned={"summer": result.planned["summer"]}, islands=())
    svg = case_svg(failed.case("winter"), identity="f", label="")
    assert "--map-land" in svg
    assert "--map-speed" not in svg
    assert "stroke-width: 2.2" not in svg
