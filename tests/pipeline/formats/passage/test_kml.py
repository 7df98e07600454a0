"""KML: valid by the OGC's schema, and what GDAL reads back."""

from __future__ import annotations

from datetime import UTC, datetime
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pyogrio
import pytest
import shapely
from lxml import etree

from pipeline.findings.result import RunResult
from pipeline.formats.appearance import season_colour
from pipeline.formats.passage.routes import write_kml
from pipeline.formats.passage.waypoints import both_sides
from tests.pipeline.formats import oracles, runs, small_run

Element: TypeAlias = Any  # lxml has no types
NAMESPACE = "{http://www.opengis.net/kml/2.2}"
DEPARTURE = datetime(2026, 12, 31, 20, 30, tzinfo=UTC)


@cache
def schema() -> etree.XMLSchema:
    """The OGC's schema of KML 2.2, which the package fastkml carries."""
    return etree.XMLSchema(etree.parse(str(files("fastkml") / "schema" / "ogckml22.xsd")))


def written(result: RunResult, path: Path, departure: datetime | None = None) -> Element:
    write_kml(result.case(result.results[0].name), path, departure=departure)
    root = etree.parse(path).getroot()
    schema().assertValid(root)
    return root


def texts(root: Element, name: str) -> list[str]:
    return [element.text for element in root.iter(f"{NAMESPACE}{name}")]


@pytest.mark.parametrize("departure", [None, DEPARTURE])
def test_the_schema_of_the_ogc_holds(
    any_run: RunResult, tmp_path: Path, departure: datetime | None
) -> None:
    root = written(any_run, tmp_path / "a.kml", departure)
    times = texts(root, "when")
    best = both_sides(any_run.case(any_run.results[0].name))[0]
    assert len(times) == (len(best.lonlat) if departure else 0)
    if departure:
        assert times[0] == "2026-12-31T20:30:00Z"
        arrival = datetime.fromisoformat(times[-1]) - departure
        assert arrival.total_seconds() == pytest.approx(best.time_s[-1], abs=1)


def test_the_schema_refuses_what_is_wrong(tmp_path: Path) -> None:
    root = written(runs.across_180(), tmp_path / "a.kml")
    place = root.find(f".//{NAMESPACE}Placemark")
    place.append(place[0])  # the name has to come first
    assert not schema().validate(root)


def test_lines_are_the_legs_and_points_the_waypoints(any_run: RunResult, tmp_path: Path) -> None:
    """Each line is within 10 m of the loxodromes, where a straight one may be 20 km off."""
    root = written(any_run, tmp_path / "a.kml")
    found = both_sides(any_run.case(any_run.results[0].name))
    lines = [p for p in root.iter(f"{NAMESPACE}Placemark") if p.find(f"{NAMESPACE}Point") is None]
    assert len(lines) == len(found)
    for placemark, points in zip(lines, found, strict=True):
        parts = [
            np.array([[float(x) for x in place.split(",")] for place in text.split()])
            for text in texts(placemark, "coordinates")
        ]
        line = np.concatenate(parts)
        assert np.abs(line[:, 0]).max() <= 180
        line[:, 0] = points.lonlat[0, 0] + (line[:, 0] - points.lonlat[0, 0] + 180) % 360 - 180
        drawn = np.concatenate(oracles.drawn(points))
        one, other = (oracles.in_plane(any_run, part) for part in (line, drawn))
        apart_m = shapely.hausdorff_distance(one, other) * any_run.water.projection.scale
        # Points of the oracle's line are 200 m apart.
        assert apart_m < 110 + 10
        assert (
            shapely.distance(shapely.points(other.coords), one).max()
            * (any_run.water.projection.scale)
            < 12
        )


def test_gdal_reads_routes_and_waypoints(tmp_path: Path) -> None:
    path, result = tmp_path / "a.kml", small_run.parts()
    written(result, path)
    best, *_ = found = both_sides(result.case("summer"))
    counted = {
        name: pyogrio.read_info(path, layer=name)["features"]
        for name, _ in pyogrio.list_layers(path)
    }
    assert sorted(counted.values()) == sorted([len(found), len(best.lonlat)])


def test_a_season_has_its_colour_of_every_map(tmp_path: Path) -> None:
    path, result = tmp_path / "a.kml", small_run.parts()
    for index, entry in enumerate(result.results):
        write_kml(result.case(entry.name), path)
        opacity, blue, green, red = (
            texts(etree.parse(path), "color")[0][at : at + 2] for at in (0, 2, 4, 6)
        )
        assert f"#{red}{green}{blue}" == season_colour(index)
        assert opacity == "ff"


def test_nothing_is_asked_of_the_network(any_run: RunResult, tmp_path: Path) -> None:
    path = tmp_path / "a.kml"
    root = written(any_run, path)
    assert not texts(root, "href")
    assert not texts(root, "NetworkLink")
