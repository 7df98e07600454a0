"""Judges any path by the same rules: fuel by Eq. 4, clearance, steering, hard-over turns."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely

import renew
from renew._types import FloatArray
from renew.errors import InfeasibleError
from renew.kernels.turn_tracks import TurnsBegun
from renew.steering.trajectory import steer
from renew.turns.contingency import contingency, fly_turns, stations
from renew.voyage.voyage import Voyage

# Ends of a path may be off the voyage's by this share of its length: rounding.
_OFF = 1e-6


@dataclass(frozen=True, slots=True)
class Judgement:
    """What the referee says of a path.

    Attributes
    ----------
    fuel, length, clearance : Eq. 4; m; least distance to land, m (0 where it crosses land).
    crosses_land : whether it enters the hard no-go zone.
    is_steerable : whether corners can be rounded so that the heading turns no faster than ω.
    collisions, trials : the paper's count: one turn a station.
    full_collisions, full_trials : ours: ten turns a metre.
    """

    fuel: float
    length: float
    clearance: float
    crosses_land: bool
    is_steerable: bool
    collisions: int
    trials: int
    full_collisions: int
    full_trials: int

    @property
    def fuel_per_distance(self) -> float:
        """The paper's F/D."""
        return self.fuel / self.length


@dataclass(frozen=True)
class _Path:
    path: FloatArray


def judged(
    path: FloatArray,
    voyage: Voyage,
    *,
    spacing: float,
    seed: int = 0,
    trajectory: FloatArray | None = None,
) -> Judgement:
    """Judge a path (n, 2); `spacing` (m) is that of the paper's stations.

    `trajectory` (m, 4) is that of a path which was made steerable by its planner; others are
    steered here.
    """
    _check_ends(path, voyage)
    line = shapely.LineString(path)
    land = voyage.chart.hard_no_go
    # A path may run along the shore: GEOS's `overlaps` and `crosses` ask for the interior.
    crosses = bool(shapely.relate_pattern(line, land, "T********")) if not land.is_empty else False
    turns = one_turn_a_station(
        path, voyage.chart, voyage.current, voyage.vessel, spacing=spacing, seed=seed
    )
    full = contingency(_Path(path), voyage.chart, voyage.current, voyage.vessel, seed=seed)
    return Judgement(
        renew.fuel(path, voyage.current, voyage.vessel, drift=voyage.drift),
        float(line.length),
        math.inf if land.is_empty else float(shapely.distance(line, land)),
        crosses,
        trajectory is not None or _can_be_steered(path, voyage),
        *turns,
        full.collisions,
        full.trials,
    )


def _check_ends(path: FloatArray, voyage: Voyage) -> None:
    """Refuse a path that does not lead from the start to the goal."""
    off = max(math.dist(path[0], voyage.start), math.dist(path[-1], voyage.goal))
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    if not off <= _OFF * length:
        raise renew.ParameterError(
            f"path ends {off:.3g} m off the start or the goal; give one from {voyage.start} to "
            f"{voyage.goal}"
        )


def _can_be_steered(path: FloatArray, voyage: Voyage) -> bool:
    """Whether the path's corners can be rounded so that the vessel can follow."""
    moving = np.concatenate([[True], np.linalg.norm(np.diff(path, axis=0), axis=1) > 0])
    try:
        steer(path[moving], voyage.current, voyage.vessel)
    except InfeasibleError:
        return False
    return True


def one_turn_a_station(
    path: FloatArray,
    chart: renew.Chart,
    current: renew.CurrentField,
    vessel: renew.Vessel,
    *,
    spacing: float,
    seed: int = 0,
) -> tuple[int, int]:
    """Collisions and trials as the paper counts: a turn every `spacing` metres of a path (n, 2).

    Each is a full one, hard over to a drawn side. `renew.contingency` flies ten: to both sides, in
    the field and in four draws of its spread.
    """
    points, course = stations(np.asarray(path, dtype=float), spacing)
    rng = np.random.default_rng(seed)
    side = rng.integers(0, 2, len(points))
    speeds = np.full(len(points), vessel.speed)
    begun = TurnsBegun(points, course, np.zeros(len(points)), speeds)
    tracks = fly_turns(begun, current, vessel, np.zeros((1, 1, 2)))
    flown = shapely.linestrings(tracks[np.arange(len(points)), side])
    if not chart.no_go:
        return 0, len(points)
    touched = shapely.STRtree(chart.no_go).query(flown, predicate="intersects")[0]
    return len(np.unique(touched)), len(points)
