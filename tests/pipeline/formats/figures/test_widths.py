"""Figures of `renew plot`, also as wide as a journal's column or page: nothing is cut or hidden."""

from __future__ import annotations

from dataclasses import replace

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import same_color
from matplotlib.lines import Line2D
from matplotlib.text import Text

from pipeline.findings.result import RunResult
from pipeline.formats.figures.kinds import Kind, Width, figure
from pipeline.formats.palette import COLOURS, season_colour
from tests.pipeline.formats import small_run
from tests.pipeline.formats.figures.legible import assert_texts_apart, ink_at_the_edge, is_land


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
@pytest.mark.parametrize("width", Width)
def test_nothing_is_cut(with_long_labels: RunResult, kind: Kind, width: Width) -> None:
    drawn = figure(with_long_labels.case("winter"), kind, width)
    if width.points is not None:
        assert drawn.get_size_inches()[0] * 72 == pytest.approx(width.points)
    assert ink_at_the_edge(drawn) == 0


def test_ink_at_the_edge_is_found(result: RunResult) -> None:
    """The measure itself: a label moved over the edge is seen."""
    drawn = figure(result.case("winter"), Kind.ROUTES, Width.COLUMN)
    assert ink_at_the_edge(drawn) == 0
    drawn.text(0.0, 0.5, "cut", ha="center")
    assert ink_at_the_edge(drawn) > 0


@pytest.mark.parametrize("kind", Kind)
def test_the_smallest_text_can_be_read_in_print(result: RunResult, kind: Kind) -> None:
    """In points on paper, as these widths are not scaled; titles may shrink to fit."""
    drawn = figure(result.case("winter"), kind, Width.COLUMN)
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
