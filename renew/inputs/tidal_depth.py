"""Water that is deep enough for a vessel for some hours only: charted depths, and the tide."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from renew._types import FloatArray, IntArray
from renew.errors import ParameterError, as_floats, check_kind, is_finite, shown
from renew.inputs.shut_areas import ReliedOnTide, ShutArea, TidalArea, check_area
from renew.inputs.tide import Tide

Schedules: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""Times (n,), s, at which places are passed: on time, early and late."""


class LeastWater(NamedTuple):
    """Where a route has least water to spare.

    In the `area` the tide relied on exceeds the need by `spare` (m), at the `place` (2,), m, which
    the vessel passes on time at `time` (s). `early` and `late` are the least spare water (m)
    anywhere on the way of a vessel that is early or late.
    """

    spare: float
    place: FloatArray
    time: float
    early: float
    late: float
    area: TidalArea


@dataclass(frozen=True, eq=False)
class TidalDepth:
    """Areas of water, and the height of tide that the vessel needs in each.

    The tide relied on is the least height predicted within `lag` of the vessel's time, less the
    `surge`; an area is shut while this height is below its need. Areas may overlap; all their needs
    count. Outside them there is enough water at any time.

    Parameters
    ----------
    areas : sequence of Polygon or MultiPolygon
        Areas (n) of water (m).
    needs : array_like
        Draught, squat and clearance, less the charted depth (n,), m. Depths and tides are
        counted from one chart datum.
    tide : Tide or sequence of Tide
        The tide everywhere, or of each area, on the clock of the current.
    surge : float
        Height (m) by which the tide may be lower than predicted.
    lag : float
        Time (s) by which it may be early or late.
    names : sequence of str, optional
        The areas' names in messages.

    Raises
    ------
    ParameterError
        Needs, tides or names that do not fit the areas, or numbers out of range; all at once.
    GeometryError
        An area that is no valid polygon.
    """

    areas: Sequence[Polygon | MultiPolygon]
    needs: Sequence[float] | FloatArray
    tide: Tide | Sequence[Tide]
    surge: float = 0.3
    lag: float = 900.0
    names: Sequence[str] = ()

    def __post_init__(self) -> None:
        """Refuse areas, needs and tides that do not fit each other."""
        count, needs = len(self.areas), as_floats("depth.needs", self.needs)
        faults = []
        if needs.shape != (count,) or not np.isfinite(needs).all():
            faults.append(f"depth.needs must be {count} finite heights (m), one for each area")
        if not isinstance(self.tide, Tide) and len(self.tide) != count:
            faults.append(f"depth.tide has {len(self.tide)} tides for {count} areas")
        if len(self.names) not in {0, count}:
            faults.append(f"depth.names has {len(self.names)} names for {count} areas")
        for name, unit in (("surge", "m"), ("lag", "s")):
            value = getattr(self, name)
            if not (is_finite(value) and value >= 0):
                faults.append(f"depth.{name} = {shown(value)} {unit} must be finite, 0 or more")
        if faults:
            raise ParameterError("; ".join(faults))
        for at, area in enumerate(self.areas):
            check_area(f"depth.areas[{at}]", area)
        for at, tide in enumerate([] if isinstance(self.tide, Tide) else self.tide):
            check_kind(f"depth.tide[{at}]", tide, Tide)

    @cached_property
    def tidal_areas(self) -> tuple[TidalArea, ...]:
        """Areas that the tide may shut for some hours."""
        return tuple(
            area for area in self._all_areas if area.tide.least < area.need <= area.tide.most
        )

    @cached_property
    def never_open(self) -> tuple[ShutArea, ...]:
        """Areas in which no tide is high enough."""
        return tuple(
            ShutArea(area.polygon, name=area.name)
            for area in self._all_areas
            if area.need > area.tide.most
        )

    def least_water(self, path: FloatArray, schedules: Schedules) -> LeastWater | None:
        """Return where a path (n, 2), m, has least water to spare; None where no area is passed."""
        leg, area, spare = self._spare(path, schedules)
        if not len(leg):
            return None
        worst = int(spare[0].argmin())
        place, (least, early, late) = leg[worst], spare.min(axis=1).tolist()
        time, passed = float(schedules[0][place]), self._all_areas[area[worst]]
        return LeastWater(least, path[place], time, early, late, passed)

    def spare_along(self, path: FloatArray, times: FloatArray) -> FloatArray:
        """Return the least spare water (n - 1,), m, on each leg of a path (n, 2), m.

        It is passed at times (n,), s. Outside all areas the water is infinite.
        """
        leg, _, spare = self._spare(path, (times,))
        least = np.full(len(path) - 1, np.inf)
        np.minimum.at(least, leg, spare[0])
        return least

    def _spare(
        self, path: FloatArray, schedules: Sequence[FloatArray]
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the leg (k,) of each passage of an area, the area (k,), and the spare water, m.

        The water (schedules, k) is given for each schedule: the times (n,), s, at a path's points.
        """
        legs = shapely.linestrings(np.stack([path[:-1], path[1:]], axis=1))
        leg, area = self._tree.query(legs, predicate="intersects")
        spare = np.empty((len(schedules), len(leg)))
        for tide in set(self._tides):
            own = np.array([one is tide for one in self._tides])[area]
            # Points are close, so the tide on a leg is nearly that at one of its ends.
            for row, times in zip(spare, schedules, strict=True):
                heights = tide.heights(times)
                row[own] = np.minimum(heights[:-1], heights[1:])[leg[own]]
        return leg, area, spare - np.asarray(self.needs)[area]

    @cached_property
    def _tides(self) -> tuple[ReliedOnTide, ...]:
        """The tide relied on in each area."""
        given = [self.tide] * len(self.areas) if isinstance(self.tide, Tide) else self.tide
        made = {tide: ReliedOnTide(tide, self.surge, self.lag) for tide in given}
        return tuple(made[tide] for tide in given)

    @cached_property
    def _all_areas(self) -> tuple[TidalArea, ...]:
        """All areas, each with its need and the tide relied on there."""
        needs = np.asarray(self.needs, dtype=float).tolist()
        names = self.names or [""] * len(needs)
        rows = zip(self.areas, needs, self._tides, names, strict=True)
        return tuple(TidalArea(*row) for row in rows)

    @cached_property
    def _tree(self) -> shapely.STRtree:
        """The areas, by place."""
        return shapely.STRtree(list(self.areas))
