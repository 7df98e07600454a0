"""The padding of edges beside a channel: its risk, its floor, and how it follows the risk."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st
from shapely import box

import renew
from renew._types import FloatArray
from renew.classes.class_enumerator import ClassEnumerator
from renew.classes.dual_graph import Channel
from renew.classes.h_signature import Rays
from renew.classes.triangulation import triangulate
from renew.inputs.options import Padding, PlanOptions
from renew.planner.hindrances import with_clearance
from renew.turns.padding_model import PaddedEdges, PaddingModel
from tests.strategies import PAPER_VESSEL, examples, random_scene, seeds, voyage_on


def padded_edges(seed: int) -> PaddedEdges:
    """Twelve edges, by numbers that are not in order."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(0, 10, (12, 2))
    end = start + rng.normal(0, 2, (12, 2))
    padding = rng.uniform(0, 3, 12)
    edges = PaddedEdges.of(start, end, padding, rng.permutation(30)[:12])
    return replace(edges, turns=padding / 2)


@settings(max_examples=20)
@given(seed=seeds)
def test_the_edges_around_a_point_are_those_whose_buffer_holds_it(seed: int) -> None:
    padded = padded_edges(seed)
    point = np.random.default_rng(seed).uniform(0, 10, 2)
    lines = shapely.linestrings(np.stack([padded.start, padded.end], axis=1))
    holding = shapely.distance(lines, shapely.Point(point)) < padded.padding
    assert padded.around(point).edge.tolist() == padded.edge[holding].tolist()


def test_an_edge_that_is_named_twice_grows_by_the_larger_figure() -> None:
    padded = padded_edges(0)
    one, other = padded.edge[[7, 2]]
    grown = padded.grown(np.array([one, other, one]), np.array([0.5, 2.0, 1.5]))
    expected = padded.padding.copy()
    expected[[7, 2]] += [1.5, 2.0]
    assert grown.padding.tolist() == expected.tolist()
    assert grown.edge.tolist() == padded.edge.tolist()
    # What has grown has grown for turns, and all of its padding is needed for them.
    turns = padded.turns.copy()
    turns[[7, 2]] = expected[[7, 2]]
    assert grown.turns.tolist() == turns.tolist()


def always(channel: Channel) -> FloatArray:
    """Windows of time in a steady current, where any will do."""
    return np.zeros((len(channel.triangles), 2))


@examples(30, 100)
@given(width=st.floats(0.0, 12.0))
def test_fixed_padding_and_clearance_are_as_asked(width: float) -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(40, 40, 60, 60)])
    triangulation = triangulate(chart)
    voyage = voyage_on(chart, (5.0, 50.0), (95.0, 50.0))
    channel = ClassEnumerator.of(voyage, triangulation, Rays.of(chart), "length").channels(1)[0]
    cases: list[tuple[Padding, float, float]] = [
        (width, 3.0, max(width, 3.0)),
        ("none", width, width),
    ]
    for padding, clearance, expected in cases:
        options = PlanOptions(padding=padding, clearance=clearance)
        model = PaddingModel(triangulation, renew.UniformCurrent(0.1, 0.0), PAPER_VESSEL, options)
        turns = model.padded_edges(channel, voyage.start, voyage.goal, always(channel))
        edges = with_clearance(turns, clearance, 1.0, channel, voyage, triangulation)
        assert len(edges.edge)
        assert edges.padding == pytest.approx(expected)


def test_less_risk_takes_more_padding() -> None:
    scene = random_scene(3)
    triangulation, rays = triangulate(scene.chart), Rays.of(scene.chart)
    channel = ClassEnumerator.of(scene.voyage, triangulation, rays, "length").channels(1)[0]
    widths = [
        PaddingModel(triangulation, scene.current, PAPER_VESSEL, PlanOptions(risk=risk))
        .padded_edges(channel, scene.start, scene.goal, always(channel))
        .padding.mean()
        for risk in (0.5, 0.2, 0.05, 0.01)
    ]
    assert widths == sorted(widths)
    assert widths[0] < widths[-1]
