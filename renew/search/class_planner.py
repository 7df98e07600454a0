"""The best route of one homotopy class: its padding, path, trajectory, and turns that prove it."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
import shapely

from renew._types import FloatArray, IntArray
from renew.classes.channels import Channel
from renew.errors import InfeasibleError
from renew.inputs.fuel import passage_times
from renew.kernels.traversal import visits
from renew.padding.padding_model import LAYERS, Padder
from renew.paths.corridor import Corridor, refined_path, rough_path, sampled_paths
from renew.route import Route
from renew.search.problem import Waters
from renew.steering.steer_in_corridor import steer_inside
from renew.steering.trajectory import steer, steerable
from renew.turns.verification import padding_shortfall

Shortfall: TypeAlias = tuple[IntArray, FloatArray]
"""Constrained edges, and what their padding is short of (m)."""


Method: TypeAlias = Literal["optimal", "sampled"]

# Rounds in which the path's own triangles, and colliding turns, may push the padding out before a
# class is given up.
_MOST_REPAIRS = 8


class _Found(NamedTuple):
    """A path (n, 2), its trajectory (m, 4) and fuel, and where it was found.

    `harmonic_mean` is the figure by which its class is chosen.
    """

    corridor: Corridor
    path: FloatArray
    trajectory: FloatArray
    fuel: float
    harmonic_mean: float


@dataclass(frozen=True)
class ClassSearch:
    """Seeks the best route of a class in one kind of padding; flies its turns if it `proves`."""

    waters: Waters
    padder: Padder
    method: Method
    samples: int
    seed: int
    proves: bool

    def route(self, channel: Channel) -> Route:
        """Best route of a class; its padding grows until every hard-over turn is clear.

        InfeasibleError says why there is none.
        """
        corridor = self._corridor(channel)
        near: FloatArray | None = None
        for _ in range(_MOST_REPAIRS):
            found = self._best_path(corridor, near)
            shortfall = self._shortfall(found)
            if shortfall is None:
                return self._finished(found)
            corridor, near = _grown(found.corridor, shortfall), found.path
        raise InfeasibleError(
            f"its path is still not clear of hard-over turns after {_MOST_REPAIRS} widenings of V"
        )

    def unpadded_fuel(self, channel: Channel) -> float:
        """Least fuel of a class with no padding at all; inf where even so there is no path."""
        corridor = self._corridor(channel)
        bare = replace(corridor.hazards, padding=np.zeros(len(corridor.hazards.edge)))
        try:
            return self._fuel(
                self._least_fuel_path(replace(corridor, hazards=bare), bulging=True)[1]
            )
        except InfeasibleError:
            return math.inf

    def _corridor(self, channel: Channel) -> Corridor:
        """Where a class's paths are sought."""
        waters, mesh = self.waters, self.waters.triangulation
        region = np.array(list(mesh.surroundings(channel.triangles.tolist(), LAYERS)))
        return Corridor(
            channel,
            region,
            mesh.corners[region],
            mesh.open_outline(region),
            self.padder.hazards(channel, waters.start, waters.goal),
            waters.current,
            waters.table,
            waters.vessel,
            waters.start,
            waters.goal,
            waters.drift,
        )

    def _shortfall(self, found: _Found) -> Shortfall | None:
        """What the padding lacks for the triangles a path crosses, or else for its turns."""
        if not self.proves:
            return None
        waters, corridor = self.waters, found.corridor
        return self._unset(corridor, found.path) or padding_shortfall(
            found.path,
            (waters.start, waters.goal),
            corridor.hazards,
            waters.chart,
            waters.quick_current,
            waters.reach,
            waters.vessel,
        )

    def _unset(self, corridor: Corridor, path: FloatArray) -> Shortfall | None:
        """What the padding lacks where a path bulges out of the channel for which it was set."""
        inside = visits(path, corridor.corners)
        crossed = inside._replace(triangle=corridor.triangles[inside.triangle])
        return self.padder.shortfall(crossed, corridor.channel, corridor.hazards)

    def _least_fuel_path(self, corridor: Corridor, *, bulging: bool) -> tuple[Corridor, FloatArray]:
        """Least-fuel path (n, 2), and the corridor with the padding that its bulges ask for."""
        rough = rough_path(corridor, bulging=bulging)
        if not (self.proves and (unset := self._unset(corridor, rough))):
            return _refined(corridor, rough)
        corridor = _grown(corridor, unset)
        try:
            return _refined(corridor, rough)
        except InfeasibleError:
            return _refined(corridor, rough_path(corridor, bulging=bulging))

    def _best_path(self, corridor: Corridor, near: FloatArray | None) -> _Found:
        """Best path of a corridor; near the one found while its padding was smaller, if any."""
        if self.method == "sampled":
            return self._best_sample(corridor)
        word, rays = corridor.channel.word, self.waters.rays
        # Eq. 4 as published rewards tacking against currents above v/2, where v + c·T is no convex
        # speed polar: such paths can't be steered. The crab model's path then can.
        drifts = dict.fromkeys((self.waters.drift, "crab"))
        ways = [
            partial(self._least_fuel_path, replace(corridor, drift=drift), bulging=bulging)
            for drift, bulging in itertools.product(drifts, (True, False))
        ]
        if near is not None:
            ways.insert(0, partial(_refined, corridor, near))
        first: InfeasibleError | None = None
        for way in ways:
            try:
                attempt, path = way()
                if rays.word(path) != word:
                    continue
                path, trajectory = steer_inside(path, attempt)
                if rays.word(path) != word:
                    continue
                self._check_current(trajectory)
            except InfeasibleError as error:
                if error.strait is not None:
                    raise
                first = first or error
                continue
            fuel = self._fuel(path)
            return _Found(replace(attempt, drift=corridor.drift), path, trajectory, fuel, fuel)
        raise first or InfeasibleError("its least-fuel path slips into another class")

    def _check_current(self, trajectory: FloatArray) -> None:
        """Refuse a trajectory through water that outruns the vessel."""
        waters = self.waters
        strength = np.linalg.norm(waters.current(trajectory[:, 1:3]), axis=1)
        worst = int(strength.argmax())
        if strength[worst] >= waters.vessel.speed:
            _, x, y, _ = trajectory[worst]
            raise InfeasibleError(
                f"the current at ({x:.1f}, {y:.1f}) m runs at {strength[worst]:.3g} m/s and "
                f"outruns the vessel, which makes {waters.vessel.speed:.3g} m/s"
            )

    def _best_sample(self, corridor: Corridor) -> _Found:
        """Least-fuel chain of the paper's sampling, with the harmonic mean over its class."""
        current, vessel = corridor.current, corridor.vessel
        rng = np.random.default_rng([self.seed, *corridor.channel.triangles.tolist()])
        chains = sampled_paths(corridor, self.samples, rng)
        chains = chains[steerable(chains, current, vessel)]
        if not len(chains):
            raise InfeasibleError(
                f"none of {self.samples} sampled chains can be steered at a turn rate of "
                f"{math.degrees(vessel.turn_rate):g} degrees a second; method='optimal' may"
            )
        # Water that outruns the vessel is no-go for it, whichever way it flows.
        drifts = np.linalg.norm(current((chains[:, 1:] + chains[:, :-1]) / 2), axis=-1)
        chains = chains[(drifts < vessel.speed).all(axis=1)]
        fuels = np.array([self._fuel(chain) for chain in chains])
        if not np.isfinite(fuels).any():
            raise InfeasibleError("the current outruns the vessel on every sampled chain")
        path, fuel = chains[fuels.argmin()], float(fuels.min())
        harmonic_mean = float(len(fuels) / (1 / fuels).sum())
        return _Found(corridor, path, steer(path, current, vessel), fuel, harmonic_mean)

    def _fuel(self, path: FloatArray) -> float:
        """Eq. 4 along a path."""
        waters = self.waters
        times = passage_times(path, waters.current, waters.vessel, drift=waters.drift)
        return float(waters.vessel.fuel_rate * times.sum())

    def _finished(self, found: _Found) -> Route:
        """Route with all its figures."""
        corridor, path, trajectory, fuel, harmonic_mean = found
        waters, hazards = self.waters, corridor.hazards
        line = shapely.LineString(path)
        track = shapely.LineString(trajectory[:, 1:3])
        apart = (
            min(shapely.distance([line, track], waters.chart.hard_no_go))
            if waters.chart.no_go
            else math.inf
        )
        return Route(
            path=path,
            trajectory=trajectory,
            fuel=fuel,
            length=float(line.length),
            clearance=float(apart),
            duration=fuel / waters.vessel.fuel_rate,
            least=waters.least,
            homotopy=corridor.channel.name,
            corners=corridor.corners,
            padding_used=np.column_stack([hazards.start, hazards.end, hazards.padding]),
            harmonic_mean=harmonic_mean,
            starts_in_soft_no_go=len(hazards.around(waters.start).edge) > 0,
            ends_in_soft_no_go=len(hazards.around(waters.goal).edge) > 0,
        )


def _grown(corridor: Corridor, shortfall: Shortfall) -> Corridor:
    """Corridor with the padding larger by what it is short of."""
    return replace(corridor, hazards=corridor.hazards.grown(*shortfall))


def _refined(corridor: Corridor, rough: FloatArray) -> tuple[Corridor, FloatArray]:
    """Corridor, and the least-fuel path (n, 2) near a rough one."""
    return corridor, refined_path(corridor, rough)
