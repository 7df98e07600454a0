"""Content of the method's figures, read back from their artists and from pixels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import shapely
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.text import Annotation

import renew
from experiments.figures import method
from pipeline.findings.result import RunResult
from pipeline.formats.appearance import COLOURS
from pipeline.model import Passage
from renew._types import FloatArray
from tests.pipeline.formats import small_run
from tests.pipeline.formats.figures.legible import assert_texts_apart, ink_at_the_edge, is_land
from tests.pipeline.results import with_case, with_result

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@pytest.fixture(scope="module")
def result() -> RunResult:
    return small_run.parts()


@pytest.fixture(scope="module")
def planar_result() -> RunResult:
    return small_run.parts(planar=True)


def segments(axes: Axes, colour: str) -> list[FloatArray]:
    """Lines (n, 2) that were drawn in a colour as collections."""
    return [
        np.asarray(segment)
        for drawn in axes.findobj(LineCollection)
        if to_hex(np.asarray(drawn.get_colors())[0].tolist()) == colour
        for segment in drawn.get_segments()
    ]


def area(axes: Axes, colour: str) -> Any:  # noqa: ANN401 - shapely has no types
    """Area that was filled with a colour; a ring inside another is its hole."""
    rings = [
        shapely.Polygon(ring)
        for drawn in axes.findobj(PathPatch)
        if to_hex(drawn.get_facecolor()) == colour
        for ring in map(np.asarray, drawn.get_path().to_polygons())
        if len(ring) > 3
    ]
    return reduce(shapely.symmetric_difference, rings, shapely.Polygon())


def strokes(axes: Axes, colour: str) -> list[FloatArray]:
    """Lines (n, 2) of a colour with at least two points."""
    return [
        path
        for line in axes.get_lines()
        if line.get_color() == colour and len(path := np.asarray(line.get_xydata())) > 1
    ]


def labels(axes: Axes) -> list[str]:
    """Texts on a map."""
    return [text.get_text() for text in axes.findobj(Annotation)]


def test_the_mesh_is_a_constrained_triangulation_of_the_water(result: RunResult) -> None:
    (axes,) = method.mesh(result, "winter").axes
    chart = result.water.chart
    constrained = shapely.linestrings(segments(axes, COLOURS["ink"]))
    no_go = shapely.union_all(chart.no_go)
    # They are exactly the no-go zone's edges.
    coast = no_go.boundary.intersection(chart.extent.buffer(-1e-6))
    assert shapely.length(constrained).sum() == pytest.approx(coast.length, rel=1e-6)
    assert shapely.distance(shapely.centroid(constrained), no_go.boundary).max() < 1e-3
    # Passing edges are in the water and, with all other edges, enclose only triangles.
    passing = shapely.linestrings(segments(axes, COLOURS["other"]))
    assert not shapely.intersects(shapely.centroid(passing), no_go.buffer(-1e-3)).any()
    edges = [*passing, *constrained, chart.extent.boundary]
    network = shapely.union_all(edges, grid_size=1e-5)  # vertices are snapped to a finer one
    faces = shapely.get_parts(shapely.polygonize([network]))
    water = [face for face in faces if not no_go.contains(face.representative_point())]
    assert all(len(face.simplify(1e-4).exterior.coords) == 4 for face in water)
    assert sum(face.area for face in water) == pytest.approx(chart.water.area, rel=1e-6)


def test_each_channel_is_in_its_own_colour_and_holds_its_route(result: RunResult) -> None:
    routes = result.case("winter").routes
    drawn = method.channels(result, "winter").axes
    assert len(drawn) == min(4, len(routes))
    for axes, colour, ranked in zip(drawn, method.CLASS_COLOURS, routes, strict=False):
        channel = area(axes, colour)
        assert channel.area == pytest.approx(
            shapely.area(shapely.polygons(ranked.route.channel)).sum()
        )
        assert channel.buffer(1e-6).covers(shapely.LineString(ranked.route.path))
        (path,) = strokes(axes, colour)
        assert path == pytest.approx(ranked.route.path)
        assert len(segments(axes, colour)) == 3 * len(ranked.route.channel)


def test_the_best_by_each_passage_has_its_channel_drawn(result: RunResult) -> None:
    """The only southern class is one of the four, although it is the last of five."""
    routes = result.case("winter").routes
    rows = [
        replace(
            ranked.metrics,
            rank=rank,
            passages=(Passage("south" if rank == 5 else "north", ("1",)), Passage("east", ("2",))),
        )
        for ranked, rank in zip([*routes, *routes][:5], (1, 2, 3, 4, 5), strict=True)
    ]
    entry = result.case("winter").result
    assert entry.plan is not None
    plan = replace(entry.plan, routes=tuple(one.route for one in [*routes, *routes][:5]))
    measures = replace(entry.measures, routes=tuple(rows))
    many = with_result(result, "winter", plan=plan, measures=measures)
    titles = [text.get_text() for text in method.channels(many, "winter").texts]
    assert titles[::2] == [
        *(f"{rank}: north of island 1, east of island 2" for rank in (1, 2, 3)),
        "5: south of island 1, east of island 2",
    ]


def test_the_soft_zone_is_the_padded_edges_and_the_turns_begin_on_the_route(
    result: RunResult,
) -> None:
    best = result.case("winter").routes[0]
    axes, *windows = method.padding(result, "winter").axes
    soft = area(axes, COLOURS["soft"])
    padded = best.route.soft_no_go
    assert soft.symmetric_difference(padded).area < 0.02 * padded.area
    assert strokes(axes, COLOURS["best"])[0] == pytest.approx(best.route.path)
    assert 1 <= len(windows) <= 3
    path = shapely.LineString(best.route.path)
    land = shapely.union_all(result.water.chart.no_go)
    for number, window in enumerate(windows, start=1):
        turns = segments(window, COLOURS["ink"])
        assert len(turns) >= 2
        for turn in turns:
            assert path.distance(shapely.Point(turn[0])) < 1e-6
            assert not shapely.LineString(turn).intersects(land)
        assert str(number) in labels(axes)
        assert str(number) in labels(window)
        # The window is a square around a point of the route.
        middle = np.mean([window.get_xlim(), window.get_ylim()], axis=1)
        assert path.distance(shapely.Point(middle)) < 1e-6
        assert np.ptp(window.get_xlim()) == pytest.approx(np.ptp(window.get_ylim()))


def test_turns_in_still_water_are_circles(planar_result: RunResult) -> None:
    still = with_case(planar_result, "gyre", current=renew.UniformCurrent(0.0, 0.0))
    _, window, *_ = method.padding(still, "gyre").axes
    radius = planar_result.cases[0].case.vessel.turning_radius
    for turn in segments(window, COLOURS["ink"]):
        centre = turn[:-1].mean(axis=0)
        assert np.linalg.norm(turn - centre, axis=1) == pytest.approx(radius, rel=0.02)


def test_a_windows_scale_bar_is_as_long_as_its_label(result: RunResult) -> None:
    for window in method.padding(result, "summer").axes[1:]:
        bar = sum(field.get_width() for field in window.patches if isinstance(field, Rectangle))
        (text,) = (label for label in labels(window) if label.endswith("m"))
        size, unit = text.split()
        metres = float(size) * (1000 if unit == "km" else 1)
        assert bar * result.scenario.scale == pytest.approx(metres, rel=2e-3)


def test_open_sea_has_no_padding_and_no_windows(planar_result: RunResult) -> None:
    entry = planar_result.results[0]
    assert entry.plan is not None
    bare = replace(entry.plan.best, padding_used=np.empty((0, 5)))
    plan = replace(entry.plan, routes=(bare,))
    measures = replace(entry.measures, routes=entry.measures.routes[:1])
    open_sea = with_result(planar_result, "gyre", plan=plan, measures=measures)
    drawn = method.padding(open_sea, "gyre")
    assert len(drawn.axes) == 1
    assert area(drawn.axes[0], COLOURS["soft"]).is_empty


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("draw", [method.mesh, method.channels, method.padding])
@pytest.mark.parametrize("planar", [False, True])
def test_a_figure_is_legible(draw: Callable[[RunResult, str], Figure], *, planar: bool) -> None:
    result = small_run.parts(planar=planar)
    drawn = draw(result, result.results[0].name)
    assert_texts_apart(drawn)
    assert ink_at_the_edge(drawn) == 0
    if planar:
        assert is_land(drawn, (57, 43))
        assert not is_land(drawn, (5, 95))
