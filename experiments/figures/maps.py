"""Maps: all baselines in an environment, k = 16 beside k = 1, and the ablation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import shapely

from experiments.baselines.registry import PLANNERS
from experiments.environments.loading import Environment
from experiments.environments.model import Case
from experiments.jobs import Judged
from experiments.tables.summary import Runs
from experiments.tables.tables import Results
from pipeline.formats.appearance import COLOURS
from pipeline.formats.figures.chart_map import add_layers, map_figure, stroke
from pipeline.formats.figures.season_map import draw_case, land_handles, soft_handle, soft_layer
from renew._types import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

# Colours of planners (Okabe and Ito); further planners repeat them with dashed lines.
_COLOURS = ("#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8b5a2b", "#444444")


@dataclass(frozen=True)
class _Map:
    """A map of a case: its two titles, lines that are its legend as well, and padding (e, 5)."""

    titles: tuple[str, str]
    case: Case
    lines: Sequence[Line2D]
    padding: FloatArray | None = None


def all_planners(environment: Environment, case: Case, results: Results) -> Figure:
    """The paper's baselines, smoothed, and the rivals with our padding, beside our route."""
    maps = []
    for group, water, titles in (
        ("paper", "bare", ("The paper's baselines", "unpadded, smoothed, seed 0")),
        ("fuel", "padded", ("Rivals with our padding", "best seed")),
    ):
        drawn = Runs.of(results.of(environment.spec, case, "RENEW")).paths
        lines = [_line("RENEW", one, _with_fuel("RENEW", one)) for one in drawn]
        for name in (planner.name for planner in PLANNERS.values() if planner.group == group):
            runs = results.of(environment.spec, case, name, water)
            is_paper = group == "paper"
            found = Runs.of(runs[:1], is_smoothed=True) if is_paper else Runs.of(runs)
            if found.paths:
                best = min(found.paths, key=lambda one: one.judgement.fuel)
                lines.append(_line(name, best, _with_fuel(name, best)))
        maps.append(_Map(titles, case, lines))
    return _figure(environment, maps)


def few_and_many_classes(environment: Environment, results: Results) -> Figure | None:
    """K = 1 beside k = 16 of a depth-first search, as in the paper."""
    swept = dict(results.swept(environment.spec, "depth-first"))
    if not {1, 16} <= swept.keys():
        return None
    maps = []
    for k in (1, 16):
        paths = Runs.of([swept[k]]).paths
        titles = (f"k = {k}, depth-first", ", ".join(_with_fuel("fuel", one) for one in paths))
        lines = [_line("RENEW", one, "RENEW") for one in paths]
        maps.append(_Map(titles, environment.spec.cases[0], lines))
    return _figure(environment, maps)


def ablation(environment: Environment, results: Results) -> Figure:
    """Our route and A*'s in each case, with the padding."""
    maps = []
    for case in environment.spec.cases:
        ours = results.of(environment.spec, case, "RENEW")
        theirs = results.of(environment.spec, case, "A*")
        drawn = [("RENEW", "RENEW", one) for one in Runs.of(ours).paths]
        drawn += [("A*", "A* smoothed", one) for one in Runs.of(theirs, is_smoothed=True).paths]
        fuels = ", ".join(_with_fuel(label, one) for _, label, one in drawn)
        lines = [_line(name, one, label) for name, label, one in drawn]
        padding = ours[0].padding if ours else None
        maps.append(_Map((case.title, fuels), case, lines, padding))
    return _figure(environment, maps)


def _figure(environment: Environment, maps: Sequence[_Map]) -> Figure:
    """Draw maps side by side, as those of any run, with one legend."""
    result = environment.result
    legend = {str(line.get_label()): line for one in maps for line in one.lines}
    soft = [soft_handle()] if any(one.padding is not None for one in maps) else []
    figure, drawn = map_figure(
        result,
        [*legend.values(), *land_handles(result), *soft],
        titles=[one.titles for one in maps],
        columns=len(maps),
    )
    for one, (axes, sea) in zip(maps, drawn, strict=True):
        draw_case(axes, sea, result.case(one.case.season))
        area = [] if one.padding is None else [soft_layer(axes, _soft(one.padding))]
        add_layers(axes, [*area, *one.lines], sea)
    return figure


def _line(name: str, judged: Judged, label: str) -> Line2D:
    """A planner's path; ours stands out."""
    if name == "RENEW":
        line = stroke(judged.candidate.path, COLOURS["best"], 2.4, 7)
    else:
        number = list(PLANNERS).index(name)
        line = stroke(judged.candidate.path, _COLOURS[number % len(_COLOURS)], 1.1, 6)
        line.set_linestyle("-" if number < len(_COLOURS) else "--")
    line.set_label(label)
    return line


def _with_fuel(text: str, judged: Judged) -> str:
    return f"{text} {judged.judgement.fuel:.1f}"


def _soft(padding: FloatArray) -> shapely.geometry.base.BaseGeometry:
    """Soft no-go zone of padded edges (e, 5)."""
    padded = padding[padding[:, 4] > 0]
    lines = shapely.linestrings(padded[:, :4].reshape(-1, 2, 2))
    return shapely.union_all(shapely.buffer(lines, padded[:, 4]))
