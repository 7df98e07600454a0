"""Choose the class of the way ahead: the one that was planned, unless another saves enough."""

from renew._types import FloatArray
from renew.classes.h_signature import Word
from renew.errors import InfeasibleError
from renew.planner.classes import ClassSearch, no_class_error
from renew.planner.one_class import ClassPath, ClassPlanner, as_drawn, fuel_estimate
from renew.planner.plan import meetings, plan_request, planner_of
from renew.planner.problem import check_current_at_endpoints
from renew.request import Request
from renew.results import Plan, Rejected, Route
from renew.underway.lead import channel_along, led_in

# Share of the fuel that a new path has to save to replace the planned one; two searches for the
# same path differ by less.
_WORTH = 1e-4
# Ratio of a class's estimate on the roadmap to its fuel; it is hardly ever exceeded.
_ROUGH = 1.03


def choose(
    request: Request,
    ahead: FloatArray | None,
    heading: float | None,
    switch_above: float,
    *,
    is_proven: bool,
    track: FloatArray | None,
) -> tuple[Plan, Route | None]:
    """Choose between the class of the way `ahead` (n, 2) that was planned, if any, and others.

    The vessel has a `heading` (rad) if one is given. `is_proven`: the plan is proven for the vessel
    at this place and time, in the same current; the way ahead is then kept as it is. `track` (m, 4)
    is the rest of the planned trajectory if the vessel is in time for it, else None.
    Returns the plan from here on, and the route in the class planned: the plan's best one if that
    class is kept, None if it can't be sailed.
    Raises PlanningError if no class can be sailed.
    """
    planner = planner_of(request)
    problem = planner.problem
    check_current_at_endpoints(problem.voyage)
    word = None if ahead is None else problem.word(ahead)
    if request.areas or request.options.method == "sampled":
        whole = plan_request(request)
        routes, rejected = list(whole.routes), list(whole.rejected)
    else:
        search = _searched(planner, ahead, word, switch_above, is_proven, track)
        routes = [planner.route(found) for found in search.all_found.values()]
        rejected = [one for key, one in search.rejected.items() if key not in search.found]
    routes.sort(key=lambda one: one.fuel)
    kept = next((one for one in routes if problem.word(one.path) == word), None)
    if kept is not None and routes[0].fuel >= (1 - switch_above) * kept.fuel:
        routes = [kept, *(one for one in routes if one is not kept)]
    for at, route in enumerate(routes):
        reason: InfeasibleError | None = None
        try:
            best = led_in(route, planner, heading, follow=_follow, is_proven=is_proven)
        except InfeasibleError as error:
            reason = error
        else:
            reason = next(iter(meetings(best, request.areas, planner).values()), None)
        if reason is not None:
            rejected.append(Rejected.of_route(route, reason))
            kept = None if route is kept else kept
            continue
        plan = Plan((best, *routes[at + 1 :]), tuple(rejected), 0, problem.overpowered_water)
        return plan, best if route is kept else kept
    raise no_class_error(tuple(rejected), planner)


def _searched(
    planner: ClassPlanner,
    ahead: FloatArray | None,
    word: Word | None,
    switch_above: float,
    is_proven: bool,
    track: FloatArray | None,
) -> ClassSearch:
    """Return the search with the planned class, and with classes that may save enough against it.

    All classes are planned if the planned one can't be sailed.
    """
    classes, search = planner.options.classes, ClassSearch(planner)
    kept: ClassPath | None = None
    if ahead is not None:
        try:
            kept = _follow(planner, ahead, is_proven=is_proven, track=track)
        except InfeasibleError as error:
            channel = channel_along(ahead, planner.problem)
            if channel is not None:
                search.rejected[channel.word] = search.rejected_for(channel, error)
    if kept is None or word is None:
        search.find_first(classes)
        return search
    if switch_above >= 1:
        return ClassSearch(planner, {word: kept})
    enough = 1 - switch_above
    search = ClassSearch(
        planner, {word: kept}, lambda channel: fuel_estimate(planner.unpadded, channel) / enough
    )
    voyage, options = planner.problem.voyage, planner.options
    enumerator = planner.problem.enumerator(options.likely_width(voyage.vessel.turning_radius))
    quickest = enumerator.channels(1)
    if quickest:
        rough = voyage.fuel(quickest[0].rough_path(voyage.start, voyage.goal))
        dearest = _ROUGH * enough * kept.fuel / rough
        if dearest > 1:
            search.plan_in_rounds(enumerator.up_to(dearest), classes, search.add)
    return search


def _follow(
    planner: ClassPlanner,
    ahead: FloatArray,
    *,
    is_proven: bool = False,
    track: FloatArray | None = None,
) -> ClassPath:
    """Return the best path in the class of the way ahead (n, 2): that way itself if it is as good.

    Raises InfeasibleError if the class has no path.
    """
    channel = channel_along(ahead, planner.problem)
    if channel is None:
        raise InfeasibleError("the way that was planned leads over land from {0}", ahead[0])
    if track is not None:
        fuel = planner.problem.voyage.fuel(ahead)
        corridor = planner.growth.fitted(planner.corridor(channel), ahead)
        return ClassPath(corridor, ahead, track, fuel, fuel)
    drawn = as_drawn(planner, ahead, channel)
    if drawn is not None and is_proven:
        return drawn
    try:
        found = planner.find(channel)
        if planner.problem.word(found.path) != channel.word:
            raise InfeasibleError("its least-fuel path slips into another class")  # noqa: TRY301 - as if none was found
    except InfeasibleError:
        if drawn is None:
            raise
        return drawn
    if drawn is not None and found.fuel > (1 - _WORTH) * drawn.fuel:
        return drawn
    return found
