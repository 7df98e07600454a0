"""The last places of a route from which to change to the classes of other routes.

From an earlier place the change costs no more: the vessel may sail on along the route, and change
later, in the same class. So the last place is found by bisection.
"""

from collections.abc import Sequence

from renew.errors import ParameterError, PlanningError, check_kind, is_finite, shown
from renew.planner.plan import planner_of
from renew.results import Route
from renew.underway.coverage import ClassTurn
from renew.underway.diversions import Diverter

# Number of parts of the route's time to which the last place is narrowed.
_PARTS = 64


def check_others(others: Sequence[Route], dearer_by: object) -> None:
    """Refuse other routes, and a share by which a voyage may become dearer, that can't be used."""
    for at, other in enumerate(others):
        check_kind(f"others[{at}]", other, Route)
    if not (is_finite(dearer_by) and 0 <= dearer_by <= 1):
        raise ParameterError(f"dearer_by = {shown(dearer_by)} must be a share from 0 to 1")


def class_turns(
    diverter: Diverter, others: Sequence[Route], dearer_by: float
) -> tuple[ClassTurn, ...]:
    """Return the last places to change to other routes' classes, dearer by a share at most."""
    word = planner_of(diverter.request).problem.word
    own = word(diverter.route.path)
    found = (
        _last_turn(diverter, other, (1 + dearer_by) * other.fuel)
        for other in others
        if word(other.path) != own
    )
    return tuple(one for one in found if one is not None)


def _last_turn(diverter: Diverter, other: Route, most: float) -> ClassTurn | None:
    """Return the last place to change to a class so that the voyage takes at most some fuel."""
    good, bad, last = 0, _PARTS, None
    while bad - good > 1:
        middle = (good + bad) // 2
        turn = _turn(diverter, other, middle / _PARTS)
        if turn is None or turn.fuel > most:
            bad = middle
        else:
            good, last = middle, turn
    return last


def _turn(diverter: Diverter, other: Route, share: float) -> ClassTurn | None:
    """Return the change to another route's class after a share of the route's time, if possible."""
    spent = share * (diverter.end - diverter.begin)
    try:
        way = diverter.onto(other, diverter.begin + spent)
    except PlanningError:
        return None
    return ClassTurn(other, way, diverter.request.vessel.fuel_rate * spent + way.fuel)
