"""All figures of a run, each with its caption."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from experiments.environments.model import Case, EnvironmentSpec
from experiments.figures import curves, maps
from experiments.tables.tables import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Drawing:
    """A figure, the name of its file, and its caption."""

    name: str
    figure: Figure
    caption: str


def _by_season(spec: EnvironmentSpec) -> list[Case]:
    """The first case of each season: baselines differ by the current only."""
    first: dict[str, Case] = {}
    for case in spec.cases:
        first.setdefault(case.season, case)
    return list(first.values())


def drawings(found: Findings) -> Iterator[Drawing]:
    """Draw all figures that the environments of a run allow."""
    by_name = {environment.spec.name: environment for environment in found.environments}
    for environment in found.environments:
        spec = environment.spec
        if spec.name not in ("ablation", "eddies") and spec.baselines != ():
            for case in _by_season(spec):
                figure = maps.all_planners(environment, case, found.results)
                caption = (
                    f"{spec.title}, {case.title}: our route, the paper's baselines and rivals."
                )
                is_first = case is spec.cases[0]
                name = f"{spec.name}-planners" if is_first else f"{spec.name}-{case.name}-planners"
                yield Drawing(name, figure, caption)
    if (four := by_name.get("four-gyre")) is not None:
        figure_of_k = maps.few_and_many_classes(four, found.results)
        if figure_of_k is not None:
            caption = "One class of a depth-first search beside the best of sixteen."
            yield Drawing("four-gyre-classes", figure_of_k, caption)
        timed = curves.fuel_against_seconds(four.spec, found.results)
        if timed is not None:
            caption = (
                "Fuel against CPU time at equal padding: median and quartiles over the seeds, "
                "with growing budgets."
            )
            yield Drawing("fuel-against-seconds", timed, caption)
    if (scene := by_name.get("ablation")) is not None:
        caption = "The ablation's four cases; grey is the padding that our route keeps."
        yield Drawing("ablation", maps.ablation(scene, found.results), caption)
    if (eddies := by_name.get("eddies")) is not None:
        caption = (
            "Rivals beside RENEW as the eddies become smaller, unpadded, one seed each. The paths "
            "of rivals need not be steerable; ours is."
        )
        yield Drawing("eddies", curves.loss_against_size(eddies.spec, found.results), caption)
    caption = (
        "Turning circles beside an edge (to port solid, to starboard dashed), and the distribution "
        "of their reach. The current and its "
        "spread are ours: the inputs of the published pair 4.47 m and 1.96 m are not in the paper."
    )
    vessel = found.environments[0].result.cases[0].case.vessel
    yield Drawing("turning-circles", curves.turning_circles(vessel), caption)
