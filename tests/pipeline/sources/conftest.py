"""Fixtures for the tests of the sources."""

import pytest

from pipeline.sources.current_field import LandMask


@pytest.fixture(scope="session")
def world_mask() -> LandMask:
    """Give the land mask of the world, once: it takes seconds to load."""
    return LandMask.world()
