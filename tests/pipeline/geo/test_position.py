"""A position as text: by its hemispheres, on either side of Greenwich, the equator and 180."""

from __future__ import annotations

import pytest

from pipeline.geo.lonlat import position_text


@pytest.mark.parametrize(
    ("lon", "lat", "text"),
    [
        (119.871, 11.5244, "119.8710 E 11.5244 N"),
        (-70.9815, 42.3427, "70.9815 W 42.3427 N"),
        (-5.25, -36.5, "5.2500 W 36.5000 S"),
        (181.5, -17.0, "178.5000 W 17.0000 S"),
        (-181.0, 0.0, "179.0000 E 0.0000 N"),
    ],
)
def test_a_position_is_given_by_its_hemispheres(lon: float, lat: float, text: str) -> None:
    assert position_text(lon, lat) == text
