"""The best route of one homotopy class: padding, path, trajectory, verification by turns."""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import shapely

from renew._types import FloatArray
from renew.classes.channel import Channel
from renew.classes.h_signature import name
from renew.errors import InfeasibleError, Moment, TooLateError
from renew.inputs.arguments import Method
from renew.inputs.voyage import Voyage
from renew.padding.padding_model import PaddingModel, region_of
from renew.padding.passage_windows import passage_windows
from renew.padding.policy import PaddingPolicy
from renew.padding.soft_no_go import PaddedEdges
from renew.paths.corridor import Corridor
from renew.paths.least_fuel_path import check_straits
from renew.paths.speed_profile import SpeedProfile, speed_profile
from renew.route import Route
from renew.search.growing_padding import PaddingGrowth, grown
from renew.search.overpowered_hours import hours_along, hours_of
from renew.search.path_attempts import PathAttempts, near_first
from renew.search.problem import Problem
from renew.search.room_to_turn import steered_as_it_is, steered_with_room
from renew.search.sampled_paths import sampled_paths
from renew.steering.steer_in_corridor import steer_as_drawn

# Ratio of a steered path's fuel to that of the path before from which other ways are tried.
_DEAR = 1.01
# Number of times that the padding of a class may grow before the class is given up.
_MAX_GROWTHS = 8


class Found(NamedTuple):
    """A path (n, 2), its trajectory (m, 4) and fuel, and where it was found.

    `harmonic_mean` is the figure by which its class is chosen.
    """

    corridor: Corridor
    path: FloatArray
    trajectory: FloatArray
    fuel: float
    harmonic_mean: float


@dataclass(frozen=True)
class PathMethod:
    """How the best path of a class is found; `samples` and `seed` are those of random chains.

    With `is_thorough`, land is padded more where a path can't be steered, and variants are tried.
    """

    method: Method
    samples: int
    seed: int
    is_thorough: bool = True


