"""Plan the best route of one homotopy class: padding, path, trajectory, and simulated turns."""

import contextlib
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely

from renew._types import FloatArray
from renew.classes.dual_graph import Channel
from renew.classes.h_signature import name
from renew.errors import InfeasibleError, Moment, TooLateError
from renew.inputs.options import PlanOptions
from renew.paths.corridor import Corridor
from renew.paths.least_fuel_path import check_straits, refined_path
from renew.paths.speed_profile import SpeedProfile, speed_profile
from renew.planner import grow
from renew.planner.hindrances import hours_along, hours_of, with_clearance
from renew.planner.narrow_water import Tight, shortfalls, steered_tightly, with_room
from renew.planner.problem import Problem
from renew.planner.sampled_paths import sampled_paths
from renew.results import Route, Step, tell
from renew.steering.steer_in_corridor import steer_as_drawn
from renew.turns.padding_model import PaddedEdges, PaddingModel, region_of
from renew.turns.verification import passage_windows
from renew.voyage.voyage import Voyage

# Other attempts are made if a path needs this many times as much fuel after steering as before.
_DEAR = 1.01
# Largest risk of the padding with which paths are searched first whose padding is then fitted to
# their turns; and the risk of narrow padding, with which they are searched where that costs much.
_WIDE = 0.05
_NARROW = 0.5
# Number of rounds of growing padding before a class is rejected.
_MAX_ROUNDS = 8


class ClassPath(NamedTuple):
    """The best path (n, 2) of a class, its trajectory (m, 4), its fuel and its corridor.

    `harmonic_mean` is the value by which its class is chosen. `profile` has the speeds along the
    path if the vessel chooses speeds. Stretches `tight` are steered as if the vessel turned faster.
    """

    corridor: Corridor
    path: FloatArray
    trajectory: FloatArray
    fuel: float
    harmonic_mean: float
    profile: SpeedProfile | None = None
    tight: tuple[Tight, ...] = ()


