"""A plan in a notebook: well-formed, offline, and its figures are those of the plan."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import renew
from tests.strategies import PAPER_VESSEL, random_scene

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def plan() -> renew.Plan:
    chart, current, start, goal = random_scene(1, islands=3)
    return renew.plan(chart, current, PAPER_VESSEL, start, goal, classes=8)


@pytest.fixture(scope="module")
def shown(plan: renew.Plan) -> ET.Element:
    return ET.fromstring(f"<div>{plan._repr_html_()}</div>")  # noqa: S314  # our own


def points(element: ET.Element) -> np.ndarray:
    """Points (n, 2) of a line or an area, pixels."""
    return np.array([xy.split(",") for xy in element.attrib["points"].split()], dtype=float)


def test_each_route_is_a_line_as_long_as_it_is(plan: renew.Plan, shown: ET.Element) -> None:
    lines = [points(line) for line in shown.iter(f"{SVG}polyline")][::-1]
    assert len(lines) == min(6, len(plan.routes))
    lengths = [np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines]
    scale = lengths[0] / plan.routes[0].length
    for route, length in zip(plan.routes, lengths, strict=False):
        assert length == pytest.approx(scale * route.length, rel=0.01)


def test_north_is_up_and_everything_lies_within_the_picture(
    plan: renew.Plan, shown: ET.Element
) -> None:
    (svg,) = shown.iter(f"{SVG}svg")
    x, y, width, height = map(float, svg.attrib["viewBox"].split())
    drawn = np.concatenate([points(line) for line in shown.iter() if "points" in line.attrib])
    best = points(list(shown.iter(f"{SVG}polyline"))[-1])
    assert ((drawn >= [x, y]) & (drawn <= [x + width, y + height])).all()
    north = plan.best.path[-1, 1] - plan.best.path[0, 1]
    assert np.sign(best[0, 1] - best[-1, 1]) == np.sign(north)


def test_the_table_has_a_row_for_each_route(plan: renew.Plan, shown: ET.Element) -> None:
    (body,) = shown.iter("tbody")
    rows = [["".join(cell.itertext()) for cell in row] for row in body]
    assert len(rows) == min(6, len(plan.routes))
    for route, (_, homotopy, fuel, *_) in zip(plan.routes, rows, strict=False):
        assert homotopy == route.homotopy
        assert float(fuel) == pytest.approx(route.fuel, abs=0.05)


def test_it_needs_nothing_from_elsewhere(plan: renew.Plan) -> None:
    html = plan._repr_html_()
    assert "<script" not in html
    assert re.findall(r"(?:src|href)=", html) == []
