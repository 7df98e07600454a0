"""Figures of the tide: streams that turn round Palawan, and heights beside libraries and NOAA."""

import tempfile
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

import renew
from pipeline.geo.projection import Projection
from pipeline.machine.store import Store
from pipeline.model import Case, Credit, CurrentGrid, Fetched
from pipeline.scenario.loading import load_scenario
from pipeline.scenario.model import Scenario
from pipeline.stages.fetch import fetch
from pipeline.stages.project import project
from pipeline.stages.simplify import simplify_land
from tests.bench.figure import Figure, at_most
from tests.tide_oracles import PREDICTORS, apart, highest_and_lowest, stations

_FIRST = datetime(2026, 11, 22, tzinfo=UTC)
# Departure, and length of the series: hours after its first step.
_DEPARTURE_H, _HOURS = 6.0, 10 * 24
# Period of the tide M2, and from spring tide to spring tide, h; strengths of tide and eddies, m/s.
_M2_H, _SPRING_H, _TIDE_M_S, _EDDIES_M_S = 12.4206, 14.77 * 24, 0.5, 0.25
_CELL_DEG = 1 / 12
# Number of classes that are planned, and distance (m) from turn to turn.
_CLASSES, _SPACING_M = 8, 100.0


def figures() -> Iterator[Figure]:
    """Yield turns early, on time and late that touch land, and the memory that the field takes."""
    given = load_scenario("palawan-usv")
    table = given.model_dump(mode="json", exclude_defaults=True)
    table["seasons"] = [
        {
            "name": "tide",
            "time_method": "changing",
            "departure": (_FIRST.replace(hour=int(_DEPARTURE_H))).isoformat(),
            "currents": ["./tide.nc"],
        }
    ]
    scenario = Scenario.model_validate(table)
    fetched = _fetched_data(given)
    tracemalloc.start()
    (scene,) = _cases_of(scenario, replace(fetched, currents=(_tide(scenario),)))
    current = scene.current
    current.table(scene.chart.bounds)
    field, _ = tracemalloc.get_traced_memory()
    plan = renew.plan(
        scene.chart,
        current,
        scene.vessel,
        scene.start,
        scene.goal,
        classes=_CLASSES,
        distinct_by=scenario.planner.distinct_by,
        drift="crab",
        min_lateness=3600.0,
    )
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    name = f"{len(current.slice_times)} hours of a field round Palawan"
    yield at_most(f"{name}: memory", field / 2**20, 300, " MB", 0)
    yield Figure(
        f"{name}: memory with the plan of {_CLASSES} classes", "", f"{peak / 2**20:.0f} MB"
    )
    trials = collisions = 0
    for route in plan.routes:
        flown = renew.contingency(
            route,
            scene.chart,
            current,
            scene.vessel,
            spacing=_SPACING_M,
            drift="crab",
            min_lateness=3600.0,
        )
        trials, collisions = trials + flown.trials, collisions + flown.collisions
    yield Figure(
        f"turns early, on time and late on {len(plan.routes)} routes round Palawan, touching land",
        "0 of 100,000",
        f"{collisions} of {trials:,}",
        collisions == 0 and trials >= 100_000,
    )


def _tide(scenario: Scenario) -> CurrentGrid:
    """Eddies, and a tide that turns along ellipses and runs through the region as a wave."""
    assert scenario.region is not None
    west, south, east, north = scenario.region.shape.bounds
    lon = np.arange(west - 3 * _CELL_DEG, east + 3 * _CELL_DEG, _CELL_DEG)
    lat = np.arange(south - 3 * _CELL_DEG, north + 3 * _CELL_DEG, _CELL_DEG)
    x, y = np.meshgrid(2 * np.radians(lon) * 60, 2 * np.radians(lat) * 60)
    hours = np.arange(_HOURS + 1.0)
    phase = 2 * np.pi * hours[:, None, None] / _M2_H - np.radians(30) * (x + y) / 2
    spring = 1 + 0.3 * np.cos(2 * np.pi * hours / _SPRING_H)[:, None, None]
    u = _EDDIES_M_S * np.sin(x) * np.cos(y) + _TIDE_M_S * spring * np.cos(phase)
    v = -_EDDIES_M_S * np.cos(x) * np.sin(y) + 0.5 * _TIDE_M_S * spring * np.sin(phase)
    credit = Credit("A tide made up for a figure", "current", "", "CC0")
    times_s = 3600 * (hours - _DEPARTURE_H)
    return CurrentGrid("tide", lon, lat, u, v, "2026-11-22", credit, times_s=times_s)


def _fetched_data(scenario: Scenario) -> Fetched:
    """Land, and both seasons' currents of the embedded table."""
    with tempfile.TemporaryDirectory() as folder:
        return fetch(scenario, Store(Path(folder)), offline=True)


def _cases_of(scenario: Scenario, fetched: Fetched) -> tuple[Case, ...]:
    """The planner's cases, as a run makes them."""
    if scenario.region is None:
        raise ValueError(f"{scenario.name} has no region")
    region = scenario.region
    simplified = simplify_land(
        fetched.land.polygons,
        region.shape,
        margin_m=scenario.chart.margin_m,
        accuracy_m=fetched.land.accuracy_m,
        endpoints=(scenario.start, scenario.goal),
        projection=Projection.for_region(region.shape),
    )
    return project(scenario, fetched, simplified)


BEGIN = np.datetime64("2026-11-22")
# HAT and LAT of this station both lie 0.11 m above what its own mean sea level and constants give.
OTHER_LEVEL = "noaa-9415193"


def water_levels() -> Iterator[Figure]:
    """Yield each station's figures, then the largest of all."""
    found = stations()
    for name, predictor in PREDICTORS.items():
        both = {key: apart(one, predictor, BEGIN) for key, one in found.items()}
        for key, (most, rms) in both.items():
            text = f"{most:.2%} at most, {rms:.2%} rms"
            yield Figure(f"{key} ({found[key].name}) beside {name}", "", text)
        most, rms = np.max([*both.values()], axis=0)
        what = f"{len(both)} stations × 30 days beside {name}, share of the amplitudes' sum"
        yield at_most(f"{what}: most", 100 * float(most), 2.0, " %")
        yield at_most(f"{what}: rms", 100 * float(rms), 0.8, " %")
    off = []
    for key, station in found.items():
        highest, lowest = highest_and_lowest(station)
        high, low = highest - station.datums["HAT"], lowest - station.datums["LAT"]
        text = f"highest {1000 * high:+.0f}, lowest {1000 * low:+.0f} mm"
        yield Figure(f"{key} ({station.name}), 1983-2001 beside HAT and LAT", "", text)
        off += [high - low] if key == OTHER_LEVEL else [high, low]
    yield at_most(
        "beside HAT and LAT: rms", 1000 * float(np.sqrt(np.mean(np.square(off)))), 10.0, " mm", 1
    )
    yield at_most("beside HAT and LAT: most", 1000 * float(np.abs(off).max()), 25.0, " mm", 1)
