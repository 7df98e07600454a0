"""Plans of one voyage with a choice of speeds: around areas shut for some hours, and by departure.

Among departures the one of least fuel is best: who leaves at another time meets another current,
and has another time to be there. Each is planned by itself, with all its classes; nothing is known
of those between, since what bounds arrivals at one speed (:mod:`renew.departures.departure_window`)
does not bound fuel.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from renew.departures.around_areas import plan_around
from renew.departures.departure_window import Progress
from renew.errors import PlanningError
from renew.inputs.arguments import Speeds, check_speed_choice
from renew.inputs.chart import Chart
from renew.inputs.shut_area import ShutArea
from renew.inputs.speed_choice import NO_CHOICE, SpeedChoice
from renew.inputs.vessel import Vessel
from renew.route import Departures, Plan
from renew.search.class_planner import ClassPlanner
from renew.speeds.speed_search_by_clock import plan_by_clock


class PlannerOf(Protocol):
    """Makes the planner of a voyage's classes."""

    def __call__(
        self, chart: Chart, vessel: Vessel, choice: SpeedChoice = NO_CHOICE
    ) -> ClassPlanner:
        """Planner on a chart, for a vessel with a choice of speeds."""
        ...


class SpeedPlanner:
    """Plans a voyage with a choice of speeds (m/s), at any departure, to be there by a time (s).

    ParameterError where the vessel's fuel law leaves no choice.
    """

    def __init__(
        self,
        chart: Chart,
        areas: Sequence[ShutArea],
        vessel: Vessel,
        speed: Speeds,
        deadline: float,
        classes: int,
        planner_of: PlannerOf,
    ) -> None:
        check_speed_choice(vessel)
        self._chart, self._areas, self._classes = chart, areas, classes
        self._least, self._most = map(float, speed)
        self._vessel, self._deadline, self._planner_of = vessel, deadline, planner_of
        # Departures share it.
        self._planner_on = functools.cache(self._planner)

    def plan(self, departure: float) -> Plan:
        """Routes of least fuel that arrive in time, and keep out of areas while these are shut.

        Speeds are not chosen to pass an area before or after: a class whose least-fuel route may
        meet it falls away. Other arrivals would be at it at other times, and there is no trade-off.
        """
        found = plan_around(self._chart, self._areas, functools.partial(self._plan_on, departure))
        has_hours = any(not area.is_always_shut for area in self._areas)
        return replace(found, trade_off=None) if has_hours else found

    def departures(self, departures: Sequence[float], progress: Progress | None) -> Departures:
        """Plan each of some departures (s), ascending; refused where none leaves a route."""
        plans: list[Plan | PlanningError] = []
        for departure in departures:
            try:
                plans.append(self.plan(departure))
            except PlanningError as error:
                plans.append(error)
            if progress is not None:
                progress(len(plans), math.inf)
        best = [None if isinstance(one, PlanningError) else one.best for one in plans]
        fuels = np.array([math.inf if one is None else one.fuel for one in best])
        chosen = plans[int(fuels.argmin())]
        if isinstance(chosen, PlanningError):
            raise chosen
        return Departures(
            departures=np.array(departures, dtype=float),
            arrivals=np.array([math.inf if one is None else float(one.times[-1]) for one in best]),
            fuels=fuels,
            paths=tuple(None if one is None else one.path for one in best),
            times=tuple(None if one is None else one.times for one in best),
            homotopies=tuple("" if one is None else one.homotopy for one in best),
            causes=tuple(one if isinstance(one, PlanningError) else None for one in plans),
            unproven=math.inf,
            plan=chosen,
        )

    def _plan_on(self, departure: float, chart: Chart) -> tuple[Plan, ClassPlanner]:
        """Plan on a chart, and a planner by which its routes are looked at."""

        @functools.cache
        def planner_up_to(most: float) -> ClassPlanner:
            planner = self._planner_on(chart, most)
            if planner.problem.voyage.departure == departure:
                return planner
            return planner.for_problem(planner.problem.leaving(departure))

        found = plan_by_clock(planner_up_to, self._most, self._classes)
        return found, planner_up_to(self._most)

    def _planner(self, chart: Chart, most: float) -> ClassPlanner:
        """Planner on a chart for speeds up to one (m/s)."""
        choice = SpeedChoice(self._least, deadline=self._deadline)
        return self._planner_of(chart, replace(self._vessel, speed=most), choice)
