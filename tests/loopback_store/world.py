"""What the tests ask the loopback store for: a sea with one island, and every dataset known here.

The island is as large as a chunk of the store, so that one chunk holds no figure at all.
"""

from __future__ import annotations

import contextlib
import os
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import shapely
import trustme

from pipeline.model import Credit, Land
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import CopernicusSpec
from pipeline.scenario.model import Season
from pipeline.sources.currents.copernicus.account import PASSWORD as PASSWORD_VARIABLE
from pipeline.sources.currents.copernicus.account import USERNAME as USERNAME_VARIABLE
from tests.loopback_store.datasets import Dataset, times
from tests.loopback_store.ocean import Ocean
from tests.loopback_store.server import PASSWORD, USERNAME, LoopbackStore

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from pipeline.model import CurrentGrid

REGION = shapely.box(116.2, 6.2, 121.34, 12.4)
ISLAND = shapely.box(118.62, 7.96, 121.28, 10.62)
LAND = Land((ISLAND,), (Credit("an island", "land", "", ""),), 0.0)
OCEAN = Ocean((ISLAND,))
# Half a step of the packed datasets, and what a coordinate in float32 moves the formula by.
TOLERANCE_M_S = 0.5 * 0.00061037 + 1e-4


@cache
def authority() -> trustme.CA:
    """The certificate authority of all stores."""
    return trustme.CA()


@cache
def spec(name: str) -> CopernicusSpec:
    """A dataset's entry in the catalogue."""
    found = catalogue.source(name)
    assert isinstance(found, CopernicusSpec)
    return found


def names() -> tuple[str, ...]:
    """Entries of the catalogue that are datasets of the service."""
    return tuple(
        name
        for name in catalogue.names("sources")
        if isinstance(catalogue.source(name), CopernicusSpec)
    )


def dataset(name: str, *, ends: str = "", lacking: str = "", **changes: Any) -> Dataset:  # noqa: ANN401 - what `Dataset` takes
    """The dataset of an entry as the service would hold it today.

    It `ends` with a day; what the catalogue says of a `lacking` day is not in the data.
    """
    entry = spec(name)
    if entry.kind == "climatology":
        first, last = datetime(1993, 1, 1, tzinfo=UTC), datetime(1993, 12, 1, tzinfo=UTC)
    else:
        first = _day(entry.first_day)
        last = _day(ends) if ends else today() + timedelta(days=entry.days_ahead)
        last = last.replace(day=1) if entry.step == "month" else last + timedelta(hours=23)
    stamps = times(first, last, entry.step)
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
        made = replace(made, stored=tuple(stamp for stamp in stamps if stamp != _day(lacking)))
    return replace(made, **changes)


def _day(text: str) -> datetime:
    """A day's midnight, UTC."""
    return datetime.fromisoformat(text).replace(tzinfo=UTC)


def season(valid: str) -> Season:
    """A season of a time."""
    return Season(name="season", valid=valid, currents=("copernicus",))


def today() -> datetime:
    """Midnight, UTC."""
    return datetime.now(UTC).replace(hour=0, minute=0, second=0, microsecond=0)


def store(name: str, *, ocean: Ocean = OCEAN, **changes: Any) -> LoopbackStore:  # noqa: ANN401 - what `dataset` takes
    """A store with the dataset of an entry, not yet running."""
    return LoopbackStore(ocean, (dataset(name, **changes),), authority())


@contextlib.contextmanager
def connected(
    served: LoopbackStore, home: Path, changes: Mapping[str, str] | None = None
) -> Iterator[None]:
    """Run a store where the client finds it, and nothing of this machine's own account."""
    home.mkdir(exist_ok=True)
    with pytest.MonkeyPatch.context() as patch, served.running():
        for name in list(os.environ):
            if name.startswith("COPERNICUS") or name.upper() == "NO_PROXY":
                patch.delenv(name)
        ours = {
            "HOME": str(home),
            "COPERNICUSMARINE_CREDENTIALS_DIRECTORY": str(home),
            USERNAME_VARIABLE: USERNAME,
            PASSWORD_VARIABLE: PASSWORD,
            **served.environment(home),
        }
        for name, value in {**ours, **(changes or {})}.items():
            patch.setenv(name, value)
        yield


def wrong_by(
    grid: CurrentGrid,
    eastward: str,
    northward: str,
    *moments: datetime,
    ocean: Ocean = OCEAN,
) -> float:
    """Largest error of a field (m/s) against the mean of the truth; inf where gaps differ."""
    worst = 0.0
    for values, name in ((grid.u, eastward), (grid.v, northward)):
        truth = np.mean(
            [ocean.value(name, moment, grid.lon, grid.lat) for moment in moments], axis=0
        )
        if (np.isfinite(values) != np.isfinite(truth)).any():
            return float("inf")
        worst = max(worst, float(np.nanmax(np.abs(values - truth))))
    return worst
