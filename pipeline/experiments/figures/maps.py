"""Maps: all baselines in an environment, k = 16 beside k = 1, and the ablation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import shapely
from matplotlib.figure import Figure

from pipeline.experiments.baselines.registry import PLANNERS
from pipeline.experiments.figures.canvas import (
    draw_area,
    draw_environment,
    draw_path,
    mark_ends,
)
from pipeline.experiments.tables.summary import Runs
from pipeline.formats.figures.palette import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pipeline.experiments.environments.loading import Environment
    from pipeline.experiments.environments.model import Case
    from pipeline.experiments.jobs import Judged, Result
    from pipeline.experiments.tables.tables import Results
    from renew._types import FloatArray

# Padding (m) above which a buffered edge is drawn.
_DRAWN = 0.0


def all_planners(environment: Environment, case: Case, results: Results) -> Figure:
    """The paper's baselines, smoothed, and the rivals with our padding, beside our route."""
    spec = environment.spec
    figure = Figure(figsize=(12.5, 6.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for axes, group, water, title in (
        (left, "paper", "bare", "the paper's baselines, unpadded, smoothed, seed 0"),
        (right, "fuel", "padded", "rivals with our padding, best seed"),
    ):
        _scene(axes, environment, case, f"{spec.title}: {title}")
        number = 0
        for planner in PLANNERS.values():
            if planner.group != group:
                continue
            runs = results.of(spec, case, planner.name, water)
            found = Runs.of(runs[:1] if group == "paper" else runs).paths
            if group == "paper":
                found = Runs.of(runs[:1], is_smoothed=True).paths
            if found:
                best = min(found, key=lambda one: one.judgement.fuel)
                draw_path(axes, best.candidate.path, _label(planner.name, best), number)
                number += 1
        _ours(axes, results.of(spec, case, "RENEW"))
        _legend(axes)
    return figure


def few_and_many_classes(environment: Environment, results: Results) -> Figure | None:
    """K = 1 beside k = 16 of a depth-first search, as in the paper."""
    swept = dict(results.swept(environment.spec, "depth-first"))
    if not {1, 16} <= swept.keys():
        return None
    figure = Figure(figsize=(12.5, 5.8), layout="constrained")
    for axes, k in zip(figure.subplots(1, 2), (1, 16), strict=True):
        title = f"{environment.spec.title}: k = {k}, depth-first"
        _scene(axes, environment, environment.spec.cases[0], title)
        _ours(axes, [swept[k]])
        _legend(axes)
    return figure


def ablation(environment: Environment, results: Results) -> Figure:
    """Our route and A*'s in each case, with the padding."""
    cases = environment.spec.cases
    figure = Figure(figsize=(3.2 * len(cases), 4.4), layout="constrained")
    for axes, case in zip(figure.subplots(1, len(cases)), cases, strict=True):
        _scene(axes, environment, case, case.title)
        ours = results.of(environment.spec, case, "RENEW")
        if ours:
            draw_area(axes, _soft(ours[0].padding), COLOURS["soft"], COLOURS["soft"], 0.35)
        runs = Runs.of(results.of(environment.spec, case, "A*"), is_smoothed=True)
        for one in runs.paths:
            draw_path(axes, one.candidate.path, _label("A* smoothed", one), 1)
        _ours(axes, ours)
        _legend(axes, columns=1, below=0.24)
    return figure


def _scene(axes: Axes, environment: Environment, case: Case, title: str) -> None:
    draw_environment(axes, environment.chart, environment.currents[case.season], title)
    mark_ends(axes, environment.start, environment.goal)


def _ours(axes: Axes, results: list[Result]) -> None:
    for one in Runs.of(results).paths:
        draw_path(axes, one.candidate.path, _label("RENEW", one), None)


def _label(name: str, judged: Judged) -> str:
    return f"{name}  {judged.judgement.fuel:.1f}"


def _legend(axes: Axes, columns: int = 4, below: float = 0.11) -> None:
    """Name the paths below the map, where they hide none of it."""
    axes.legend(
        fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -below), ncols=columns,
        title="fuel", title_fontsize=8, frameon=False,
    )  # fmt: skip


def _soft(padding: FloatArray) -> shapely.geometry.base.BaseGeometry:
    """Soft no-go zone of padded edges (e, 5)."""
    padded = padding[padding[:, 4] > _DRAWN]
    lines = shapely.linestrings(padded[:, :4].reshape(-1, 2, 2))
    return shapely.union_all(shapely.buffer(lines, padded[:, 4]))
