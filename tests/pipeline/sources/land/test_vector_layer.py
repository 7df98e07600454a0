"""Damaged vector files are refused with one line that says what is wrong, where, and the remedy."""

from __future__ import annotations

import http.server
import json
import os
import re
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pytest
import shapely

from pipeline.errors import RequestError
from pipeline.findings.note_words import note_text, note_texts
from pipeline.model import Land
from pipeline.scenario.region import ChartSpec
from pipeline.sources.registry import land_source
from tests.pipeline.sources import mutations

REGION = shapely.box(118.0, 9.0, 120.0, 11.0)
RING = [[118.6, 9.5], [119.4, 9.6], [119.3, 10.4], [118.7, 10.3], [118.6, 9.5]]
AREA = shapely.Polygon(RING).area


def read(path: Path | str, **options: object) -> Land:
    """Read a chart as a run does."""
    chart = ChartSpec.model_validate({"source": {"path": str(path), **options}})
    source = land_source(chart, 1.0)
    assert source.identity
    return source.land(REGION)


def refusal(path: Path | str, **options: object) -> str:
    """Return the only line with which a chart is refused."""
    with pytest.raises(RequestError) as caught:
        read(path, **options)
    (line,) = caught.value.faults
    return line


def geojson(folder: Path, *geometries: object) -> Path:
    """Write a GeoJSON file: a good polygon, then these geometries."""
    features = [
        {"type": "Feature", "properties": {}, "geometry": geometry}
        for geometry in (polygon(RING), *geometries)
    ]
    path = folder / "land.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}), "utf-8")
    return path


def polygon(*rings: object) -> dict[str, Any]:
    """Make a polygon as GeoJSON."""
    return {"type": "Polygon", "coordinates": list(rings)}


def nested(geometry: dict[str, Any], depth: int) -> dict[str, Any]:
    """Put a geometry into collections of collections."""
    for _ in range(depth):
        geometry = {"type": "GeometryCollection", "geometries": [geometry]}
    return geometry


def with_point(*point: object) -> dict[str, Any]:
    """Make a polygon with a point in place of its third."""
    return polygon([*RING[:2], list(point), *RING[3:]])


BAD: dict[str, tuple[object, list[str]]] = {
    "unclosed ring": (
        polygon(RING[:-1]),
        ["do not form a closed linestring", "feature 1, near 118.6, 9.5"],
    ),
    "unclosed hole": (
        polygon(RING, [[118.9, 9.9], [119.1, 9.9], [119.0, 10.1]]),
        ["do not form a closed linestring", "feature 1"],
    ),
    "ring of one point": (polygon(RING[:1]), ["can't be built", "feature 1, near 118.6, 9.5"]),
    "text as coordinates": (with_point("a", "b"), ["string for '\"b\"'", "in feature 1"]),
    "coordinates that are one text": (
        {"type": "Polygon", "coordinates": "here"},
        ["'\"here\"'", "in feature 1"],
    ),
    "a polygon as a multipolygon": (
        {"type": "MultiPolygon", "coordinates": [RING]},
        ["invalid Point", "in feature 1"],
    ),
    "unknown type": ({"type": "Circle", "coordinates": RING}, ["Unsupported geometry type"]),
    "NaN": (with_point(119.3, float("nan")), ["no finite number", "feature 1, near 118.6, 9.5"]),
    "infinite": (with_point(119.3, float("inf")), ["feature 1 lies in", "9.5 to inf"]),
    "far too large": (with_point(1e300, 10.4), ["impossible in its CRS (WGS 84)", "to 1e+300"]),
    "beyond a pole": (with_point(119.3, 91.0), ["impossible in its CRS", "9.5 to 91", "EPSG:"]),
    "all far too large": (polygon([[1e12, 1e12]] * 4), ["feature 1 lies in 1e+12 to 1e+12"]),
    "a point without a radius": (
        nested({"type": "Point", "coordinates": [119.8, 10.8]}, 4),
        ["1 points near the region", "radius_m"],
    ),
}


