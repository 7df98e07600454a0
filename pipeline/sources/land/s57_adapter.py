"""A folder of S-57 cells behind the LandSource interface."""

import hashlib
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from shapely.geometry import Polygon

from pipeline.errors import RequestError
from pipeline.machine.paths import require_readable
from pipeline.machine.storage.store import file_hash
from pipeline.model import Land

# Largest number of cells that a message names.
_MAX_NAMES = 8


@dataclass(frozen=True)
class S57Chart:
    """Cells (.000) with their updates in a folder or below it, or one cell.

    `safety_depth_m` is draught plus under-keel clearance.
    """

    path: Path
    safety_depth_m: float

    @cached_property
    def identity(self) -> tuple[str, ...]:
        """Safety depth, and a hash of all files."""
        from pipeline.sources.land.damage import reading
        from pipeline.sources.land.s57_cells import cell_files

        digest = hashlib.sha256()
        bases = self._bases
        with reading(str(self.path), "fetch the cells and their updates again"):
            for base in bases:
                for file in cell_files(base):
                    digest.update(file.name.encode() + file_hash(file).encode())
        return ("s57", f"{self.safety_depth_m!r}", digest.hexdigest())

    @cached_property
    def _bases(self) -> tuple[Path, ...]:
        """Base files of the cells, each cell once."""
        return find_cells(self.path)

    def land(self, region: Polygon) -> Land:
        """Return the no-go areas near a region (lon/lat degrees), and the chart's zones."""
        from pipeline.sources.land import s57
        from pipeline.sources.land.damage import reading
        from pipeline.sources.land.polygons import box_around
        from pipeline.sources.land.s57_cells import read_cell

        box = box_around(region)
        read = (read_cell(base, box, s57.CLASSES) for base in self._bases)
        cells = [cell for cell in read if cell is not None]
        if not any(cell.covered.intersects(region) for cell in cells):
            names = ", ".join(base.stem for base in self._bases[:_MAX_NAMES])
            fault = (
                f"no S-57 cell in {self.path} covers any of the region; it holds {names}"
                f"{' and others' * (len(self._bases) > _MAX_NAMES)}: fetch the region's cells"
            )
            raise RequestError([fault])
        # Geometries that are valid one by one may fail together, where a cell is damaged.
        with reading(str(self.path), "fetch the cells and their updates again"):
            return s57.land(cells, box, region, self.safety_depth_m)


def find_cells(path: Path) -> tuple[Path, ...]:
    """Find the base files of the cells in a folder and below it, each cell once.

    Raises
    ------
    RequestError
        There is none, one is there twice, or a file can't be read.
    """
    from pipeline.sources.land.s57_cells import base_files, cell_files

    found = base_files(path)
    if not found:
        fault = f"{path} holds no S-57 cell (.000 file): name the folder of the cells"
        raise RequestError([fault])
    twice = [name for name, count in Counter(base.stem for base in found).items() if count > 1]
    if twice:
        where = f"in {path}; keep the latest"
        raise RequestError([f"cell {name} is there more than once {where}" for name in twice])
    require_readable((file for base in found for file in cell_files(base)), "chart.source")
    return found
