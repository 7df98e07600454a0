from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import pytest
import shapely
from matplotlib.image import imread

from pipeline.findings.result import RunResult
from pipeline.formats.figures.chart_map import side_room_pt
from pipeline.formats.figures.season_map import case_svg, overview_figure
from pipeline.formats.palette import COLOURS, DARK, season_colour
from tests.pipeline.formats import small_run

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