@pytest.mark.parametrize("kind", BAD)
def test_damaged_geometries_are_refused(tmp_path: Path, kind: str) -> None:
    geometry, parts = BAD[kind]
    line = refusal(geojson(tmp_path, geometry))
    for part in ("land.geojson", *parts):
        assert part in line
    assert re.search("correct|make polygons", line)


GOOD: dict[str, tuple[object, int]] = {
    "none": (None, 1),
    "an empty collection": ({"type": "GeometryCollection", "geometries": []}, 0),
    "a collection": (nested(polygon(RING), 3), 0),
    "heights": (polygon([[*point, 5.0] for point in RING]), 0),
    "some heights": (polygon([RING[0], [*RING[1], 5.0], *RING[2:]]), 0),
    "four numbers for a point": (polygon([[*point, 5.0, 6.0] for point in RING]), 1),
    "an empty ring": (polygon([]), 0),
}


@pytest.mark.parametrize("kind", GOOD)
def test_odd_but_valid_geometries_are_read(tmp_path: Path, kind: str) -> None:
    geometry, notes = GOOD[kind]
    land = read(geojson(tmp_path, geometry), accuracy_m=5)
    assert shapely.union_all(land.polygons).area == pytest.approx(AREA)
    assert not any(shapely.has_z(one) for one in land.polygons)
    assert len(land.notes) == notes, land.notes


def test_features_without_a_geometry_are_noted(tmp_path: Path) -> None:
    (note,) = read(geojson(tmp_path, None, None), accuracy_m=5).notes
    assert note_text(note) == "land.geojson: 2 features have no geometry, and so no land"


def test_deep_collections_lose_nothing(tmp_path: Path) -> None:
    """A point below four collections is land as well, and so is a line of no length."""
    point = nested({"type": "Point", "coordinates": [119.8, 10.8]}, 4)
    line = {"type": "LineString", "coordinates": [[119.7, 9.2], [119.7, 9.2]]}
    land = shapely.union_all(read(geojson(tmp_path, point, line), radius_m=50).polygons)
    assert land.covers(shapely.MultiPoint([(119.8, 10.8), (119.7, 9.2)]))


@pytest.mark.parametrize(
    ("content", "part"),
    [
        ("", "can't be read"),
        ("{", "can't be read"),
        ('{"type": "FeatureCollection"}', "Missing 'features' member"),
        ('{"type": "FeatureCollection", "features": []}', "no feature with a geometry"),
        ("[" * 5000 + "]" * 5000, "can't be read"),
        ('{"type": "Polygon", "coordinates": [[[' + "9" * 5000, "can't be read"),
    ],
)
def test_files_without_land_are_refused(tmp_path: Path, content: str, part: str) -> None:
    path = tmp_path / "land.geojson"
    path.write_text(content, "utf-8")
    line = refusal(path)
    assert part in line
    assert len(line) < 600


@pytest.mark.parametrize("suffix", [".gpkg", ".shp", ".fgb", ".geojson"])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.5])
def test_truncated_files_are_refused(tmp_path: Path, suffix: str, share: float) -> None:
    file = mutations.make_charts(tmp_path, None)[suffix]
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    assert f"land{suffix}" in refusal(file)


def test_a_file_with_another_formats_name_is_read_by_its_content(tmp_path: Path) -> None:
    file = geojson(tmp_path)
    other = file.rename(tmp_path / "land.json")
    assert shapely.union_all(read(other).polygons).area == pytest.approx(AREA)
    renamed = mutations.make_charts(tmp_path, None)[".gpkg"].rename(tmp_path / "land.shp")
    assert len(read(renamed, radius_m=5).polygons) == 22


def test_an_attribute_table_alone_has_no_layer(tmp_path: Path) -> None:
    path = tmp_path / "land.gpkg"
    pyogrio.raw.write(path, None, field_data=[np.arange(3)], fields=["id"], geometry_type=None)
    assert "has no layer with geometries" in refusal(path)


