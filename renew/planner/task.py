"""The request for a plan, and its planners of classes, which share their parts."""

from collections.abc import Collection
from dataclasses import dataclass, field, replace

from renew._types import FloatArray
from renew.inputs.chart import Chart, ShutArea, polygons_of
from renew.inputs.current import CurrentField
from renew.inputs.options import Request
from renew.inputs.vessel import Vessel
from renew.planner.one_class import ClassPlanner
from renew.planner.problem import Problem
from renew.voyage.checks import check_endpoints, check_pace
from renew.voyage.voyage import NO_CHOICE, SpeedChoice, Voyage, Waters


@dataclass(frozen=True, eq=False)
class Task:
    """Where to plan, with which vessel, in which current, and how.

    The `chart` excludes the water of areas that are always shut; `areas` are shut for some hours.
    Start, via points and goal are `stops` (n, 2), m.
    """

    chart: Chart
    current: CurrentField
    vessel: Vessel
    stops: FloatArray
    areas: tuple[ShutArea, ...]
    request: Request
    _planners: dict[object, ClassPlanner] = field(default_factory=dict)

    @property
    def deadline(self) -> float:
        """Latest arrival (s) with a choice of speeds, at most the end of the current's data."""
        last, arrive_by = self.current.span[1], self.request.arrive_by
        return float(last if arrive_by is None else min(arrive_by, last))

    def planner(self, closed: Collection[ShutArea] = (), most: float | None = None) -> ClassPlanner:
        """Return the planner at the first departure, for speeds up to `most` (m/s).

        Areas in `closed` are closed like land. Without a choice of speeds it uses the vessel's own.
        """
        key = frozenset(closed), most
        if key not in self._planners:
            self._planners[key] = self._new_planner(closed, most)
        return self._planners[key]

    def _new_planner(self, closed: Collection[ShutArea], most: float | None) -> ClassPlanner:
        """Make a planner; raise an error for stops on land, or a current that changes too fast."""
        chart, vessel, request = self.chart, self.vessel, self.request
        if closed:
            polygons = polygons_of([area for area in self.areas if area in closed])
            chart = chart.without(polygons, is_land=False)
        choice = NO_CHOICE
        if request.speed is not None:
            least, highest = map(float, request.speed)
            choice = SpeedChoice(least, deadline=self.deadline)
            vessel = replace(vessel, speed=highest if most is None else most)
        voyage = Voyage(
            Waters(chart, self.current),
            vessel,
            self.stops[0],
            self.stops[-1],
            request.drift,
            float(request.departure),
            float(request.lateness),
            float(request.min_lateness),
            self.stops[1:-1],
            choice=choice,
        )
        check_endpoints(voyage)
        check_pace(voyage)
        return ClassPlanner(Problem(voyage, request), request)
