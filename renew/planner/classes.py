"""Plan classes in order until there are enough routes; if there are none, say why.

If every class is rejected, remedies are found: less padding, or more risk.
"""

import contextlib
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from renew.bounds.grids import whole_grid
from renew.bounds.travel_time import locate, mean_times
from renew.classes.class_enumerator import ClassEnumerator
from renew.classes.dual_graph import Channel, Transition, widest_gap
from renew.classes.h_signature import Word, shortened
from renew.errors import ClassName, InfeasibleError, Length, Text, TooLateError, UnreachableError
from renew.planner.fit import fitted, fitted_along
from renew.planner.free_ways import CELLS, MARGINS, FreeWays, fine_roadmap, has_fine_roadmap
from renew.planner.hindrances import hours_of, with_hours
from renew.planner.one_class import ClassPath, ClassPlanner
from renew.planner.sampled_paths import chosen_class
from renew.results import Plan, Rejected, Route, Step, tell

# A variant is a channel of a class that passes a small island, one without a ray, on another side.
# Number of variants that are searched.
_VARIANTS = 8
# Number of variants that are planned near the best route.
_BESIDE = 4
# Ratio to the best fuel up to which a route is searched for variants around small islands: the
# first estimate of fuel is no more exact.
_NEARLY_BEST = 1.0005
# Number of classes that are searched first for the best path.
_FEW = 4
# Distances from land, in v/ω, at which channels of a class are looked for that can't be steered.
_FURTHER_OFF = 1.0, 2.0, 4.0
# Numbers of classes that are searched by themselves as well, if a class is rejected.
_FEWER = 4, 16, 64
# If the dearest of these needs more than this ratio times the least fuel, later classes are assumed
# to need even more.
_CLEARLY_DEARER = 1.03
# A class whose estimated fuel is more than this ratio times the best is skipped if a cheaper class
# has a path.
_WORTH_A_LOOK = 1.25
# Share of the best fuel below which a path on a roadmap of free turns is searched: its legs lead in
# few directions.
_WORTH_A_SEARCH = 1.005
# Ratio to the best fuel up to which the padding of a class is fitted.
_CLOSE = 1.1
# Ratio of the best fuel to that of the best way on the roadmap from which padding costs so much
# that ways of free turns are searched.
_PADDED_OFF = 1.01
# Ratio of a class's fuel to that of the path on the roadmap by which it was found, up to which the
# padding of its path costs next to nothing: such a path is about half a per cent from its least.
_NEAR_LEAST = 0.998
# Largest number of such ways.
_FREE_WAYS = 4
# Number of cells of the grid on which a mean travel time is found, over land narrower than a cell,
# to see whether a better route may exist.
_GLANCE = 2_000
# Ratio to the fuel of that travel time from which a route may be far from the best.
_FAR_OFF = 1.05
# Largest number of rounds in which channels around blocked transitions are searched.
_MAX_ROUNDS = 64


def plan_classes(planner: ClassPlanner, classes: int) -> Plan:
    """Plan the first k classes, and replace each rejected class by a further one.

    If channels are blocked, other channels around all blocked places are searched, in rounds, until
    a round finds no new one. A strait that padding blocks for one class is mostly blocked for all,
    so the rounds soon find k classes that can be sailed. If they find fewer, some classes may have
    been skipped: a place blocked for another class was taken as blocked for them, or one of their
    passing edges was taken as too narrow. These classes are then planned separately, up to k.
    A class is rejected, with its first reason, when no channel of it is left.
    """
    search = ClassSearch(planner)
    search.find_first(classes)
    return search.plan(classes)


