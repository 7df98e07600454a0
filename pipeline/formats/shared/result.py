"""The finished run, as all formats read it."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

import renew
from pipeline._types import FloatArray
from pipeline.formats.shared.text import capitalised, planner_text, season_name
from pipeline.formats.shared.unknowns import unknowns
from pipeline.model import (
    Credit,
    DepartureChoice,
    Evaluation,
    Fetched,
    Note,
    RouteMetrics,
    Scene,
    SeasonPlan,
    ShutStrait,
    Simplified,
    Zone,
)
from pipeline.scenario.model import Scenario


@dataclass(frozen=True)
class RankedRoute:
    """A route with its metrics; `rank` 1 is the season's best."""

    season: str
    rank: int
    route: renew.Route
    metrics: RouteMetrics


@dataclass(frozen=True)
class RunResult:
    """All artefacts of a run; `created` is the time of writing (UTC), `timings` in seconds.

    The scenario is complete: `choices` say what was chosen where it left something out. They are
    among the notes of `fetched`, too. `straits` are those that are shut, the widest first.
    `departures` are the choices of when to leave, of the seasons that left it open.
    """

    scenario: Scenario
    fetched: Fetched
    simplified: Simplified
    scene: Scene
    plans: tuple[SeasonPlan, ...]
    evaluation: Evaluation
    timings: Mapping[str, float]
    created: datetime
    choices: tuple[Note, ...] = ()
    straits: tuple[ShutStrait, ...] = ()
    departures: tuple[DepartureChoice, ...] = ()

    @cached_property
    def routes(self) -> tuple[RankedRoute, ...]:
        """Every planned route with its metrics, by season in the plans' order, then by rank.

        Ranks are the evaluation's. A plan's own order is by fuel, and the sampled method may choose
        another route than the first.
        """
        ranked = []
        for entry in self.plans:
            if entry.plan is None:
                continue
            routes = {(route.homotopy, route.fuel): route for route in entry.plan.routes}
            rows = (row for row in self.evaluation.routes if row.season == entry.season)
            ranked += [
                RankedRoute(entry.season, row.rank, routes[row.homotopy, row.fuel], row)
                for row in sorted(rows, key=lambda row: row.rank)
            ]
        return tuple(ranked)

    @cached_property
    def unknowns(self) -> tuple[Note, ...]:
        """What is not known of the routes; among the notes, too."""
        return unknowns(self)

    def departure_choice(self, season: str) -> DepartureChoice | None:
        """When to leave in a season, and what that was chosen from; None where it was given."""
        return next((one for one in self.departures if one.season == season), None)

    def season_routes(self, season: str) -> tuple[RankedRoute, ...]:
        """One season's routes, best first; empty where the season could not be planned."""
        return tuple(ranked for ranked in self.routes if ranked.season == season)

    @cached_property
    def current_credits(self) -> tuple[Credit, ...]:
        """Sources of currents that were used, each once."""
        return tuple(dict.fromkeys(grid.credit for grid in self.fetched.currents))

    @property
    def credits(self) -> tuple[Credit, ...]:
        """All sources that were used, land first."""
        return (*self.fetched.land.credits, *self.current_credits)

    @property
    def shoals(self) -> tuple[BaseGeometry, ...]:
        """Water too shallow for the vessel, lon/lat degrees: no-go like land."""
        return tuple(zone.area for zone in self.fetched.land.zones if zone.kind == "shoal")

    @cached_property
    def land_label(self) -> str:
        """Legend of all that no route may enter, where shoals and hazards are drawn over it."""
        return "land or uncharted" if self._zones_in_chart({"uncharted"}) else "land"

    @property
    def hazards(self) -> tuple[BaseGeometry, ...]:
        """Rocks, wrecks, marks and the like with the room around them, lon/lat degrees: no-go."""
        return tuple(zone.area for zone in self.fetched.land.zones if zone.kind == "hazard")

    @cached_property
    def open_zones(self) -> tuple[tuple[Zone, BaseGeometry], ...]:
        """Restricted and shut areas, and traffic schemes: those in the chart, with planar areas.

        They may be entered, and routes may pass through them.
        """
        return self._zones_in_chart({"restricted", "traffic", "shut"})

    def _zones_in_chart(self, kinds: set[str]) -> tuple[tuple[Zone, BaseGeometry], ...]:
        """Zones of some kinds that lie in the chart, if only in part, with planar areas."""
        zones = [zone for zone in self.fetched.land.zones if zone.kind in kinds]
        areas = self.scene.projection.geometry_to_plane(
            np.array([zone.area for zone in zones], dtype=object)
        )
        inside = shapely.relate_pattern(areas, self.scene.chart.extent, "T********")
        return tuple(
            (zone, area)
            for zone, area, is_seen in zip(zones, areas, inside, strict=True)
            if is_seen
        )

    def is_stand_in(self, season: str) -> bool:
        """Whether the season's current is not the one that the scenario asks for first."""
        return any(grid.is_stand_in for grid in self.fetched.currents if grid.season == season)

    def season_index(self, season: str) -> int:
        """Position of a season among the scenario's, from 0: of its colour in the palette."""
        return [entry.season for entry in self.plans].index(season)

    def season_title(self, season: str) -> str:
        """The season's name for readers, with its title if that adds anything.

        A stand-in goes without the title: "July 2024" would be wrong for it.
        """
        name = season_name(season)
        name = capitalised(name)
        title = next((spec.title for spec in self.scenario.seasons if spec.name == season), "")
        if not title or self.is_stand_in(season):
            return name
        says_name = name != season.capitalize() or season in title.lower()
        return title if says_name else f"{name} ({title})"

    def valid_text(self, season: str) -> str:
        """Period that a season's current represents; empty if the source does not state it."""
        for grid in self.fetched.currents:
            if grid.season == season and grid.valid:
                shown = "; maps show it at departure" if grid.changes else ""
                return f"valid {self.period_text(season)}{shown}"
        return ""

    def period_text(self, season: str) -> str:
        """Dates of a season's current, "2024-01-03 to 2024-01-28"; empty if not stated."""
        valid = (grid.valid for grid in self.fetched.currents if grid.season == season)
        return next((dates.replace("/", " to ") for dates in valid if dates), "")

    def rejection_reason(self, season: str, rejected: renew.Rejected) -> str:
        """Why a class of a season has no route, as text for readers."""
        return planner_text(rejected.text, self.scene, season)

    def current_samples(self, season: str) -> tuple[FloatArray, FloatArray]:
        """Points of a season's current, lon/lat degrees (n, 2), and its velocity there (n, 2).

        A current that changes is given as at departure. Velocity is in m/s towards east and north.
        The points are those of the source's grid that have figures; without a grid, 25 by 25 over
        the chart; none if the season has no current.
        """
        for grid in self.fetched.currents:
            if grid.season == season:
                lon, lat = np.meshgrid(grid.lon, grid.lat)
                u, v = grid.at_departure
                known = np.isfinite(u) & np.isfinite(v)
                return (
                    np.stack([lon[known], lat[known]], axis=-1),
                    np.stack([u[known], v[known]], axis=-1),
                )
        if season not in self.scene.currents:
            return np.empty((0, 2)), np.empty((0, 2))
        xmin, ymin, xmax, ymax = self.scene.chart.bounds
        x, y = np.meshgrid(np.linspace(xmin, xmax, 25), np.linspace(ymin, ymax, 25))
        points = np.stack([x.ravel(), y.ravel()], axis=-1)
        lonlat = self.scene.projection.to_lonlat(points)
        velocity = np.asarray(self.scene.currents[season](points), dtype=float)
        return lonlat, self.scene.projection.rotate_to_lonlat(lonlat, velocity)