def test_measured_coordinates_are_read(tmp_path: Path) -> None:
    path = tmp_path / "land.gpkg"
    text = "POLYGON M (({}))".format(", ".join(f"{x} {y} 7" for x, y in RING))
    wkb = [shapely.to_wkb(shapely.from_wkt(text), flavor="iso"), None]
    pyogrio.raw.write(
        path,
        np.array(wkb, dtype=object),
        field_data=[np.arange(2)],
        fields=["id"],
        geometry_type="Measured Polygon",
        crs="EPSG:4326",
    )
    with pytest.warns(UserWarning, match="Measured"):
        pyogrio.read_info(path)
    land = read(path, accuracy_m=5)
    assert shapely.union_all(land.polygons).area == pytest.approx(AREA)
    assert note_texts(land.notes) == ["land.gpkg: 1 feature has no geometry, and so no land"]


# --- what is no file ----------------------------------------------------------------------------


def test_what_would_block_or_never_end_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo.geojson")
    (tmp_path / "link.geojson").symlink_to("fifo.geojson")
    for path in (tmp_path / "fifo.geojson", tmp_path / "link.geojson"):
        assert "is a FIFO, not a file" in refusal(path)
    assert "is a device, not a file" in refusal("/dev/zero")


def test_a_sidecar_file_that_would_block_is_refused(tmp_path: Path) -> None:
    file = mutations.make_charts(tmp_path, None)[".shp"]
    file.with_suffix(".dbf").unlink()
    os.mkfifo(file.with_suffix(".dbf"))
    assert "land.dbf is a FIFO" in refusal(file)


def test_a_folder_without_cells_is_no_chart(tmp_path: Path) -> None:
    (tmp_path / "land.geojson").mkdir()
    assert "holds no S-57 cell" in refusal(tmp_path / "land.geojson")
    # Not the missing draught, which is no fault of a folder without depths.
    chart = ChartSpec.model_validate({"source": {"path": str(tmp_path)}})
    with pytest.raises(RequestError, match="holds no S-57 cell"):
        land_source(chart, None)


def test_files_that_may_not_be_read_are_refused(tmp_path: Path) -> None:
    file = geojson(tmp_path)
    file.chmod(0)
    if os.access(file, os.R_OK):
        pytest.skip("this user may read every file")
    assert "may not be read; allow it, as with `chmod +r`" in refusal(file)


class _Asked(http.server.BaseHTTPRequestHandler):
    """Notes what it is asked for."""

    def do_GET(self) -> None:
        self.server.asked.append(self.path)  # type: ignore[attr-defined]
        self.send_error(404)

    do_HEAD = do_POST = do_GET  # noqa: N815 - names of the base class

    def log_message(self, *_: object) -> None:
        """Say nothing."""


@pytest.mark.gate_share(2)
@pytest.mark.parametrize(
    "content",
    [
        (
            '<OGRVRTDataSource><OGRVRTLayer name="x"><SrcDataSource>/vsicurl/{url}</SrcDataSource>'
            "</OGRVRTLayer></OGRVRTDataSource>"
        ),
        (
            '<OGRVRTDataSource><OGRVRTLayer name="land"><SrcDataSource>{file}</SrcDataSource>'
            "</OGRVRTLayer></OGRVRTDataSource>"
        ),
        "<OGRWFSDataSource><URL>{url}</URL></OGRWFSDataSource>",
        (
            '{{"type": "gdal_streamed_alg", "command_line": "gdal vector pipeline '
            "! read /vsicurl/{url} "
            '! reproject --dst-crs=EPSG:4326"}}'
        ),
    ],
    ids=["VRT of an address", "VRT of a file", "WFS", "GDALG"],
)
def test_a_chart_is_a_file_and_leads_nowhere_else(tmp_path: Path, content: str) -> None:
    other = geojson(tmp_path)
    chart = tmp_path / "chart.geojson"
    with http.server.HTTPServer(("127.0.0.1", 0), _Asked) as server:
        server.asked = []  # type: ignore[attr-defined]
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        url = f"http://127.0.0.1:{server.server_port}/land.geojson"
        chart.write_text(content.format(url=url, file=other))
        said = refusal(chart)
        server.shutdown()
        thread.join()
        assert not server.asked  # type: ignore[attr-defined]
    assert "not recognized as being in a supported file format" in said


def test_a_chart_whose_bytes_cannot_be_read() -> None:
    said = refusal("/proc/self/mem")
    assert "Input/output error" in said
    assert "export it again" in said