class ClassSearch:
    """Plans classes one by one, and keeps the path of each, or the first reason for its rejection.

    Classes in `known` are not planned again. With a `fuel_estimate`, only the best route is wanted:
    channels whose estimate is no less than the fuel of a found path are skipped.
    """

    def __init__(
        self,
        planner: ClassPlanner,
        known: Mapping[Word, ClassPath] | None = None,
        fuel_estimate: Callable[[Channel], float] | None = None,
    ) -> None:
        self._planner, self._estimate = planner, fuel_estimate
        self._rays = planner.problem.rays
        self.found: dict[Word, ClassPath] = dict(known or {})
        self.rejected: dict[Word, Rejected] = {}
        self._too_dear: dict[Word, float] = {}
        self._slipped: dict[Word, ClassPath] = {}
        self._done: set[Word] = set()
        self._known = dict(self.found)
        self._fitted: set[Word] = set()
        self._has_looked_further = False

    @property
    def all_found(self) -> Mapping[Word, ClassPath]:
        """The best path of each class, including paths found in the search for other classes."""
        self._add_slipped()
        return self.found

    @property
    def best(self) -> ClassPath | None:
        """The path of least fuel among all classes."""
        self._add_slipped()
        return min(self.found.values(), key=lambda found: found.fuel, default=None)

    def find_best(self, classes: int) -> None:
        """Find the best path of the first classes; of a few only, if the others are clearly worse.

        Classes are ordered by estimated fuel, which is close to their final fuel; finding many
        classes takes most of the time. Only two variants are planned, the first one and one
        beside the best route: the others differ far less in fuel than departures do.
        """
        if self._planner.options.order == "fuel":
            self._find_best(classes, _WORTH_A_LOOK)
        if self.best is None:
            self._find_best(classes, math.inf)

    def _find_best(self, classes: int, dearest: float) -> None:
        """Find the best path of classes that need at most `dearest` times the least estimate."""
        few = min(classes, _FEW)
        self.find_first(few, variants=1, beside=1, dearest=dearest)
        known = self._too_dear | {word: found.fuel for word, found in self.found.items()}
        are_all = len(known) < few and not self.rejected and math.isfinite(dearest)
        are_enough = are_all or few == classes
        if len(known) >= few and self.best is not None:
            are_enough |= max(known.values()) > _CLEARLY_DEARER * self.best.fuel
        if not are_enough:
            self.find_first(classes, variants=1, beside=1, dearest=dearest)

    def find_first(
        self,
        classes: int,
        variants: int = _VARIANTS,
        beside: int = _BESIDE,
        dearest: float = math.inf,
    ) -> None:
        """Find paths of the first k classes; see :func:`plan_classes`.

        Up to `variants` variants are tried, and up to `beside` variants near the best route.
        Classes whose estimate is more than `dearest` times the best one are skipped if there is a
        path of another class.
        """
        problem, options = self._planner.problem, self._planner.options
        clearance = problem.likely_width
        scout = problem.scout(clearance).up_to(dearest)
        enumerator = problem.enumerator(clearance).up_to(dearest)
        is_free = (
            options.order == "fuel" and options.method == "optimal" and self._planner.is_thorough
        )
        if is_free and problem.rays.omits_islands:
            # The best channel of all is also the best of its class, whichever islands it passes.
            self.plan_in_rounds(scout, min(classes, variants), self.add_variant)
        seen_all = self.plan_in_rounds(enumerator, classes, self.add)
        if self.rejected and not seen_all:
            # A place that is blocked for a later class must not shut the way of an earlier one.
            for few in itertools.takewhile(lambda few: few < classes, _FEWER):
                self.plan_in_rounds(enumerator, few, self.add)
        self._look_further_off(classes, dearest)
        count = len(self.found.keys() | self._too_dear.keys())
        is_enough = count >= classes or (
            self.found and (enumerator.has_many_triangles or math.isfinite(dearest))
        )
        # If no edge is too narrow for any class, the first round has already tried the first k.
        if not (is_enough or seen_all or enumerator.sees_all):
            for channel in problem.enumerator(0.0).channels(classes):
                if channel.word not in self.rejected:
                    self.add(channel)
        if is_free and scout.has_many_triangles:
            self.find_beside_best(scout, beside)
        elif is_free and not scout.parts and self._may_be_far_off(scout):
            for channel in scout.best_closely():
                self._done.discard(channel.word)
                self.add_variant(channel)

    def _look_further_off(self, classes: int, dearest: float) -> None:
        """Plan classes whose channels can't be steered in channels found further off land."""
        problem = self._planner.problem
        for ratio in _FURTHER_OFF:
            width = ratio * problem.voyage.vessel.turning_radius
            rejected = self.rejected.items()
            words = {one for one, why in rejected if why.strait is None and one not in self.found}
            if words and width > problem.likely_width:
                for channel in problem.enumerator(width).up_to(dearest).channels(classes):
                    if channel.word in words:
                        self._done.discard(channel.word)
                        self.add(channel)

    def plan(self, classes: int) -> Plan:
        """Return the routes of `classes` classes, least fuel first."""
        self.fit(classes)
        best = sorted(self.all_found.values(), key=lambda found: found.fuel)[:classes]
        routes = tuple(map(self._planner.route, best))
        self._reject_adrift(classes)
        rejected = tuple(one for word, one in self.rejected.items() if word not in self.found)
        water = self._planner.problem.overpowered_water
        return Plan(routes, rejected, chosen_class(routes) if routes else 0, water)

    def fit(self, classes: int) -> None:
        """Fit the padding of the best paths to their turns, and look for ways that padding shuts.

        Classes that were known before the search, and those that need much more fuel, are left.
        """
        if not self._planner.fits_padding or self._planner.problem.falls_short:
            return
        best = sorted(self.all_found, key=lambda word: self.found[word].fuel)
        for word in best[:classes]:
            known = self.found[word]
            if known.fuel > _CLOSE * self.found[best[0]].fuel:
                break
            if word not in self._fitted and known is not self._known.get(word):
                self._fitted.add(word)
                self._keep(word, fitted(self._planner, known))
        if self._planner.options.order == "fuel" and not self._has_looked_further:
            self._has_looked_further = True
            self._find_in_narrows(classes)
            self._find_free_ways(min(classes, _FREE_WAYS))

    @property
    def _is_padded_off(self) -> bool:
        """Whether padding costs much, or shuts all ways."""
        problem = self._planner.problem
        bound = problem.voyage.vessel.fuel_rate * problem.scout(problem.likely_width).least_time
        return self._least_fuel > _PADDED_OFF * bound

    @property
    def _least_fuel(self) -> float:
        """The least fuel of a found path; inf if there is none."""
        return min((one.fuel for one in self.found.values()), default=math.inf)

    def _find_in_narrows(self, classes: int) -> None:
        """Plan classes again with little padding to begin with, where padding costs much."""
        if not self._is_padded_off:
            return
        voyage = self._planner.problem.voyage
        near_least = {
            word: one
            for word, one in self.found.items()
            if one.fuel <= _NEAR_LEAST * voyage.fuel(one.corridor.rough_path)
        }
        narrow = ClassSearch(self._planner.narrow, near_least)
        narrow._has_looked_further = True
        few = min(classes, _FEW) if len(self.found) >= classes else classes
        narrow.find_first(few)
        narrow.fit(few)
        for word, found in narrow.all_found.items():
            # Turns begun in padding around an end are not judged, and narrow padding proves little.
            if not any(found.corridor.ends_in_padding):
                self._keep(word, found)

    def _find_free_ways(self, count: int) -> None:
        """Plan ways along which turns are free, if padding costs much or shuts all ways."""
        if not self._is_padded_off:
            return
        problem = self._planner.problem
        for cell in CELLS:
            if not has_fine_roadmap(problem, cell) or (cell < CELLS[0] and self.found):
                return
            graph, are_free = fine_roadmap(problem, cell), None
            for margin in MARGINS if cell == CELLS[0] else MARGINS[-1:]:
                ways = FreeWays(problem, graph, margin, are_free)
                self._keep_ways(ways, count)
                are_free = ways.are_free

    def _keep_ways(self, ways: FreeWays, count: int) -> None:
        """Plan along up to `count` ways of free turns, and keep the best path of each class."""
        problem, found = self._planner.problem, set[Word]()
        for path in ways.paths(count, _WORTH_A_SEARCH * self._least_fuel):
            if problem.word(path) not in found:
                with contextlib.suppress(InfeasibleError):
                    way = fitted_along(self._planner, path, ways)
                    found.add(problem.word(way.path))
                    self._keep(problem.word(way.path), way)

    def _keep(self, word: Word, found: ClassPath) -> None:
        """Keep a path of a class if it is the best so far; a path that was known stays."""
        best = self.found.get(word)
        if best is None or (best is not self._known.get(word) and found.fuel < best.fuel):
            self.found[word] = found
            tell(Step("path", found.path))

    def plan_in_rounds(
        self,
        enumerator: ClassEnumerator,
        classes: int,
        add: Callable[[Channel], frozenset[Transition]],
    ) -> bool:
        """Plan the first k classes around blocked places; return whether there are no others."""
        blocked: set[Transition] = set()
        there_are = classes
        for _ in range(_MAX_ROUNDS):
            known = len(blocked)
            channels = enumerator.channels(there_are, blocked)
            # More blocked places can't give more classes.
            there_are = len(channels)
            for channel in channels:
                blocked |= add(channel)
            if known == 0 and enumerator.sees_all and there_are < classes:
                return True
            if len(blocked) == known:
                break
        return False

    def add(self, channel: Channel) -> frozenset[Transition]:
        """Plan a class in a further channel; return the transitions that block the channel."""
        return frozenset() if channel.word in self.found else self._add(channel, channel.word)

    def add_variant(self, channel: Channel) -> frozenset[Transition]:
        """Plan a variant; its class keeps the best path of all its channels."""
        return self._add(channel, self._rays.of_word(channel.word))

    def find_beside_best(self, scout: ClassEnumerator, count: int) -> None:
        """Plan `count` variants around other islands, on finer roadmaps beside the best routes."""
        if self.best is None:
            return
        enough = _NEARLY_BEST * self.best.fuel
        best = [found.path for found in self.found.values() if found.fuel <= enough]
        for channel in scout.channels_beside(best, count):
            self._done.discard(channel.word)
            self.add_variant(channel)

    def _may_be_far_off(self, scout: ClassEnumerator) -> bool:
        """Whether a much better route than the best one may exist, on a closer roadmap.

        Among thin walls and in strong currents, a coarse roadmap may rank classes wrongly.
        """
        voyage = self._planner.problem.voyage
        if self.best is None or voyage.has_price or not scout.is_coarse:
            return False
        enough = self.best.fuel / _FAR_OFF
        # Times on a grid take far longer to find than that of the straight way, which islands and
        # currents hardly ever beat by as much.
        if voyage.fuel(voyage.stops) >= enough:
            return False
        grid = whole_grid(voyage, _GLANCE)
        time = locate(grid, voyage.goal).values(mean_times(grid, voyage.start, voyage.goal)).max()
        return bool(voyage.vessel.fuel_rate * time < enough)

    def _add(self, channel: Channel, word: Word) -> frozenset[Transition]:
        """Plan a channel as a channel of the class with this word."""
        if channel.word in self._done:
            return frozenset()
        if self._estimate is not None and self.found:
            estimate = self._estimate(channel)
            if estimate >= min(found.fuel for found in self.found.values()):
                self._done.add(channel.word)
                self._too_dear[word] = estimate
                return frozenset()
        asked = replace(channel, word=word)
        tell(Step("class"))
        try:
            found = self._planner.find(asked)
            own = self._planner.problem.word(found.path)
            if own != word:
                _keep_best(self._slipped, own, found)
                raise InfeasibleError("its least-fuel path slips into another class")  # noqa: TRY301 - as if none was found
        except InfeasibleError as error:
            if known := self.rejected.get(word):
                self.rejected[word] = replace(known, ways=(*known.ways, asked))
            else:
                self.rejected[word] = self.rejected_for(asked, error)
            if error.strait is None:
                self._done.add(channel.word)
            return error.blocked
        self._done.add(channel.word)
        _keep_best(self.found, word, found)
        tell(Step("path", found.path))
        return frozenset()

    def _add_slipped(self) -> None:
        """Add each path that left its class to the class that it belongs to."""
        for word, found in self._slipped.items():
            _keep_best(self.found, word, found)

    def _reject_adrift(self, classes: int) -> None:
        """Reject those of the first classes that can't keep off land adrift for long enough."""
        problem, water = self._planner.problem, self._planner.problem.adrift_water
        if water is None:
            return
        free, ends = problem.without_adrift, (problem.voyage.start, problem.voyage.goal)
        others = ClassSearch(ClassPlanner(free))
        for channel in free.scout(problem.likely_width).by_rays(self._rays).channels(classes):
            if channel.word not in self.found | self.rejected:
                error = water.reason(channel.rough_path(*ends))
                self.rejected[channel.word] = others.rejected_for(channel, error)

    def rejected_for(self, channel: Channel, error: InfeasibleError) -> Rejected:
        """Return the rejected class, the reason, and the hours when a current shuts its way."""
        hours = hours_of(channel, self._planner.problem.voyage)
        error = with_hours(error, hours)
        return Rejected(
            homotopy=channel.name,
            reason=str(error),
            channel=self._planner.problem.triangulation.corners[channel.triangles],
            strait=error.strait,
            cause=error,
            overpowered=hours,
            ways=(channel,),
            fuel_source=partial(self._planner.unpadded_fuel, channel),
        )


