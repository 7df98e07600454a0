"""A chart of S-57 cells, in a folder or below it: the source of land."""

import hashlib
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import shapely

from pipeline.errors import RequestError
from pipeline.machine.paths import require_readable
from pipeline.machine.store import file_hash
from pipeline.model import Land
from pipeline.model.depths import DepthRule
from pipeline.sources.land import shapes
from pipeline.sources.land.s57 import CLASSES, land
from pipeline.sources.land.s57_cells import base_files, cell_files, read_cell

# Largest number of cells that a message names.
_MAX_NAMES = 8


@dataclass(frozen=True)
class S57Chart:
    """Cells (.000) with their updates in a folder or below it, or one cell.

    `rule` says which depths are deep enough.
    """

    path: Path
    rule: DepthRule

    @cached_property
    def identity(self) -> tuple[str, ...]:
        """Which depths are deep enough, and a hash of all files."""
        digest = hashlib.sha256()
        bases = self._bases
        with shapes.reading(str(self.path), "fetch the cells and their updates again"):
            for base in bases:
                for file in cell_files(base):
                    digest.update(file.name.encode() + file_hash(file).encode())
        return ("s57", f"{self.rule!r}", digest.hexdigest())

    @cached_property
    def _bases(self) -> tuple[Path, ...]:
        """Base files of the cells, each cell once."""
        return find_cells(self.path)

    def land(self, region: shapely.Polygon) -> Land:
        """Return the no-go areas near a region (lon/lat degrees), and the chart's zones."""
        box = shapes.box_around(region)
        read = (read_cell(base, box, CLASSES) for base in self._bases)
        cells = [cell for cell in read if cell is not None]
        if not any(cell.covered.intersects(region) for cell in cells):
            names = ", ".join(base.stem for base in self._bases[:_MAX_NAMES])
            raise RequestError(
                f"no S-57 cell in {self.path} covers any of the region; it holds {names}"
                f"{' and others' * (len(self._bases) > _MAX_NAMES)}: fetch the region's cells"
            )
        # Geometries that are valid one by one may fail together, where a cell is damaged.
        with shapes.reading(str(self.path), "fetch the cells and their updates again"):
            return land(cells, box, region, self.rule)


def find_cells(path: Path) -> tuple[Path, ...]:
    """Find the base files of the cells in a folder and below it, each cell once.

    Raises
    ------
    RequestError
        There is no cell, a cell is there twice, or a file can't be read.
    """
    found = base_files(path)
    if not found:
        raise RequestError(f"{path} holds no S-57 cell (.000 file): name the folder of the cells")
    twice = [name for name, count in Counter(base.stem for base in found).items() if count > 1]
    if twice:
        where = f"in {path}; keep the latest"
        raise RequestError([f"cell {name} is there more than once {where}" for name in twice])
    require_readable((file for base in found for file in cell_files(base)), "chart.source")
    return found
