"""What tests keep in a process: the world's land mask, a region's land, and who opens files first.

Each takes a second or a part of it each time. A program reads a few files of currents, and gives
all back; the tests read hundreds. As a module that a Dask worker loads first, it does so there.
"""

import atexit
import functools

from pipeline.machine.workers import Worker
from pipeline.sources.cf import dataset
from pipeline.sources.current_field import LandMask
from pipeline.sources.land import osm


class KeptWorker(Worker):
    """A worker that serves the next block, too; it ends with this process."""

    def __init__(self) -> None:
        super().__init__()
        atexit.register(self.kill)

    def __exit__(self, *_: object) -> None:
        """Leave it as it is."""


def keep() -> None:
    """Keep all from their first use on."""
    if not hasattr(LandMask.world, "cache_info"):
        LandMask.world = functools.cache(LandMask.world)  # type: ignore[method-assign]
        osm.land_polygons = functools.cache(osm.land_polygons)
        dataset.Worker = functools.cache(KeptWorker)  # type: ignore[attr-defined, assignment]


def dask_setup(_: object) -> None:
    """Keep all in this worker."""
    keep()