class ClassPlanner:
    """Plans the best route of a class, with the padding `model` if one is given.

    A `thorough` planner tries variants, and adds padding where a path can't be steered. A `narrow`
    one begins with little padding, and relies on simulated turns alone.
    """

    def __init__(
        self,
        problem: Problem,
        model: PaddingModel | None = None,
        *,
        thorough: bool = True,
        narrow: bool = False,
    ) -> None:
        self.problem, self.is_thorough = problem, thorough
        voyage = problem.voyage
        risk = problem.options.risk
        if self.fits_padding:
            risk = _NARROW if narrow else min(risk, _WIDE)
        self._model = model or PaddingModel(
            problem.triangulation,
            voyage.waters.padded_for,
            voyage.vessel,
            replace(problem.options, risk=risk),
        )
        self.growth = grow.PaddingGrowth(
            problem, self._model, are_fitted=narrow or problem.falls_short
        )

    @property
    def options(self) -> PlanOptions:
        """How its problem is planned."""
        return self.problem.options

    def for_problem(self, problem: Problem) -> "ClassPlanner":
        """Return the planner of a problem in the same water; it shares options and paddings."""
        same = problem.with_options(self.options)
        return ClassPlanner(same, self._model, thorough=self.is_thorough)

    @property
    def fits_padding(self) -> bool:
        """Whether padding is fitted to the turns of paths."""
        options = self.options
        return (
            options.padding == "adaptive"
            and options.method == "optimal"
            and options.risk_at == "route"
            and self.is_thorough
            and not self.problem.voyage.has_price
        )

    @cached_property
    def narrow(self) -> "ClassPlanner":
        """The planner of the same classes that begins with little padding."""
        return ClassPlanner(self.problem, narrow=True)

    @cached_property
    def unpadded(self) -> "ClassPlanner":
        """The planner of the same classes without adaptive padding."""
        if not self.options.is_adaptive:
            return self
        bare = replace(self.options, padding="none", risk_at="route")
        return ClassPlanner(self.problem.with_options(bare))

    def find(self, channel: Channel) -> ClassPath:
        """Return the best path of a class; padding grows until every hard-over turn is clear.

        If each attempt slips past an islet, the path is of another class. Raises InfeasibleError,
        with the reason, if there is no path.
        """
        found = self.find_in(self.corridor(channel))
        if not found.corridor.follows_open_outline(found.path):
            return found
        wider = found.corridor.channel_along(found.path)
        with contextlib.suppress(InfeasibleError):
            return min(found, self.find_in(self.corridor(wider)), key=lambda one: one.fuel)
        return found

    def find_in(self, corridor: Corridor, near: FloatArray | None = None) -> ClassPath:
        """Return the best path of a corridor, near an earlier path (n, 2) if given."""

        def again(wider: Corridor, found: ClassPath) -> ClassPath:
            try:
                return self._found(wider, found.path)
            except InfeasibleError:
                if not self.problem.falls_short:
                    raise
            return self._found(self._with_room(wider), found.path)

        return grown_until_clear(
            self._found(corridor, near),
            lambda found: self.growth.shortfall(found.corridor, found.path),
            again,
            _MAX_ROUNDS,
        )

    def near(self, corridor: Corridor, path: FloatArray) -> ClassPath:
        """Return a path (n, 2) of a corridor after steering, without other attempts."""
        found = self._steered_in_class(corridor, corridor, path)
        if found is None:
            raise InfeasibleError("its least-fuel path slips into another class")
        return found

    def route(self, found: ClassPath) -> Route:
        """Return the route along a path, with all figures, at the speeds of its profile if any."""
        corridor, path, trajectory, fuel, class_mean, profile, tight = found
        voyage, paddings = self.problem.voyage, corridor.paddings
        starts_in_padding, ends_in_padding = corridor.ends_in_padding
        if profile is None:
            speeds, times = np.full(len(path) - 1, voyage.vessel.speed), voyage.arrivals(path)
            duration = fuel / voyage.vessel.fuel_rate
        else:
            path, speeds, times, fuel, _ = profile
            trajectory = steer_as_drawn(path, corridor, speeds)
            duration, class_mean = float(times[-1] - times[0]), fuel
        line = shapely.LineString(path)
        track = shapely.LineString(trajectory[:, 1:3])
        clearance = math.inf
        if voyage.chart.no_go:
            clearance = min(shapely.distance([line, track], voyage.chart.hard_no_go))
        return Route(
            path=path,
            trajectory=trajectory,
            fuel=fuel,
            length=voyage.chart.length(path),
            clearance=float(clearance),
            duration=duration,
            times=times,
            speeds=speeds,
            fuel_bound=self.problem.fuel_bound,
            homotopy=name(self.problem.word(path)),
            corners=corridor.corners,
            padding_used=np.vstack(
                [
                    np.column_stack([one.start, one.end, one.padding.clip(min=0.0)])
                    for one in paddings
                ]
            ),
            turn_padding=np.concatenate([one.turns for one in paddings]),
            harmonic_mean=class_mean,
            starts_in_soft_no_go=starts_in_padding,
            ends_in_soft_no_go=ends_in_padding,
            overpowered=hours_along(path, times, voyage) or hours_of(corridor.channel, voyage),
            shortfalls=(
                shortfalls(path, tight, self.problem, speeds) if self.options.may_fall_short else ()
            ),
        )

    def unpadded_fuel(self, channel: Channel) -> float:
        """Return a class's least fuel without any padding, or inf if it has no path even then."""

        def bare(own: Channel, voyage: Voyage, path: FloatArray) -> PaddedEdges:
            edges = self._beside(own, voyage, path)
            return replace(edges, padding=np.zeros(len(edges.edge)))

        try:
            _, path = grow.path_from(self._corridor(channel, bare), grow.near_rough, self.growth)
        except InfeasibleError:
            return math.inf
        voyage = self.problem.voyage
        return speed_profile(path, voyage).fuel if voyage.has_price else voyage.fuel(path)

    def corridor(self, channel: Channel) -> Corridor:
        """Return the corridor in which a class's paths are planned."""
        options, triangulation = self.options, self.problem.triangulation

        def padded(own: Channel, voyage: Voyage, path: FloatArray) -> PaddedEdges:
            edges = self._beside(own, voyage, path)
            return with_clearance(
                edges, options.clearance, options.narrow_share, own, voyage, triangulation
            )

        corridor = self._corridor(channel, padded)
        return self._with_room(corridor) if self.problem.falls_short else corridor

    def _with_room(self, corridor: Corridor) -> Corridor:
        """Return the corridor with padding that leaves a way through it; a clearance stays."""
        options = self.options
        least = options.clearance if options.narrow_share == 1.0 else -math.inf
        return with_room(corridor, self.problem.triangulation, least)

    def _corridor(
        self, channel: Channel, padded_edges: Callable[[Channel, Voyage, FloatArray], PaddedEdges]
    ) -> Corridor:
        """Return a class's corridor with the padding of each part between two stops."""
        voyage, triangulation = self.problem.voyage, self.problem.triangulation
        parts = voyage.parts(channel.rough_path(voyage.start, voyage.goal))
        padded = [
            padded_edges(own, *part)
            for own, part in zip(channel.parts or (channel,), parts, strict=True)
        ]
        region = np.array(list(region_of(triangulation, channel)))
        corridor = Corridor(
            voyage=voyage,
            polar=voyage.polar,
            channel=channel,
            triangles=region,
            corners=triangulation.corners[region],
            open_outline=triangulation.open_outline(region),
            padded=padded[0],
        )
        return corridor.with_padding(padded)

    def _beside(self, channel: Channel, voyage: Voyage, path: FloatArray) -> PaddedEdges:
        """Return the padding for turns beside a channel without via points, for a path (n, 2)."""
        middle = channel.midline(voyage.start, voyage.goal)
        windows = passage_windows(voyage, path, middle[:-1], middle[1:])
        return self._model.padded_edges(channel, voyage.start, voyage.goal, windows)

    def _found(self, corridor: Corridor, near: FloatArray | None) -> ClassPath:
        """Return the best path of a corridor, near the path found with less padding, if any."""
        if self.options.method == "sampled":
            return self._best_sample(corridor)
        if near is None:
            check_straits(corridor)
        return self._best_path(corridor, near)

    def _best_path(self, corridor: Corridor, near: FloatArray | None) -> ClassPath:
        """Return the best path of several attempts.

        The path is of another class only if all attempts slip into another class.
        """
        first: InfeasibleError | None = None
        best: ClassPath | None = None
        slipped: list[tuple[Corridor, FloatArray]] = []
        for attempt in grow.attempts(corridor, near, self.growth):
            try:
                used, path = attempt()
                found = self._steered_in_class(corridor, used, path)
            except InfeasibleError as error:
                if error.strait is not None:
                    raise
                first = first or error
                continue
            if found is None:
                slipped.append((used, path))
                if near is not None and not self._is_of(corridor, near):
                    # With less padding, too, each attempt slipped into another class.
                    break
                continue
            if best is None or found.fuel < best.fuel:
                best = found
            if near is not None or found.fuel <= _DEAR * self.problem.voyage.fuel(path):
                break
            # Making room to turn cost much fuel, and another path may need less room. If only
            # padding has grown, other attempts have been made already.
        if best is None and slipped:
            best = self._steered(corridor, *slipped[0])
        if best is None:
            raise first or InfeasibleError("no path was found")
        return self._straight_if_cheaper(best)

    def _straight_if_cheaper(self, found: ClassPath) -> ClassPath:
        """Return a found path, or the straight line if this is clear and needs less fuel.

        Paths are searched in a table of the current. Where the field hardly changes across the
        line, a bend may save fuel in the table but not in the field.
        """
        voyage, corridor = self.problem.voyage, found.corridor
        straight = voyage.stops
        if not self._is_of(corridor, straight) or voyage.fuel(straight) >= found.fuel:
            return found
        if all(part.legs_clear(piece).all() for part, piece in corridor.parts(straight)):
            with contextlib.suppress(InfeasibleError):
                other = self._steered_in_class(corridor, corridor, straight)
                return min(found, other or found, key=lambda one: one.fuel)
        return found

    def _steered_in_class(
        self, corridor: Corridor, used: Corridor, path: FloatArray
    ) -> ClassPath | None:
        """Return a found path (n, 2) after steering; None if it slips into another class."""
        found = self._steered(corridor, used, path) if self._is_of(corridor, path) else None
        return found if found is not None and self._is_of(corridor, found.path) else None

    def _steered(self, corridor: Corridor, used: Corridor, path: FloatArray) -> ClassPath:
        """Steer a path (n, 2) found in the corridor, or in `used` with more padding."""
        makes_room = self.is_thorough and used.polar.crab == corridor.polar.crab
        steered = grow.steered_with_room if makes_room else grow.steered_as_it_is
        tight: tuple[Tight, ...] = ()
        try:
            used, path, trajectory = steered(used, path)
        except InfeasibleError:
            if not self.problem.falls_short:
                raise
            path, trajectory, tight = steered_tightly(path, used, self.problem.triangulation)
        self.check_water(path, trajectory)
        fuel = self.problem.voyage.fuel(path)
        if not math.isfinite(fuel):
            # The steered path may arrive just in time while by the drift model it is late.
            raise InfeasibleError("the vessel makes no headway against the current on its path")
        if self.problem.voyage.has_price:
            # Across a current, a path may be steerable at the highest speed but not at a lower one.
            profile = speed_profile(path, self.problem.voyage)
            steer_as_drawn(profile.path, used, profile.speeds)
        used = replace(used, polar=corridor.polar)
        return ClassPath(used, path, trajectory, fuel, fuel, tight=tight)

    def _is_of(self, corridor: Corridor, path: FloatArray) -> bool:
        """Whether a path (n, 2) is of a corridor's class."""
        return self.problem.word(path) == corridor.channel.word

    def check_water(self, path: FloatArray, trajectory: FloatArray) -> None:
        """Raise InfeasibleError if a path (n, 2) leads through shut water, or its trajectory."""
        self.check_current(trajectory)
        if self.problem.adrift_water is not None:
            self.problem.adrift_water.check(path)

    def check_current(self, trajectory: FloatArray) -> None:
        """Raise InfeasibleError if a trajectory's current is too strong, or unknown."""
        voyage = self.problem.voyage
        arrival, (_, last) = trajectory[-1, 0], voyage.current.span
        if arrival > last:
            raise TooLateError(
                "it would arrive at {0}, and the current is known until {1}",
                Moment(arrival),
                Moment(last),
            )
        velocity = voyage.current.velocity(trajectory[:, 1:3], trajectory[:, 0])
        strength = np.linalg.norm(velocity, axis=1)
        worst = int(strength.argmax())
        if strength[worst] >= voyage.vessel.speed:
            raise InfeasibleError(
                f"the current at {{0}} runs at {strength[worst]:.3g} m/s; the vessel makes no more "
                f"than {voyage.vessel.speed:.3g} m/s",
                trajectory[worst, 1:3],
            )

    def _best_sample(self, corridor: Corridor) -> ClassPath:
        """Return the least-fuel path of the paper's sampling, with its class's harmonic mean."""
        samples, seed = self.options.samples, self.options.seed
        paths, class_mean = sampled_paths(corridor, self.problem.rays, samples, seed)
        first: InfeasibleError | None = None
        for path in paths:
            try:
                found = self._steered_in_class(corridor, corridor, path)
            except InfeasibleError as error:
                first = first or error
                continue
            if found is not None:
                return found._replace(harmonic_mean=class_mean)
        raise first or InfeasibleError("no chain was found")


