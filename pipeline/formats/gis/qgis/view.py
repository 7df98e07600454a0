"""View of a run as a map shows it: seasons with their colours, classes of speed, scale."""

from dataclasses import dataclass

import numpy as np

from pipeline.formats.figures.maps.arrows import SpeedScale, speed_scale
from pipeline.formats.shared.palette import season_colour
from pipeline.formats.shared.result import RunResult
from pipeline.geo.earth import METRES_PER_DEGREE

# Width, metres on paper or screen, at which a map opens.
_MAP_WIDTH_M = 0.25
# Spacing of arrows without a grid, as a share of the chart's longer side.
_SPACING_SHARE = 1 / 24


@dataclass(frozen=True)
class SeasonView:
    """How a season is shown.

    `number` identifies it inside a project, whatever its name. `leads` marks the season that is
    shown in full at first. `spacing_m` is the distance between the current's points in true metres;
    if they are a grid, `origin` and `step_deg` give its first point and steps to east and north.
    """

    number: int
    name: str
    title: str
    colour: str
    leads: bool
    planned: bool
    spacing_m: float
    origin: tuple[float, float] = (0.0, 0.0)
    step_deg: tuple[float, float] | None = None


@dataclass(frozen=True)
class View:
    """A map's seasons, classes of current speed, and scale (denominator) that shows all of it.

    `convergence` is as in `MapCrs`.
    """

    seasons: tuple[SeasonView, ...]
    speeds: SpeedScale
    full_scale: float
    convergence: str = ""


def view(result: RunResult) -> View:
    """Describe how a map shows a run."""
    ranked = [route for route in result.routes if route.rank == 1]
    first = result.plans[0].season
    lead = min(ranked, key=lambda route: route.metrics.fuel).season if ranked else first
    planned = {route.season for route in ranked}
    xmin, ymin, xmax, ymax = result.scene.chart.bounds
    across_m = max(xmax - xmin, ymax - ymin) * result.scene.projection.scale
    grids = {grid.season: grid for grid in result.fetched.currents}
    seasons = []
    for index, entry in enumerate(result.plans):
        spacing_m, origin, step = across_m * _SPACING_SHARE, (0.0, 0.0), None
        if entry.season in grids:
            grid = grids[entry.season]
            step = float(np.diff(grid.lon).min()), float(np.diff(grid.lat).min())
            origin = float(grid.lon[0]), float(grid.lat[0])
            narrow = float(np.cos(np.radians(grid.lat.mean())))
            spacing_m = min(step[0] * narrow, step[1]) * METRES_PER_DEGREE
        seasons.append(
            SeasonView(
                number=index + 1,
                name=entry.season,
                title=result.season_title(entry.season),
                colour=season_colour(index),
                leads=entry.season == lead,
                planned=entry.season in planned,
                spacing_m=spacing_m,
                origin=origin,
                step_deg=step,
            )
        )
    return View(tuple(seasons), speed_scale(result), across_m / _MAP_WIDTH_M)
