"""Crossings of the second shoreline's land are found, measured and reported."""

from __future__ import annotations

import dataclasses

import numpy as np
import pyproj
import pytest
import shapely

import renew
from pipeline.findings.note_words import note_texts
from pipeline.findings.result import crossing_notes
from pipeline.geo.projection import Projection
from pipeline.model import ShoreCrossing, Water
from pipeline.scenario.region import ChartSpec
from pipeline.stages.measure import SecondShoreline

REGION = shapely.box(23.0, 36.0, 25.0, 38.0)
# Two islands of the second shoreline; the northern one is in two overlapping pieces.
ISLANDS = [
    shapely.box(24.0, 36.5, 24.1, 36.6),
    shapely.box(24.0, 37.5, 24.1, 37.6),
    shapely.box(24.08, 37.5, 24.2, 37.6),
]


@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_each_crossing_is_where_and_as_long_as_on_earth(scale: float) -> None:
    projection = Projection.for_region(REGION, scale)
    plain = Water(renew.Chart(projection.geometry_to_plane(REGION)), (), projection)
    shore = tuple(projection.geometry_to_plane(np.array(ISLANDS, dtype=object)))
    water = dataclasses.replace(plain, second_shore=shore)
    path = projection.to_plane([(23.5, 36.55), (24.5, 36.55), (24.5, 37.55), (23.5, 37.55)])
    south, north = SecondShoreline(water).crossings(path, 2)
    geod = pyproj.Geod(ellps="WGS84")
    for found, lat, east in ((south, 36.55, 24.1), (north, 37.55, 24.2)):
        assert found.rank == 2
        assert (found.lon, found.lat) == pytest.approx(((24.0 + east) / 2, lat), abs=2e-3)
        length_m = geod.inv(24.0, lat, east, lat)[2]
        assert found.length_m == pytest.approx(length_m, rel=2e-3)
    clear = projection.to_plane([(23.5, 36.2), (24.5, 36.2)])
    assert SecondShoreline(water).crossings(clear, 1) == ()
    assert SecondShoreline(plain).crossings(path, 1) == ()


def test_notes_list_the_places_of_the_best_route_and_the_longest_others() -> None:
    best = ShoreCrossing(1, 24.0, 37.1, 100.0)
    same = ShoreCrossing(4, 24.0001, 37.1001, 105.0)
    others = [ShoreCrossing(i, 24.0, 37.0 + i / 10, 100.0 * i) for i in range(2, 11)]
    winter = ShoreCrossing(1, -5.25, -36.5, 60.4)
    (one,) = note_texts(crossing_notes([*others, same, best], ChartSpec()))
    (other,) = note_texts(crossing_notes([winter], ChartSpec()))
    places = one.split("; check these places on an official chart: ")[1].split("; ")
    assert places[0] == "105 m at 24.0001 E 37.1001 N on routes 1, 4"
    assert places[1] == "1,000 m at 24.0000 E 38.0000 N on route 10"
    assert places[7] == "400 m at 24.0000 E 37.4000 N on route 4"
    assert places[8] == "and 2 shorter"
    assert other.endswith(": 60 m at 5.2500 W 36.5000 S on route 1")
    assert crossing_notes([], ChartSpec()) == ()
