from __future__ import annotations

import math

import numpy as np
import pyproj
import pytest
import shapely
from hypothesis import given, strategies as st

from pipeline.formats.figures.map_marks import graticule, nice_step, scale_bar_m
from pipeline.geo.projection import Projection


@given(st.floats(1e-9, 1e9))
def test_nice_steps_are_round_and_near(value: float) -> None:
    up, down = nice_step(value), nice_step(value, down=True)
    assert down <= value * (1 + 1e-8)
    assert up >= value * (1 - 1e-8)
    for step in (up, down):
        digit = step / 10.0 ** math.floor(math.log10(step) + 1e-9)
        assert min(abs(digit - round_) for round_ in (1, 2, 5)) < 1e-6
        assert 1 / 2.6 < step / value < 2.6


@pytest.mark.parametrize("latitude", [0.0, 10.0, -45.0, 70.0])
@pytest.mark.parametrize("scale", [1.0, 5000.0])
def test_lines_are_where_their_labels_say(latitude: float, scale: float) -> None:
    region = shapely.box(100, latitude, 107, latitude + 6)
    projection = Projection.for_region(region, scale)
    extent = projection.geometry_to_plane(region.segmentize(0.1))
    lines = graticule(projection, extent)
    assert sum(line.is_meridian for line in lines) >= 3
    for line in lines:
        lonlat = projection.to_lonlat(np.concatenate(line.parts))
        number = float(line.label.split("°")[0]) * (-1 if line.label[-1] in "SW" else 1)
        # A line is clipped at the extent, whose edges bend by less than this.
        constant = lonlat[:, 0 if line.is_meridian else 1]
        assert constant == pytest.approx(np.full(len(constant), number), abs=2e-3)
        assert shapely.distance(shapely.Point(line.foot), extent) < 2e-3 * extent.length


def test_a_meridian_on_the_edge_is_labelled_at_its_foot() -> None:
    """The region begins at 119 E; the chart's straight edge and that meridian cross."""
    region = shapely.box(119.0, 9.0, 120.2, 10.0)
    projection = Projection.for_region(region)
    extent = projection.geometry_to_plane(region)
    [edge] = [line for line in graticule(projection, extent) if line.label == "119°00′E"]
    assert edge.foot[1] < extent.bounds[1] + 0.01 * (extent.bounds[3] - extent.bounds[1])


@pytest.mark.parametrize(
    ("box", "labels"),
    [
        ((179.0, -1.0, 181.0, 1.0), {"179°00′E", "179°30′E", "180°00′", "179°30′W", "0°00′"}),
        ((10.0, 54.0, 10.1, 54.05), {"10°00′E", "10°02′E", "54°02′N"}),
        ((0.0, 0.0, 0.004, 0.004), {"0°00′00″", "0°00′02″E", "0°00′02″N"}),
    ],
)
def test_labels_have_the_steps_precision(box: tuple[float, ...], labels: set[str]) -> None:
    region = shapely.box(*box)
    projection = Projection.for_region(region)
    lines = graticule(projection, projection.geometry_to_plane(region))
    assert labels <= {line.label for line in lines}


def test_a_plane_in_metres_gets_a_grid_in_metres() -> None:
    lines = graticule(Projection.at(0, 0), shapely.box(0, 0, 100, 100), in_metres=True)
    assert [line.label for line in lines if line.is_meridian] == [
        *("0 m", "20 m", "40 m", "60 m", "80 m", "100 m")
    ]
    assert [line.foot for line in lines if line.label == "40 m"] == [(40.0, 0.0), (0.0, 40.0)]


@pytest.mark.parametrize("latitude", [0.0, 45.0, 75.0])
@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_the_scale_bar_is_true(latitude: float, scale: float) -> None:
    region = shapely.box(-3, latitude, 4, latitude + 5)
    projection = Projection.for_region(region, scale)
    bounds = projection.geometry_to_plane(region.segmentize(0.1)).bounds
    length_m, length = scale_bar_m(projection, bounds)
    middle = np.array([(bounds[0] + bounds[2]) / 2, (bounds[1] + bounds[3]) / 2])
    half = np.array([length / 2, 0])
    ends = projection.to_lonlat(np.stack([middle - half, middle + half]))
    *_, measured = pyproj.Geod(ellps="WGS84").inv(*ends[0], *ends[1])
    assert measured == pytest.approx(length_m, rel=2e-3)
    assert 0.1 < length / (bounds[2] - bounds[0]) <= 0.3
