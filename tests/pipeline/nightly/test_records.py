"""Yesterday's routes, read from the table of cases of another cycle."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import shapely

from pipeline.nightly.records import earlier_routes


def test_a_table_of_an_earlier_version_without_islands_is_read(tmp_path: Path) -> None:
    row = {
        "case": "quick/still",
        "status": "planned",
        "side": "west of Palawan",
        "class": "p1",
        "fuel": 3.0,
        "arrival": None,
        "geometry": shapely.to_wkb(shapely.LineString([(0, 0), (1, 2)])),
    }
    pq.write_table(pa.Table.from_pylist([row]), tmp_path / "cases.parquet")
    routes = earlier_routes("2026-11-20T00Z", tmp_path / "cases.parquet")
    assert list(routes) == ["quick/still"]
    assert routes["quick/still"].columns()["earlier_side"] == "west of Palawan"
    assert routes["quick/still"].island == ""
