"""Plots of a route, read back from their artists and from the SVG."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib.text import Text

from pipeline._types import FloatArray
from pipeline.findings.result import RunResult
from pipeline.findings.route_profile import route_profile
from pipeline.formats.appearance import COLOURS
from pipeline.formats.figures.chart_map import page_svg
from pipeline.formats.figures.plots import profile_figure
from pipeline.model import Energy
from tests.pipeline.results import with_water

if TYPE_CHECKING:
    from matplotlib.axes import Axes

HOSTILE = '<script>alert(1)</script> "../ \N{ROCKET} \u202e' + "long " * 60


def drawn(axes: Axes, role: str) -> list[FloatArray]:
    """Points (n, 2) of every line in a role's colour."""
    return [
        np.asarray(line.get_xydata(), dtype=float)
        for line in axes.get_lines()
        if line.get_color() == COLOURS[role]
    ]


def text_of(axes: Axes) -> str:
    """All texts of a panel."""
    return " | ".join(text.get_text() for text in axes.findobj(Text))


def test_the_panels_show_the_routes_profile(result: RunResult) -> None:
    ranked = result.routes[0]
    found = route_profile(ranked)
    fuel, speed, current, clearance = profile_figure(ranked).axes
    run = found.distance_m / 1000
    for axes, figures in (
        (fuel, 100 * found.fuel / ranked.metrics.still_fuel),
        (speed, found.speed_m_s),
        (clearance, found.clearance_m / 1000),
    ):
        line = drawn(axes, "best")[0]
        assert line[:, 0] == pytest.approx(run)
        assert line[:, 1] == pytest.approx(figures)
        low, high = axes.get_ylim()
        assert low <= figures.min()
        assert figures.max() <= high
    assert drawn(current, "ink")[1][:, 1] == pytest.approx(found.current_along_m_s)
    assert drawn(speed, "ink")[0][:, 1] == pytest.approx(result.cases[0].case.vessel.speed)
    least = np.argmin(found.clearance_m)
    dot = np.asarray(clearance.get_lines()[-1].get_xydata())
    assert dot[0] == pytest.approx([run[least], found.clearance_m[least] / 1000])
    assert all(axes.get_xlim() == (0, run[-1]) for axes in (fuel, speed, current, clearance))


def test_a_following_current_is_shaded_above_and_a_head_current_below(result: RunResult) -> None:
    ranked = result.case("winter").routes[0]
    found = route_profile(ranked)
    current = profile_figure(ranked).axes[2]
    above, below = (
        np.concatenate([path.vertices for path in area.get_paths()])[:, 1]
        for area in current.collections
    )
    assert above.min() == 0
    assert above.max() == pytest.approx(max(0, found.current_along_m_s.max()))
    assert below.max() == 0
    assert below.min() == pytest.approx(min(0, found.current_along_m_s.min()))


def test_the_grey_of_the_clearance_is_the_padding_of_the_nearest_coast(result: RunResult) -> None:
    ranked = result.routes[0]
    found = route_profile(ranked)
    places = result.water.projection.to_plane(found.lonlat)
    padded = ranked.route.padding_used
    starts, ends = padded[:, :2], padded[:, 2:4]
    (grey,) = profile_figure(ranked).axes[3].collections
    upper = {
        (round(x, 6), round(y, 6))
        for path in grey.get_paths()
        for x, y in np.asarray(path.vertices)
    }
    for i in (0, len(places) // 2, len(places) - 1):
        leg = ends - starts
        share = np.clip(((places[i] - starts) * leg).sum(1) / (leg**2).sum(1), 0, 1)
        apart = np.linalg.norm(starts + share[:, None] * leg - places[i], axis=1)
        # Where edges share a corner either may be meant.
        nearest = padded[apart <= apart.min() * (1 + 1e-9), 4] * result.scenario.scale / 1000
        x = round(found.distance_m[i] / 1000, 6)
        assert any((x, round(padding, 6)) in upper for padding in nearest)


def test_what_turns_need_is_red_where_the_offing_is_wider(result: RunResult) -> None:
    ranked = result.routes[0]
    fifth = replace(ranked.route, turn_padding=ranked.route.padding_used[:, 4] / 5)
    grey, red = profile_figure(replace(ranked, route=fifth)).axes[3].collections
    high = [
        max(np.asarray(path.vertices)[:, 1].max() for path in one.get_paths())
        for one in (grey, red)
    ]
    assert high[1] == pytest.approx(high[0] / 5)


def test_fuel_in_still_water_is_what_the_distance_takes(planar_result: RunResult) -> None:
    ranked = planar_result.routes[0]
    fuel = profile_figure(ranked).axes[0]
    # The paper's vessel makes 1 m/s and burns 1 a second.
    share = 100 * ranked.metrics.fuel / ranked.route.length
    assert drawn(fuel, "ink")[0][-1, 1] == pytest.approx(100)
    assert drawn(fuel, "best")[0][-1, 1] == pytest.approx(share)
    assert f"Fuel used, %: {share:.2f}" in text_of(fuel)


def test_energy_is_drawn_in_watt_hours(planar_result: RunResult) -> None:
    ranked = planar_result.routes[0]
    energy = Energy("Wh", 2.5, 2.5, math.nan)
    fuel = profile_figure(replace(ranked, metrics=replace(ranked.metrics, energy=energy))).axes[0]
    assert drawn(fuel, "best")[0][-1, 1] == pytest.approx(2.5 * ranked.metrics.fuel)
    assert drawn(fuel, "ink")[0][-1, 1] == pytest.approx(2.5 * ranked.route.length, rel=1e-6)
    assert f"Fuel used, Wh: {2.5 * ranked.metrics.fuel:.1f}" in text_of(fuel)


def test_open_sea_has_no_panel_of_clearance(planar_result: RunResult) -> None:
    open_sea = with_water(planar_result, land=())
    assert len(profile_figure(open_sea.routes[0]).axes) == 3


def test_a_crossing_of_land_is_drawn_at_the_panels_foot(planar_result: RunResult) -> None:
    ranked = planar_result.routes[0]
    path = np.array([[10.0, 50.0], [90.0, 50.0]])
    crossing = replace(
        ranked,
        route=replace(ranked.route, path=path),
        metrics=replace(ranked.metrics, land_m=20.0, clearance_m=0.0),
    )
    clearance = profile_figure(crossing).axes[3]
    line = drawn(clearance, "best")[0]
    assert np.isfinite(line).all()
    assert line[:, 1].min() == clearance.get_ylim()[0]


def test_the_svg_is_well_formed_and_leaves_its_colours_to_the_page(result: RunResult) -> None:
    ranked = result.routes[0]
    svg = page_svg(profile_figure(ranked), identity="one", label=HOSTILE)
    tree = ET.fromstring(svg)  # noqa: S314 - our own
    assert tree.get("aria-label") == HOSTILE
    width = float((tree.get("viewBox") or "").split()[2])
    assert width == pytest.approx(374)
    ids = [element.get("id") for element in tree.iter() if element.get("id")]
    assert len(ids) == len(set(ids))
    assert all(name.startswith("one-") for name in ids if name)
    assert set(re.findall(r"(?<!, )#[0-9a-f]{6}", svg)) == set()
    assert "<script" not in svg
    assert len(svg) < 120_000
    again = profile_figure(ranked)
    assert page_svg(again, identity="one", label=HOSTILE) == svg
