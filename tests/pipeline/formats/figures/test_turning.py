"""Turns at the tightest place: those whose reach set the padding, drawn by another formula."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import renew
from pipeline.formats.figures.method import Variant, variants_figure
from pipeline.formats.figures.turning import (
    NothingToDrawError,
    reach_figure,
    turn_tracks,
    turns_figure,
)
from pipeline.formats.shared.result import RunResult


def test_the_turns_drawn_reach_as_far_as_those_that_set_the_padding(result: RunResult) -> None:
    best = result.season_routes("summer")[0].route
    vessel = result.scene.vessel
    found = renew.tightest(best, result.scene.currents["summer"], vessel)
    assert found is not None
    along = found.edge[1] - found.edge[0]
    normal = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    if (found.edge[0] - found.point) @ normal < 0:
        normal = -normal
    reach = (turn_tracks(found, vessel) @ normal).max(axis=(0, 2))
    # Chords of two degrees are inside their arc.
    assert reach == pytest.approx(found.reaches, abs=2e-4 * vessel.turning_radius)
    assert np.ptp(reach) > 0


def test_where_nothing_is_padded_there_is_nothing_to_draw(planar_result: RunResult) -> None:
    entry = planar_result.plans[0]
    assert entry.plan is not None
    bare = replace(entry.plan.best, padding_used=np.empty((0, 5)))
    open_sea = replace(
        planar_result,
        plans=(replace(entry, plan=replace(entry.plan, routes=(bare,))),),
        evaluation=replace(planar_result.evaluation, routes=planar_result.evaluation.routes[:1]),
    )
    for draw in (turns_figure, reach_figure):
        with pytest.raises(NothingToDrawError, match="no edge beside its best route is padded"):
            draw(open_sea, "gyre")


def test_a_variant_without_a_route_says_why(result: RunResult) -> None:
    failure = "seasons 'summer': all 2 classes were rejected: a gap of 18.70 m. To find a route: -"
    variants = [Variant("adaptive", result), Variant("fixed", None, failure)]
    figure = variants_figure(result, "summer", variants, with_padding=True, width_pt=504.0)
    texts = [text.get_text().replace("\n", " ") for text in figure.axes[1].texts]
    assert failure in texts
    headings = {text.get_text() for text in [*figure.texts, *figure.axes[1].texts]}
    assert "no route" in headings