class ClassPlanner:
    """Plans the best route of a class with padding of one policy, of a `model` if there is one."""

    def __init__(
        self,
        problem: Problem,
        policy: PaddingPolicy,
        method: PathMethod,
        model: PaddingModel | None = None,
    ) -> None:
        self.problem, self.policy, self.method = problem, policy, method
        voyage = problem.voyage
        self._model = model or PaddingModel(
            problem.triangulation, voyage.quick_current, voyage.vessel, policy
        )
        self.growth = PaddingGrowth(problem, self._model, policy)
        self._attempts = PathAttempts(voyage, self.growth)

    def for_problem(self, problem: Problem) -> ClassPlanner:
        """Return the same for another departure's problem, or at another price of time.

        What is known of padding is shared.
        """
        return ClassPlanner(problem, self.policy, self.method, self._model)

    def find(self, channel: Channel) -> Found:
        """Best path of a class; its padding grows until every hard-over turn is clear.

        Where each way of looking for it slips past an islet, the path is of another class.
        InfeasibleError says why there is none.
        """
        found = self._find(channel)
        if not found.corridor.holds_back(found.path):
            return found
        wider = found.corridor.channel_along(found.path)
        with contextlib.suppress(InfeasibleError):
            return min(found, self._find(wider), key=lambda one: one.fuel)
        return found

    def _find(self, channel: Channel) -> Found:
        """Best path of a class in the water around its channel."""
        return self.find_in(self.corridor(channel))

    def find_in(self, corridor: Corridor, near: FloatArray | None = None) -> Found:
        """Best path of a corridor, near one (n, 2) of before, if any; its padding may grow."""
        for _ in range(_MAX_GROWTHS):
            found = self._found(corridor, near)
            shortfall = self.growth.shortfall(found.corridor, found.path)
            if shortfall is None:
                return found
            corridor, near = grown(found.corridor, shortfall), found.path
        raise InfeasibleError(
            "its path is still not clear of hard-over turns after its padding has grown "
            f"{_MAX_GROWTHS} times"
        )

    def route(self, found: Found, profile: SpeedProfile | None = None) -> Route:
        """Route along a path, with all its figures; at the speeds of a profile, if there is one."""
        corridor, path, trajectory, fuel, class_mean = found
        voyage, paddings = self.problem.voyage, corridor.paddings
        speeds, times = np.full(len(path) - 1, voyage.vessel.speed), voyage.arrivals(path)
        duration = fuel / voyage.vessel.fuel_rate
        if profile is not None:
            path, speeds, times, fuel, _ = profile
            trajectory = steer_as_drawn(path, corridor, speeds)
            duration, class_mean = float(times[-1] - times[0]), fuel
        line = shapely.LineString(path)
        track = shapely.LineString(trajectory[:, 1:3])
        clearance = (
            min(shapely.distance([line, track], voyage.chart.hard_no_go))
            if voyage.chart.no_go
            else math.inf
        )
        return Route(
            path=path,
            trajectory=trajectory,
            fuel=fuel,
            length=float(line.length),
            clearance=float(clearance),
            duration=duration,
            times=times,
            speeds=speeds,
            fuel_bound=self.problem.fuel_bound,
            homotopy=name(self.problem.word(path)),
            corners=corridor.corners,
            padding_used=np.vstack(
                [np.column_stack([one.start, one.end, one.padding]) for one in paddings]
            ),
            harmonic_mean=class_mean,
            starts_in_soft_no_go=len(paddings[0].around(voyage.start).edge) > 0,
            ends_in_soft_no_go=len(paddings[-1].around(voyage.goal).edge) > 0,
            overpowered=hours_along(path, times, voyage) or hours_of(corridor.channel, voyage),
        )

    def unpadded_fuel(self, channel: Channel) -> float:
        """Least fuel of a class with no padding at all; inf where even so there is no path."""
        corridor = self.corridor(channel)
        bare = corridor.with_padding(
            [replace(one, padding=np.zeros(len(one.edge))) for one in corridor.paddings]
        )
        try:
            _, path = self._attempts.from_rough(bare, near_first)
        except InfeasibleError:
            return math.inf
        voyage = self.problem.voyage
        return speed_profile(path, voyage).fuel if voyage.has_price else voyage.fuel(path)

    def corridor(self, channel: Channel) -> Corridor:
        """Where a class's paths are planned."""
        voyage, triangulation = self.problem.voyage, self.problem.triangulation
        parts = voyage.parts(channel.way(voyage.start, voyage.goal))
        padded = [
            self._padded(stage, *part)
            for stage, part in zip(channel.stages or (channel,), parts, strict=True)
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

    def _padded(self, channel: Channel, voyage: Voyage, way: FloatArray) -> PaddedEdges:
        """Padding next to a channel without via points, sailed nearly along a way (n, 2)."""
        middle = channel.midline(voyage.start, voyage.goal)
        windows = passage_windows(voyage, way, middle[:-1], middle[1:])
        return self._model.padded_edges(channel, voyage.start, voyage.goal, windows)

    def _found(self, corridor: Corridor, near: FloatArray | None) -> Found:
        """Best path of a corridor; near the one found while its padding was smaller, if any."""
        if self.method.method == "sampled":
            return self._best_sample(corridor)
        if near is None:
            check_straits(corridor)
        return self._best_path(corridor, near)

    def _best_path(self, corridor: Corridor, near: FloatArray | None) -> Found:
        """Best path of some attempts; of another class where each of them slips into one."""
        first: InfeasibleError | None = None
        best: Found | None = None
        slipped: list[tuple[Corridor, FloatArray]] = []
        for attempt in self._attempts.in_order(corridor, near):
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
                    # So did each attempt while the padding was smaller.
                    break
                continue
            if best is None or found.fuel < best.fuel:
                best = found
            if near is not None or found.fuel <= _DEAR * self.problem.voyage.fuel(path):
                break
            # Much room had to be made to turn in: another way may need less of it. Where the
            # padding has only grown, the others have been tried before.
        if best is None and slipped:
            best = self._steered(corridor, *slipped[0])
        if best is None:
            raise first or InfeasibleError("no path was found")
        return self._or_straight(best)

    def _or_straight(self, found: Found) -> Found:
        """A path that was found, or the straight way, where that is clear and needs less fuel.

        Paths are looked for in a table of the current: where the field hardly changes across the
        way, a bend may gain in the table what it loses in the field.
        """
        voyage, corridor = self.problem.voyage, found.corridor
        straight = voyage.stops
        if not self._is_of(corridor, straight) or voyage.fuel(straight) >= found.fuel:
            return found
        if all(stage.legs_clear(piece).all() for stage, piece in corridor.stages(straight)):
            with contextlib.suppress(InfeasibleError):
                other = self._steered_in_class(corridor, corridor, straight)
                return min(found, other or found, key=lambda one: one.fuel)
        return found

    def _steered_in_class(
        self, corridor: Corridor, used: Corridor, path: FloatArray
    ) -> Found | None:
        """The same as `_steered`; None where the path slips into another class."""
        found = self._steered(corridor, used, path) if self._is_of(corridor, path) else None
        return found if found is not None and self._is_of(corridor, found.path) else None

    def _steered(self, corridor: Corridor, used: Corridor, path: FloatArray) -> Found:
        """A path (n, 2) that was found in a corridor, or one with more padding."""
        makes_room = self.method.is_thorough and used.polar == corridor.polar
        steered = steered_with_room if makes_room else steered_as_it_is
        used, path, trajectory = steered(used, path)
        self.check_current(trajectory)
        fuel = self.problem.voyage.fuel(path)
        if not math.isfinite(fuel):
            # As steered she may just be through in time, and not so by the drift model.
            raise InfeasibleError("the current leaves no way to be made along its path")
        if self.problem.voyage.has_price:
            # What can be steered at the highest speed may not be at a lower one, across a current.
            profile = speed_profile(path, self.problem.voyage)
            steer_as_drawn(profile.path, used, profile.speeds)
        return Found(replace(used, polar=corridor.polar), path, trajectory, fuel, fuel)

    def _is_of(self, corridor: Corridor, path: FloatArray) -> bool:
        """Whether a path (n, 2) is of a corridor's class."""
        return self.problem.word(path) == corridor.channel.word

    def check_current(self, trajectory: FloatArray) -> None:
        """Refuse a trajectory through a current as strong as the vessel, or no longer known."""
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

    def _best_sample(self, corridor: Corridor) -> Found:
        """Least-fuel path of the paper's sampling; the harmonic mean is its class's."""
        method = self.method
        paths, class_mean = sampled_paths(corridor, self.problem.rays, method.samples, method.seed)
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
