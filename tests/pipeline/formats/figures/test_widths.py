"""Figures as wide as a journal's column or page: nothing is cut at their edges."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import same_color
from matplotlib.lines import Line2D
from matplotlib.text import Text

from pipeline.formats.figures.kinds import Kind, Width, figure
from pipeline.formats.figures.method import Variant
from pipeline.formats.shared.palette import COLOURS, season_colour
from pipeline.formats.shared.result import RunResult
from tests.pipeline.formats import small_run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KINDS = Kind.selected(())


def variants(result: RunResult) -> dict[Kind, list[Variant]]:
    """The run itself in place of runs with other options, and one that failed."""
    return {
        Kind.CLASSES: [Variant("k = 16", result), Variant("k = 1", result)],
        Kind.PADDINGS: [
            Variant("adaptive padding", result),
            Variant("no padding", result),
            Variant("fixed padding, 5.13 km", None, "shut"),
        ],
    }


def ink_at_the_edge(drawn: Figure) -> float:
    """Share of the outermost pixels that are not the background."""
    canvas = FigureCanvasAgg(drawn)
    drawn.set_dpi(150)
    canvas.draw()  # type: ignore[no-untyped-call]
    pixels = canvas.buffer_rgba()  # type: ignore[no-untyped-call]
    seen = np.asarray(pixels)[..., :3].astype(int)
    edge = np.concatenate([seen[0], seen[-1], seen[:, 0], seen[:, -1]])
    return float((np.abs(edge - edge[0]).max(axis=1) > 8).mean())


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


@pytest.mark.gate_share(9)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("width", list(Width))
def test_nothing_is_cut(with_long_labels: RunResult, kind: Kind, width: Width) -> None:
    drawn = figure(with_long_labels, "winter", kind, width, variants(with_long_labels))
    if width.points is not None:
        assert drawn.get_size_inches()[0] * 72 == pytest.approx(width.points)
    assert ink_at_the_edge(drawn) == 0


def test_ink_at_the_edge_is_found(result: RunResult) -> None:
    """The measure itself: a label moved over the edge is seen."""
    drawn = figure(result, "winter", Kind.ROUTES, Width.COLUMN)
    assert ink_at_the_edge(drawn) == 0
    drawn.text(0.0, 0.5, "cut", ha="center")
    assert ink_at_the_edge(drawn) > 0


@pytest.mark.gate_share(3)
@pytest.mark.parametrize("kind", KINDS)
def test_the_smallest_text_can_be_read_in_print(result: RunResult, kind: Kind) -> None:
    """In points on paper, as these widths are not scaled; titles may shrink to fit."""
    drawn = figure(result, "winter", kind, Width.COLUMN, variants(result))
    FigureCanvasAgg(drawn).draw()  # type: ignore[no-untyped-call]
    sizes = [
        float(text.get_fontsize())
        for text in drawn.findobj(Text)
        if text.get_text().strip() and text.get_visible()
    ]
    assert min(sizes) >= 6


def test_the_best_route_has_its_seasons_colour(result: RunResult) -> None:
    for number, entry in enumerate(result.plans):
        for kind in (Kind.ROUTES, Kind.PADDING, Kind.ALONG):
            drawn = figure(result, entry.season, kind)
            colours = [line.get_color() for line in drawn.findobj(Line2D)]
            assert any(same_color(colour, season_colour(number)) for colour in colours), kind
            assert not any(same_color(colour, COLOURS["best"]) for colour in colours), kind


def test_the_legend_has_what_is_too_shallow(with_long_labels: RunResult) -> None:
    for kind in (Kind.MESH, Kind.PADDING, Kind.ROUTES, Kind.PADDINGS):
        drawn = figure(with_long_labels, "winter", kind, variants=variants(with_long_labels))
        (legend,) = drawn.legends
        assert "too shallow" in [text.get_text() for text in legend.get_texts()], kind


def test_the_quantile_of_the_reaches_is_theirs(result: RunResult) -> None:
    """The line marked as the quantile has as many drawn turns below it as the risk allows."""
    (axes,) = figure(result, "winter", Kind.REACH).axes
    curve = axes.get_lines()[0]
    quantile = next(line for line in axes.get_lines() if "quantile" in str(line.get_label()))
    at = float(np.asarray(quantile.get_xdata(), dtype=float)[0])
    x, y = np.asarray(curve.get_xdata(), float), np.asarray(curve.get_ydata(), float)
    assert float(np.interp(at, x, y)) == pytest.approx(1 - result.scenario.planner.risk, abs=0.01)
