"""Small nights: a plane with one obstacle, or a region with its own files of currents.

They are planned without padding, which would take half of the time.
"""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from pipeline.nightly import cycles, night
from tests.pipeline.small_plane import small_plane
from tests.pipeline.small_region import small_region
from tests.pipeline.synthetic_currents import dataset, sea, write

# Two shores of one island, so that there are two sides to choose from.
_ISLAND = [[118.45, 10.22], [118.55, 10.22], [118.55, 10.28], [118.5, 10.31], [118.45, 10.28]]
REFERENCE = datetime(2026, 11, 21, tzinfo=UTC)


def plane_night(folder: Path, pairs: int = 6, u: float = 0.1, **keys: object) -> Path:
    """Write a night of some pairs in a plane; return its file. `u` is the current, m/s."""
    folder.mkdir(parents=True, exist_ok=True)
    text = small_plane("quick", classes=2).replace("u = 0.1", f"u = {u}")
    (folder / "quick.toml").write_text(f'{text}padding = "none"\n')
    rows = [f"10,{20 + 60 * i / max(pairs - 1, 1):.3f},90,50,p{i:04}" for i in range(pairs)]
    (folder / "pairs.csv").write_text("start_x,start_y,goal_x,goal_y,name\n" + "\n".join(rows))
    return write_night(
        folder, 'scenario = "quick.toml"\npairs = "pairs.csv"\n', **{"workers": 2, **keys}
    )


def write_night(folder: Path, cases: str, **keys: object) -> Path:
    """Write a night's file with one [[cases]] table."""
    file = folder / "night.toml"
    lines = "".join(f"{key} = {json.dumps(value)}\n" for key, value in keys.items())
    file.write_text(f"{lines}[[cases]]\n{cases}")
    return file


def region_night(folder: Path, departures: int = 2, **keys: object) -> Path:
    """Write a night in a small region around an island, on the files in `currents/`."""
    folder.mkdir(parents=True, exist_ok=True)
    shape = {"type": "Polygon", "coordinates": [[*_ISLAND, _ISLAND[0]]]}
    (folder / "island.geojson").write_text(json.dumps(shape))
    (folder / "region.toml").write_text(
        small_region("around")
        + """[chart]
source = { path = "./island.geojson", accuracy_m = 50 }
tolerance_m = 500
[[seasons]]
name = "now"
valid = "2024-07"
currents = ["still"]
[planner]
classes = 2
padding = "none"
"""
    )
    cases = (
        'scenario = "region.toml"\nmembers = "currents/*.nc"\n'
        f'departures = {{ first = "06:00Z", every = "6h", count = {departures} }}\n'
    )
    return write_night(folder, cases, **{"workers": 2, "stale_hours": 1e6, **keys})


def write_forecast(
    path: Path,
    reference: datetime = REFERENCE,
    *,
    steps: int = 9,
    seed: int = 1,
    says_reference: bool = True,
    speed_m_s: float = 0.3,
    changes: bool = False,
) -> Path:
    """Write a forecast of some steps, six hours apart, from its reference time on."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lon, lat = np.arange(117.0, 121.0, 0.25), np.arange(8.0, 12.0, 0.25)
    fields = [
        sea(lon, lat, seed=seed + i if changes else seed, speed_m_s=speed_m_s) for i in range(steps)
    ]
    times = [(reference + i * timedelta(hours=6)).replace(tzinfo=None) for i in range(steps)]
    data = dataset(*fields, times=times)
    if says_reference:
        data = data.assign_coords(
            forecast_reference_time=(
                (),
                np.datetime64(reference.replace(tzinfo=None), "ns"),
                {"standard_name": "forecast_reference_time"},
            )
        )
    write(path, data)
    return path


def rows(output: Path, name: str = "cases.parquet") -> list[dict[str, Any]]:
    """Return the rows of a table of the cycle that `latest` names."""
    found: list[dict[str, Any]] = pq.read_table(output / "latest" / name).to_pylist()
    return found


def contents(output: Path) -> dict[str, Any]:
    """Return a cycle's content, without times of making: tables by rows, the rest by bytes."""
    import pyogrio

    held: dict[str, Any] = {}
    for path in sorted((output / "latest").iterdir()):
        if path.suffix == ".parquet":
            held[path.name] = pq.read_table(path).to_pylist()
        elif path.suffix == ".gpkg":
            meta, _, shapes, columns = pyogrio.raw.read(path)
            held[path.name] = (
                list(meta["fields"]),
                shapes.tolist(),
                [[str(value) for value in column] for column in columns],
            )
        elif path.name != "night.json":
            held[path.name] = path.read_bytes()
    return held


def set_clock(monkeypatch: pytest.MonkeyPatch, moment: datetime) -> None:
    """Let this machine's clock stand at a moment, for a night."""

    class Clock(datetime):
        @classmethod
        def now(cls, tz: object = None) -> datetime:  # type: ignore[override]
            del tz
            return moment

    monkeypatch.setattr(night, "datetime", Clock)
    monkeypatch.setattr(cycles, "datetime", Clock)
