"""A report of the largest size: 50,000 vertices of coast, 16 routes, 7,000 arrows per season."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from playwright.sync_api import Browser

import renew
from pipeline.findings.result import RunCase, RunResult
from pipeline.formats.report.page import gather, render
from pipeline.model import CaseResult
from tests.pipeline.formats import small_run
from tests.pipeline.results import with_case, with_water

ISLANDS, CORNERS = 250, 200
ROUTES_PER_SEASON = 8


@dataclass(frozen=True)
class Measured:
    """Size of a page, and what a browser takes until it has drawn map and controls.

    `ready_s` is counted from navigation; `busy_s` is processor time of the thread that draws.
    """

    size_bytes: int
    ready_s: float
    busy_s: float


def big_result() -> RunResult:
    """The small run with a long coast, more routes and a finer current."""
    result = small_run.parts()
    land = _coast(result.water.chart.bounds)
    lonlat = tuple(result.water.projection.geometry_to_lonlat(np.array(land, dtype=object)))
    result = with_water(result, land=land)
    for case in result.cases:
        result = with_case(result, case.name, current=_finer(result, case.name))
    return replace(
        result,
        fetched=replace(result.fetched, land=replace(result.fetched.land, polygons=lonlat)),
        results=tuple(map(_more_routes, result.cases)),
    )


def write_big_page(path: Path) -> None:
    """Write the page of the big run."""
    path.write_text(render(gather(big_result())), encoding="utf-8")


def measure(browser: Browser, path: Path) -> Measured:
    """Open a page in a new context and wait until it is ready."""
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    page = context.new_page()
    session = context.new_cdp_session(page)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})
    page.goto(path.as_uri(), wait_until="commit")
    page.wait_for_selector("html[data-ready]", state="attached")
    ready_ms = float(page.evaluate("document.documentElement.dataset.ready"))
    metrics = session.send("Performance.getMetrics")["metrics"]
    busy_s = {metric["name"]: metric["value"] for metric in metrics}["TaskDuration"]
    context.close()
    return Measured(path.stat().st_size, ready_ms / 1000, busy_s)


def _coast(bounds: tuple[float, float, float, float]) -> tuple[shapely.Polygon, ...]:
    """Ragged, star-shaped islands all over the chart."""
    chance = np.random.default_rng(7)
    xmin, ymin, xmax, ymax = bounds
    angle = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)
    islands = []
    for _ in range(ISLANDS):
        middle = chance.uniform((xmin, ymin), (xmax, ymax))
        radius = chance.uniform(0.5, 3.0) * (1 + 0.1 * chance.standard_normal(CORNERS).clip(-3, 3))
        corners = middle + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        islands.append(shapely.Polygon(corners))
    return tuple(islands)


def _finer(result: RunResult, season: str) -> renew.GyreCurrent:
    """Gyres that are defined everywhere, so that arrows are as dense as possible."""
    xmin, ymin, xmax, ymax = result.water.chart.bounds
    strength = 0.3 if season == "summer" else 0.6
    return renew.GyreCurrent(strength, xmax - xmin, ymax - ymin, columns=3, rows=3)


def _more_routes(case: RunCase) -> CaseResult:
    """Repeat a case's routes, each with a little more fuel."""
    assert case.plan is not None
    routes, rows = [], []
    for number in range(ROUTES_PER_SEASON):
        like = case.routes[number % len(case.routes)]
        name, fuel = f"{like.route.homotopy}.x{number}", like.route.fuel * (1 + 0.01 * number)
        routes.append(replace(like.route, homotopy=name, fuel=fuel))
        rows.append(replace(like.metrics, rank=number + 1, homotopy=name, fuel=fuel))
    turns = case.measures.turns[:1] * ROUTES_PER_SEASON
    measures = replace(case.measures, routes=tuple(rows), turns=turns)
    plan = replace(case.plan, routes=tuple(routes))
    return replace(case.result, plan=plan, measures=measures)
