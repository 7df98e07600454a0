"""The land mask of the world, loaded once a process: it takes a second each time.

A program reads a few files of currents, and then gives the mask's 300 MB back; the tests read
hundreds. As a module that a Dask worker loads first, it does the same there.
"""

from __future__ import annotations

import functools

from pipeline.sources.current_field import LandMask


def keep_land_mask() -> None:
    """Keep the mask from its first use on."""
    if not hasattr(LandMask.world, "cache_info"):
        LandMask.world = functools.cache(LandMask.world)  # type: ignore[method-assign]


def dask_setup(_: object) -> None:
    """Keep it in this worker."""
    keep_land_mask()