def _keep_best(best: dict[Word, ClassPath], word: Word, found: ClassPath) -> None:
    """Keep a path of a class if it needs less fuel than the best one so far."""
    if word not in best or found.fuel < best[word].fuel:
        best[word] = found


# Number of tries to find the largest padding that leaves a route.
_TRIES = 6
# That padding is found to within this share of the largest one that is tried.
_NEARLY = 0.98
# Largest risk that is suggested.
_MAX_RISK = 0.5
# Step between the risks that are suggested.
_RISK_STEP = 0.01
# Number of quoted reasons, and of classes named with each.
_MAX_REASONS = 3
# Number of ways that are planned with other padding.
_MAX_WAYS = 4


def no_class_error(rejected: tuple[Rejected, ...], planner: ClassPlanner) -> UnreachableError:
    """Return the error if all classes were rejected, with the first reasons and remedies."""
    if not rejected:
        return UnreachableError(
            "the search for classes met none before it ended. To find a route: take "
            'order = "fuel", whose search is led towards the goal'
        )
    alike: dict[str, list[Rejected]] = {}
    for one in rejected:
        alike.setdefault(one.reason, []).append(one)
    reasons = list[Text]()
    for group in itertools.islice(alike.values(), _MAX_REASONS):
        names = Text.joined(", ", [_class_name(one) for one in group[:_MAX_REASONS]])
        others = f" and {len(group) - _MAX_REASONS} more" if len(group) > _MAX_REASONS else ""
        classes = f"class{'es' * (len(group) > 1)}"
        reasons.append(Text(f"{classes} {{0}}{others}: {{1}}", (names, group[0].text)))
    left = len(alike) - _MAX_REASONS
    more = f" (and {left} more reason{'s' * (left > 1)})" if left > 0 else ""
    if all(isinstance(one.cause, TooLateError) for one in rejected):
        # Neither padding nor risk makes the vessel arrive much earlier.
        remedy = Text("take currents that reach further, or depart earlier")
    elif planner.options.may_fall_short and not planner.problem.falls_short:
        remedy = Text("keep less padding where the water is narrow")
    else:
        remedy = Text.joined("; ", suggest_relaxations(planner, rejected))
    count = f"all {len(rejected)} classes were" if len(rejected) != 1 else "the only class was"
    error = UnreachableError(
        f"{count} rejected: {{0}}{more}. To find a route: {{1}}", Text.joined("; ", reasons), remedy
    )
    error.causes = tuple(one.cause for one in rejected if one.cause is not None)
    straits = tuple(one.strait for one in rejected if one.strait is not None)
    if len(straits) == len(rejected):
        error.straits = straits
    return error


