"""The deviation of a current from its linear interpolant, against the field itself."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import box

import renew
from renew.bounds.grids import deviation_radius, whole_grid
from tests.renew.bounds.fields import FIELDS, OPPOSITE, in_triangles
from tests.strategies import voyage_on


@pytest.mark.parametrize("name", FIELDS)
def test_the_current_stays_within_its_radius_of_the_interpolant(name: str) -> None:
    field, rng = FIELDS[name], np.random.default_rng(6)
    chart = renew.Chart(box(0, 0, 100, 100))
    grid = whole_grid(voyage_on(chart, (33.3, 77.7), OPPOSITE, field), 16_000)
    west, south = np.meshgrid(grid.x[:-1], grid.y[:-1])
    width, height = np.meshgrid(np.diff(grid.x), np.diff(grid.y))
    c = grid.current.uv[0]
    sw, se, nw, ne = c[:-1, :-1], c[:-1, 1:], c[1:, :-1], c[1:, 1:]
    for s, t in in_triangles(rng, 40)[0]:
        actual = field(np.stack([west + s * width, south + t * height], axis=-1))
        linear = (1 - s) * sw + (s - t) * se + t * ne
        assert (np.linalg.norm(actual - linear, axis=-1) <= grid.deviation + 1e-12).all()
        actual = field(np.stack([west + (1 - s) * width, south + t * height], axis=-1))
        linear = (s - t) * sw + (1 - s) * se + t * nw
        assert (np.linalg.norm(actual - linear, axis=-1) <= grid.deviation + 1e-12).all()


@pytest.mark.parametrize("name", FIELDS)
def test_the_radius_is_small_on_a_fine_grid_and_zero_in_still_water(name: str) -> None:
    field = FIELDS[name]
    x = y = np.linspace(0, 100, 101)
    nodes = np.stack(np.meshgrid(x, y), axis=-1)
    radius = deviation_radius(field, x, y, field(nodes)[None])
    assert radius.shape == (100, 100)
    # On a grid of 1 m a smooth current deviates by far less than its own strength.
    if name != "coarse grid":
        assert radius.max() < 0.02 * np.linalg.norm(field(nodes), axis=-1).max()
    still = renew.UniformCurrent(0, 0)
    assert not deviation_radius(still, x, y, still(nodes)[None]).any()
