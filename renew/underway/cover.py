"""Find out where along a route a haven can be reached in time, and where to turn off at last."""

from collections.abc import Sequence
from typing import Unpack

from renew.inputs.chart import Chart
from renew.inputs.current import CurrentLike
from renew.inputs.haven import Haven
from renew.inputs.options import Changes, PlanOptions
from renew.inputs.vessel import Vessel
from renew.request import Request
from renew.results import Route
from renew.underway.class_turns import check_others, class_turns
from renew.underway.coverage import Coverage
from renew.underway.diversions import Diverter
from renew.underway.survey import Survey
from renew.underway.turn_points import abort_points, equal_points, no_return
from renew.underway.usable_havens import check_cover, usable


def cover(
    route: Route,
    chart: Chart,
    current: CurrentLike,
    vessel: Vessel,
    havens: Sequence[Haven],
    *,
    within: float | None = None,
    within_fuel: float | None = None,
    endurance: float | None = None,
    others: Sequence[Route] = (),
    dearer_by: float = 0.02,
    options: PlanOptions | None = None,
    **changes: Unpack[Changes],
) -> Coverage:
    """Find out from which places of a route a planned way leads to a haven within limits.

    Parameters
    ----------
    route : Route
        A route at constant speed, from `renew.plan` or `renew.replan`.
    chart, current, vessel
        Those that the route was planned with.
    havens : sequence of Haven
        The user's list; nothing is added to it.
    within : float, optional
        Longest time to a haven (s).
    within_fuel : float, optional
        Most fuel to a haven (fuel units).
    endurance : float, optional
        Fuel on board at departure (fuel units): a diversion can use what is left where the vessel
        turns off.
    others : sequence of Route, optional
        Routes of other classes by the same plan, ``plan.routes``: until where can the vessel still
        change to each? Not for plans with via points.
    dearer_by : float
        Share of its fuel from the start by which the voyage may become dearer until such a change.
    options, **changes
        Those of the route's plan, such as ``drift="crab"``.

    Returns
    -------
    Coverage
        Stretches that are covered, uncovered, or not settled; abort points, the point of no return,
        equal points, and the last places to change to other classes. Ways begin on the route's
        heading; they are padded and steered as for :func:`renew.plan`, and their turns are
        simulated, from the end of the first arc on.

    Raises
    ------
    ParameterError
        No limit, or one that no route can keep; a route that chose speeds, or of another vessel or
        current; havens that can't be used, if none is left.
    """
    limits = check_cover(
        route, chart, vessel, havens, within=within, within_fuel=within_fuel, endurance=endurance
    )
    check_others(others, dearer_by)
    request = Request.of(
        chart,
        current,
        vessel,
        (route.path[0], route.path[-1]),
        options=options,
        changes=changes,
        departure=float(route.trajectory[0, 0]),
    )
    usable_ones, left_out = usable(havens, request, route)
    survey = Survey(Diverter(request, route), tuple(usable_ones), limits)
    stretches = survey.stretches()
    aborts, equals = abort_points(survey), equal_points(survey)
    no_way_back = no_return(survey)
    turns = class_turns(survey.diverter, others, dearer_by)
    faults = [survey.diverter.fault(number) for number in range(len(usable_ones))]
    found = list(zip(usable_ones, faults, strict=True))
    left_out += [(haven, fault) for haven, fault in found if fault is not None]
    return Coverage(
        route=route,
        abort_points=aborts,
        no_return=no_way_back,
        equal_points=equals,
        class_turns=turns,
        havens=tuple(haven for haven, fault in found if fault is None),
        left_out=tuple(left_out),
        stretches=tuple(stretches),
        diversions=survey.diverter.found,
        within=limits.within,
        within_fuel=limits.within_fuel,
        endurance=limits.endurance,
    )