def _class_name(one: Rejected | Route) -> Text:
    return Text("{0}", (ClassName(shortened(one.homotopy)),))


def suggest_relaxations(planner: ClassPlanner, rejected: Sequence[Rejected]) -> list[Text]:
    """Return the gap of the widest way through, and remedies with which a whole plan has a route.

    Values are tried on the ways of rejected classes, the widest first, as a whole plan takes a
    roadmap for each padding. The value found is then planned, and left out if there is no route.
    """
    problem, options = planner.problem, planner.options
    ways = [way for one in rejected for way in one.ways]
    widest = sorted(ways, key=_narrowest_gap, reverse=True)[:_MAX_WAYS]

    def route_with(**changes: Any) -> Route | None:  # as of PlanOptions
        """Return the route of the widest way that has one with changed options, or None."""
        # Making room to turn takes long, and less padding leaves more room.
        relaxed = ClassPlanner(problem.with_options(replace(options, **changes)), thorough=False)
        for way in widest:
            with contextlib.suppress(InfeasibleError):
                return relaxed.route(relaxed.find(way))
        return None

    def planned_with(what: str, **changes: Any) -> list[Text]:  # as of PlanOptions
        """Say that changed options leave a route, and which; say nothing if they leave none."""
        search = ClassSearch(ClassPlanner(problem.with_options(replace(options, **changes))))
        search.find_best(options.classes)
        if search.best is None:
            return []
        return [Text(f"{what} would leave one, {{0}}", (_description(planner.route(search.best)),))]

    def largest(key: str, **fixed: Any) -> list[Text]:  # as of PlanOptions
        """Say up to which value of an option, beside fixed others, there is a route."""
        value = _largest(lambda tried: route_with(**{key: tried}, **fixed), most)
        if value is None or (not value and fixed):
            return []
        # In the unit of the option, whatever unit the message uses for lengths, and rounded down.
        safe = f"{value * (1 - 5e-4):.4g}"
        return planned_with(f"{key} = {safe} (planar m)", **{key: float(safe)}, **fixed)

    stops = [problem.triangulation.locate(stop) for stop in problem.voyage.stops]
    gaps = (widest_gap(problem.triangulation, *both) for both in itertools.pairwise(stops))
    widths = [Length(math.dist(*gap), gap) for gap in gaps if gap is not None]
    remedies = list[Text]()
    if not isinstance(options.padding, str) and options.padding > 0:
        remedies += planned_with('padding = "adaptive"', padding="adaptive")
    # Where padding is fitted to turns, risk matters little.
    has_risk = options.is_adaptive and not planner.fits_padding
    if has_risk and (risk := _least_risk(route_with, options.risk)):
        remedies += planned_with(f"a risk of {risk:g}", risk=risk)
    most = min(options.min_width or math.inf, max(map(_narrowest_gap, widest), default=0.0) / 2)
    pads = options.is_adaptive or options.min_width > 0  # else there is nothing to keep less of
    # A clearance that never yields goes first, as turns do not need it.
    is_held = options.clearance > options.fixed_width and options.narrow_share == 1.0
    bare = {"clearance": 0.0, "risk_at": "route"}
    less = largest("clearance") if is_held else []
    remedies += less or (largest("padding", **bare) if pads else [])
    none = Text("no other risk or padding was found that leaves one")
    narrowest = sorted(widths, key=lambda width: width.metres)[:1]
    said = [Text("the widest way through has a gap of {0}", (width,)) for width in narrowest]
    return [*said, *(remedies or [none])]


