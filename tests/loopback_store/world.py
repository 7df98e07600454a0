"""The setting of the loopback tests: a sea with one island, and the catalogue's datasets.

The island is as large as a chunk of the store, so that one chunk has no data at all.
"""

import contextlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import trustme

from pipeline.model import Credit, CurrentGrid, Land
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import CopernicusSpec
from pipeline.scenario.season import Season
from pipeline.sources.copernicus.client import (
    PASSWORD as PASSWORD_VARIABLE,
    USERNAME as USERNAME_VARIABLE,
)
from tests.loopback_store.datasets import Dataset, Ocean, step_times
from tests.loopback_store.server import PASSWORD, USERNAME, LoopbackStore

REGION = shapely.box(116.2, 6.2, 121.34, 12.4)
ISLAND = shapely.box(118.62, 7.96, 121.28, 10.62)
LAND = Land((ISLAND,), (Credit("an island", "land", "", ""),), 0.0)
OCEAN = Ocean((ISLAND,))
# Largest error of a correct field, m/s: half a step of the packed datasets, and the effect of
# coordinates in float32.
TOLERANCE_M_S = 0.5 * 0.00061037 + 1e-4


@cache
def authority() -> trustme.CA:
    """Return the certificate authority of all stores."""
    return trustme.CA()


@cache
def spec(name: str) -> CopernicusSpec:
    """Return a dataset's entry in the catalogue."""
    found = catalogue.source(name)
    assert isinstance(found, CopernicusSpec)
    return found


def names() -> tuple[str, ...]:
    """Return the names of the catalogue's entries that are datasets of the service."""
    return tuple(
        name
        for name in catalogue.names("sources")
        if isinstance(catalogue.source(name), CopernicusSpec)
    )


def dataset(name: str, *, ends: str = "", lacking: str = "", **changes: Any) -> Dataset:
    """Return the dataset of an entry as the service would have it today.

    `ends` is its last day; a `lacking` day is in the service's catalogue but not in the data.
    """
    entry = spec(name)
    if entry.kind == "climatology":
        first, last = datetime(1993, 1, 1, tzinfo=UTC), datetime(1993, 12, 1, tzinfo=UTC)
    else:
        first = _day(entry.first_day)
        last = _day(ends) if ends else today() + timedelta(days=entry.days_ahead)
        last = last.replace(day=1) if entry.step == "month" else last + timedelta(hours=23)
    stamps = step_times(first, last, entry.step)
    if entry.step == "hour" and entry.kind == "mean":
        stamps = tuple(stamp + timedelta(minutes=30) for stamp in stamps)
    made = Dataset(
        name=entry.dataset,
        product=entry.product,
        version=entry.version,
        times=stamps,
        cell_deg=entry.cell_deg,
        variables=tuple(dict.fromkeys(("uo", "vo", entry.eastward, entry.northward))),
        packed="anfc" not in entry.dataset,
    )
    if entry.depth_m is None:
        made = replace(made, depths=made.depths[:1])
    if entry.depth_m == 0:
        made = replace(made, depths=(0.0, 15.0))
    if lacking:
        made = replace(
            made, stored_times=tuple(stamp for stamp in stamps if stamp != _day(lacking))
        )
    return replace(made, **changes)


def _day(text: str) -> datetime:
    """Return a day's midnight, UTC."""
    return datetime.fromisoformat(text).replace(tzinfo=UTC)


def season(valid: str) -> Season:
    """Return a season of a time."""
    return Season(name="season", valid=valid, currents=("copernicus",))


def changing_season(name: str, departure: datetime, max_hours: float) -> Season:
    """Return a season from a departure on, in which the currents of an entry change."""
    return Season(
        name="season",
        time_method="changing",
        departure=departure,
        max_hours=max_hours,
        currents=(name,),
    )


def today() -> datetime:
    """Return today's midnight, UTC."""
    return datetime.now(UTC).replace(hour=0, minute=0, second=0, microsecond=0)


def store(name: str, *, ocean: Ocean = OCEAN, **changes: Any) -> LoopbackStore:
    """Return a store with the dataset of an entry, not yet running."""
    return LoopbackStore(ocean, (dataset(name, **changes),), authority())


@contextlib.contextmanager
def connected(
    served: LoopbackStore, home: Path, changes: Mapping[str, str] | None = None
) -> Iterator[None]:
    """Run a store where the client finds it, without this machine's own account."""
    home.mkdir(exist_ok=True)
    with pytest.MonkeyPatch.context() as patch, served.running():
        for name in list(os.environ):
            if name.startswith("COPERNICUS") or name.upper() == "NO_PROXY":
                patch.delenv(name)
        variables = {
            "HOME": str(home),
            "COPERNICUSMARINE_CREDENTIALS_DIRECTORY": str(home),
            USERNAME_VARIABLE: USERNAME,
            PASSWORD_VARIABLE: PASSWORD,
            **served.environment(home),
        }
        for name, value in {**variables, **(changes or {})}.items():
            patch.setenv(name, value)
        yield


def max_error_m_s(
    grid: CurrentGrid,
    eastward: str,
    northward: str,
    *moments: datetime,
    ocean: Ocean = OCEAN,
    step: int = 0,
) -> float:
    """Return a field's largest error against the ocean's mean; infinite where gaps differ."""
    largest = 0.0
    for values, name in ((grid.u[step], eastward), (grid.v[step], northward)):
        true_values = np.mean(
            [ocean.value(name, moment, grid.lon, grid.lat) for moment in moments], axis=0
        )
        if (np.isfinite(values) != np.isfinite(true_values)).any():
            return float("inf")
        largest = max(largest, float(np.nanmax(np.abs(values - true_values))))
    return largest
