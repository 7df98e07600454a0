"""Yesterday's routes: the best route of each case in the cycle that tonight is compared with."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyarrow.parquet as pq
import shapely

from pipeline.nightly.cycle.part import Row

CASES_FILE = "cases.parquet"
_COLUMNS = ["status", "side", "class", "fuel", "arrival", "geometry"]


@dataclass(frozen=True)
class EarlierRoute:
    """Yesterday's best route of a case; its path (n, 2) is lon/lat, degrees."""

    cycle: str
    side: str
    homotopy: str
    fuel: float
    arrival: datetime | None
    path: npt.NDArray[np.float64]

    def columns(self) -> Row:
        """Return the columns that describe the route."""
        return {
            "earlier_cycle": self.cycle,
            "earlier_side": self.side,
            "earlier_class": self.homotopy,
            "earlier_arrival": self.arrival,
        }


@dataclass(frozen=True, slots=True)
class EarlierRoutes:
    """Yesterday's routes: the name of their cycle, and the path of its table of cases."""

    cycle: str
    path: Path

    def read(self, rows: Sequence[int]) -> dict[int, EarlierRoute]:
        """Read the routes of rows; rows without a route, and row -1, are left out."""
        wanted = sorted({row for row in rows if row >= 0})
        found: dict[int, EarlierRoute] = {}
        if not wanted:
            return found
        file = pq.ParquetFile(self.path)
        begin = 0
        for group in range(file.num_row_groups):
            end = begin + file.metadata.row_group(group).num_rows
            here = [row for row in wanted if begin <= row < end]
            if here:
                table = file.read_row_group(group, _COLUMNS).take([row - begin for row in here])
                for row, one in zip(here, table.to_pylist(), strict=True):
                    if one["geometry"] is not None:
                        found[row] = self._route(one)
            begin = end
        return found

    def _route(self, one: Row) -> EarlierRoute:
        """Return the route of one row."""
        return EarlierRoute(
            self.cycle,
            one["side"],
            one["class"],
            one["fuel"],
            one["arrival"],
            shapely.get_coordinates(shapely.from_wkb(one["geometry"])),
        )


class EarlierIndex:
    """The row numbers of yesterday's cases by name."""

    def __init__(self, path: Path) -> None:
        names = pq.read_table(path, columns=["case"])["case"].to_pylist()
        self._row = {name: row for row, name in enumerate(names)}

    def rows(self, names: Sequence[str]) -> list[int]:
        """Return the row number of each name; -1 for a new case."""
        return [self._row.get(name, -1) for name in names]
