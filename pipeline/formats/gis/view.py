"""What a map of a run has to know: its seasons with their colours, its plane and its scale."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pipeline.formats.figures.arrows import SpeedScale, speed_scale
from pipeline.formats.figures.palette import COLOURS

if TYPE_CHECKING:
    from pipeline.formats.shared.result import RunResult

# A season's routes: apart from each other, from land, water and currents, and in lightness too.
_SEASON_COLOURS = (COLOURS["best"], "#4a148c", "#e65100", "#00695c", "#827717")
_METRES_PER_DEGREE = 111_195.0
# Width of a map as it opens, on paper or screen.
_PAPER_M = 0.25


@dataclass(frozen=True)
class SeasonView:
    """How a season is shown.

    `number` tells it from the others inside a project, whatever their names. `leads` marks the
    season that is shown in full at first. `spacing_m` parts the current's points in true metres;
    `step_deg` does so towards east and north where they are a grid from `origin`.
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
    """A map's seasons, its classes of current speed, and the scale (denominator) that shows all.

    `convergence` is the angle of the plane's y axis clockwise of true north, as an expression on
    a point in lon/lat; empty for a map with north up.
    """

    seasons: tuple[SeasonView, ...]
    speeds: SpeedScale
    full_scale: float
    convergence: str = ""


def view(result: RunResult) -> View:
    """Look at a run as its map will show it."""
    ranked = [route for route in result.routes if route.rank == 1]
    first = result.plans[0].season
    lead = min(ranked, key=lambda route: route.metrics.fuel).season if ranked else first
    planned = {route.season for route in ranked}
    xmin, ymin, xmax, ymax = result.scene.chart.bounds
    across_m = max(xmax - xmin, ymax - ymin) * result.scene.projection.scale
    grids = {grid.season: grid for grid in result.fetched.currents}
    seasons = []
    for index, entry in enumerate(result.plans):
        spacing_m, origin, step = across_m / 24, (0.0, 0.0), None
        if entry.season in grids:
            grid = grids[entry.season]
            step = float(np.diff(grid.lon).min()), float(np.diff(grid.lat).min())
            origin = float(grid.lon[0]), float(grid.lat[0])
            narrow = float(np.cos(np.radians(grid.lat.mean())))
            spacing_m = min(step[0] * narrow, step[1]) * _METRES_PER_DEGREE
        seasons.append(
            SeasonView(
                number=index + 1,
                name=entry.season,
                title=result.season_title(entry.season),
                colour=_SEASON_COLOURS[index % len(_SEASON_COLOURS)],
                leads=entry.season == lead,
                planned=entry.season in planned,
                spacing_m=spacing_m,
                origin=origin,
                step_deg=step,
            )
        )
    return View(tuple(seasons), speed_scale(result), across_m / _PAPER_M)