def grown_until_clear(
    found: ClassPath,
    shortfall: Callable[[ClassPath], grow.Shortfalls | None],
    plan_again: Callable[[Corridor, ClassPath], ClassPath],
    most: int,
    turns: str = "hard-over turns",
) -> ClassPath:
    """Grow a path's padding until it is enough; `plan_again` plans near the last path.

    Raises InfeasibleError if padding is still too small after `most` rounds, or shuts the way. In
    narrow water the last path is returned then: as much as there is room for is enough.
    """
    is_enough = found.corridor.padded.yields
    for rounds_left in reversed(range(most)):
        short = shortfall(found)
        if short is None:
            return found
        if rounds_left:
            tell(Step("padding"))
            try:
                found = plan_again(grow.grown(found.corridor, short), found)
            except InfeasibleError:
                if not is_enough:
                    raise
                return found
    if is_enough:
        return found
    raise InfeasibleError(
        f"its path is still not clear of {turns} in the last of {most} rounds of growing padding"
    )


def fuel_estimate(unpadded: ClassPlanner, channel: Channel) -> float:
    """Return the fuel of a channel's path with minimal padding, before it is steered.

    It is hardly ever above the fuel of the channel's route. Without a path it is minus infinity.
    """
    corridor = unpadded.corridor(channel)
    try:
        path = refined_path(corridor, grow.near_rough(corridor))
    except InfeasibleError:
        return -math.inf
    voyage = unpadded.problem.voyage
    return voyage.vessel.fuel_rate * float(voyage.reading_times(path)[-1] - voyage.departure)