def _least_risk(route_with: Callable[..., Route | None], low: float) -> float | None:
    """Return the least risk above `low`, to 1 %, with which a way has a route; None if none has."""
    high = _MAX_RISK
    if low >= high or route_with(risk=high) is None:
        return None
    while high - low > _RISK_STEP:
        middle = math.ceil((low + high) / 2 / _RISK_STEP) * _RISK_STEP
        if middle >= high:
            break
        if route_with(risk=middle) is None:
            low = middle
        else:
            high = middle
    return high


def _largest(route_with: Callable[[float], Route | None], most: float) -> float | None:
    """Return the largest width up to `most` m, to 2 %, that leaves a route; None if none does."""
    if not 0 < most < math.inf:
        return None
    low, high = 0.0, most
    # Each try takes as long as a plan, and a little less than `most` is usually enough.
    tried = _NEARLY * most
    for number in range(_TRIES):
        if route_with(tried) is None:
            if number == 0 and route_with(0.0) is None:
                return None
            high = tried
        else:
            low = tried
        if high - low <= (1 - _NEARLY) * most:
            break
        tried = (low + high) / 2
    return low


def _narrowest_gap(way: Channel) -> float:
    """Return the width (m) of the narrowest passing edge of a channel."""
    widths = np.linalg.norm(way.left - way.right, axis=1)
    # At a via point the row has a passing edge of no length.
    return float(widths[widths > 0].min(initial=math.inf))


def _description(route: Route) -> Text:
    """Return a route's fuel and clearance as text."""
    return Text(
        f"class {{0}} for a fuel of {route.fuel:.6g}, {{1}} clear of no-go zones",
        (_class_name(route), Length(route.clearance)),
    )
