"""Figures of the tide: streams that turn round Palawan, heights beside libraries, constants."""

from __future__ import annotations

import itertools
import math
import tempfile
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

import renew
from pipeline.model import Credit, CurrentGrid
from pipeline.scenario.loading import load_scenario
from pipeline.scenario.model import Scenario
from pipeline.sources.cf.harmonic_fit import fit_files
from tests.bench.figure import Figure, at_most
from tests.bench.palawan_figures import cases_of, fetched_data
from tests.stream_scenes import stream_scene
from tests.tidal_waters import SCALE, TidalScene, tidal_scene
from tests.tide_oracles import (
    NOISE,
    PREDICTORS,
    apart,
    fit_errors,
    highest_and_lowest,
    series,
    stations,
)

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
    fetched = fetched_data(given)
    tracemalloc.start()
    (scene,) = cases_of(scenario, replace(fetched, currents=(_tide(scenario),)))
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


BEGIN = np.datetime64("2026-11-22")
# HAT and LAT of this station both lie 0.11 m above what its own mean sea level and constants give.
OTHER_LEVEL = "noaa-9415193"
BARS, FLOWN, RAISED = range(20), range(100), range(220)
"""Seeds of the scenes with bars that are planned beside the oracle, of those that are flown, and of
those whose tide is raised, and whose bound is held against a coarse oracle."""
STREAMS = range(20)
"""Seeds of the scenes in tidal streams."""
FUEL = 1.005
"""Largest fuel over the oracle's."""
MOST_RAISED = 3.0
"""Largest height (m) by which a tide is raised: most of its bars are open at all times then."""
ROUNDING = 1e-9
"""Share of a bound by which equal ones may differ."""


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
    yield from fits()
    yield from streams()
    yield from bars()
    yield from raised()


def bars() -> Iterator[Figure]:
    """Yield figures of scenes with one to three bars that the tide shuts for some hours."""
    ratios, bounds, roundabout, shut, low, turns = [], [], 0, 0, 0, 0
    for seed in BARS:
        scene = tidal_scene(seed)
        fuel, path = scene.oracle(2.0 * SCALE)
        in_time = scene.is_in_time_for_water(path) and len(path) > 0
        try:
            best = scene.plan(padding="none", classes=8).best
        except renew.UnreachableError:
            shut += 1
            roundabout += in_time
            continue
        bounds.append(best.fuel_bound.value / fuel)
        if in_time and best.fuel > FUEL * fuel:
            roundabout += 1
        else:
            ratios.append(best.fuel / fuel)
    yield at_most(
        f"{len(BARS)} scenes with bars: dearest beside the oracle", max(ratios), FUEL, "", 5
    )
    yield Figure("ways that go roundabout until a bar opens are better", "", f"{roundabout}")
    yield Figure("every way is shut without", "", f"{shut}")
    yield at_most("bound beside the oracle", max(bounds), 1.0, "", 4)
    for seed in FLOWN:
        scene = tidal_scene(seed)
        try:
            routes = scene.plan(classes=3).routes
        except renew.UnreachableError:
            continue
        found = [scene.too_shallow(route) for route in routes]
        low, turns = low + sum(one for one, _ in found), turns + sum(count for _, count in found)
    yield at_most(f"passages and turns over too little water, of {turns:,}", low, 0)


def raised() -> Iterator[Figure]:
    """Yield what a higher tide does to fuel and bound, and how the bound lies to an oracle."""
    dearer, higher, shares = dict[int, float](), 0, list[float]()
    for seed in RAISED:
        scene = tidal_scene(seed)
        rises = [0.0, *np.sort(np.random.default_rng(seed).uniform(0.0, MOST_RAISED, 2)).tolist()]
        tides = [scene.with_tide_raised(rise) for rise in rises]
        fuels, bounds = [least_fuel(one) for one in tides], [one.bound for one in tides]
        changes = [
            after / before - 1 for before, after in itertools.pairwise(fuels) if before < math.inf
        ]
        if changes:
            dearer[seed] = max(changes)
        higher += any(
            after > before * (1 + ROUNDING) for before, after in itertools.pairwise(bounds)
        )
        fuel, _ = scene.oracle(6.0 * SCALE, is_coarse=True)
        shares += [bounds[0] / fuel] if math.isfinite(fuel) else []
    worst = max(dearer, key=dearer.__getitem__)
    what = f"tides raised twice by up to {MOST_RAISED:g} m"
    yield at_most(
        f"{what}, {len(dearer)} scenes with a way: dearer by at most (seed {worst})",
        100 * dearer[worst],
        0.1,
        " %",
        4,
    )
    yield at_most(f"{what}: bound higher, of {len(RAISED)} scenes", higher, 0)
    above = sum(share > 1 for share in shares)
    name = f"bound above a coarse oracle with the clock, {len(shares)} scenes with a way"
    yield Figure(name, "0", f"{above} (nearest {max(shares):.4f})", above == 0)


def least_fuel(scene: TidalScene) -> float:
    """Return the fuel of the best route; infinite where the tide shuts every way."""
    try:
        return scene.plan(classes=4).best.fuel
    except renew.UnreachableError:
        return math.inf


def fits() -> Iterator[Figure]:
    """Yield the errors of constants that are fitted to a synthetic year."""
    with tempfile.TemporaryDirectory() as folder:
        path = f"{folder}/hourly.nc"
        series(365).to_netcdf(path, engine="netcdf4")
        amplitude, phase, month = fit_errors(fit_files([path]))
    yield at_most("fit of a synthetic year: amplitudes", 100 * amplitude, 1.0, " %")
    yield at_most("fit of a synthetic year: phases", phase, 1.0, "°")
    yield at_most("fit of a synthetic year: the month after, rms", month, NOISE / 10, " m/s", 4)


def streams() -> Iterator[Figure]:
    """Yield by how much arrivals in the fields of constants differ from those in the exact sum."""
    apart_shares = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in STREAMS:
            scene = stream_scene(seed, Path(folder))
            best = scene.plan().best
            apart_shares.append(abs(best.times[-1] / scene.arrival(best.path) - 1))
    what = f"streams from constants beside the exact sum, {len(STREAMS)} scenes: arrival"
    yield at_most(what, 100 * max(apart_shares), 0.1, " %", 4)
