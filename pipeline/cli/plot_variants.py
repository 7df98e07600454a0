"""The runs that `renew plot` compares: few and many classes; adaptive, no and fixed padding."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager

from pipeline.errors import RequestError, StageError
from pipeline.formats.figures.kinds import Kind
from pipeline.formats.figures.variants import Variant
from pipeline.formats.shared.result import RunResult
from pipeline.formats.shared.text import distance
from pipeline.scenario.model import Scenario

Planned = Callable[[Scenario], AbstractContextManager[RunResult]]


def compared_variants(
    scenario: Scenario, kinds: Sequence[Kind], planned: Planned
) -> dict[Kind, list[Variant]]:
    """Plan the runs that some kinds of figures compare; the store keeps each of them.

    Few and many classes are compared with depth-first search, as in the paper. The fixed padding is
    the widest adaptive padding on any season's best route, and is therefore as safe everywhere.
    """
    variants: dict[Kind, list[Variant]] = {}
    if Kind.CLASSES in kinds:
        many = scenario.planner.classes
        variants[Kind.CLASSES] = [
            _variant(scenario, planned, f"k = {k}, depth-first", classes=k, order="depth-first")
            for k in dict.fromkeys((many if many > 1 else 16, 1))
        ]
    if Kind.PADDINGS in kinds:
        adaptive = _variant(scenario, planned, "adaptive padding", padding="adaptive")
        variants[Kind.PADDINGS] = [
            adaptive,
            _variant(scenario, planned, "no padding", padding="none", clearance=0.0),
        ]
        widest = _widest(adaptive.result)
        if widest > 0:
            title = f"fixed padding, {distance(widest * scenario.scale)}"
            variants[Kind.PADDINGS].append(_variant(scenario, planned, title, padding=widest))
    return variants


def _variant(scenario: Scenario, planned: Planned, title: str, **options: object) -> Variant:
    """Plan a scenario with changed planner options; if that fails, the variant has the reason."""
    planner = scenario.planner.model_copy(update=options)
    try:
        with planned(scenario.model_copy(update={"planner": planner})) as result:
            return Variant(title, result)
    except (RequestError, StageError) as error:
        return Variant(title, None, str(error))


def _widest(result: RunResult | None) -> float:
    """Return the widest padding on any season's best route, planar metres."""
    best = [one.route for one in result.routes if one.rank == 1] if result else []
    return max((float(route.padding_used[:, 4].max(initial=0.0)) for route in best), default=0.0)
