"""QGIS itself, without a window: it opens the project inside the file, and the plain layers."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyogrio
import pytest
from matplotlib.image import imread

from pipeline.findings.result import RunResult
from pipeline.formats.appearance import COLOURS, season_colour
from pipeline.formats.gis.geopackage import PROJECT, write_geopackage
from pipeline.formats.passage.waypoints import case_waypoints
from pipeline.stages.places import unsimplified
from tests.commands import ran
from tests.pipeline.formats.gis.cases import badly_named, moved_east

pytestmark = pytest.mark.slow

# Opens FILE's project and its layers, draws both into FOLDER, and prints what it found.
_QGIS = """
import json, os, sys
from qgis.core import (
    QgsApplication, QgsCoordinateReferenceSystem, QgsExpression, QgsExpressionContext,
    QgsExpressionContextUtils,
    QgsDateTimeRange, QgsFeatureRequest, QgsMapRendererParallelJob,
    QgsMapSettings, QgsProject, QgsRectangle, QgsVectorLayer, QgsVectorLayerTemporalContext,
)
from qgis.PyQt.QtCore import QSize
from qgis.PyQt.QtGui import QColor

file, project_name, folder, layers = sys.argv[1], sys.argv[2], sys.argv[3], sys.argv[4].split(",")
application = QgsApplication([], True)
application.initQgis()
messages = []
QgsApplication.messageLog().messageReceived.connect(lambda text, tag, level: messages.append(text))
project = QgsProject.instance()
read = project.read(f"geopackage:{file}?projectName={project_name}")


def draw(shown, crs, extent, name, background):
    settings = QgsMapSettings()
    settings.setLayers(shown)
    settings.setDestinationCrs(crs)
    settings.setExtent(extent)
    settings.setOutputSize(QSize(900, 700))
    settings.setBackgroundColor(background)
    context = project.createExpressionContext()
    context.appendScope(QgsExpressionContextUtils.mapSettingsScope(settings))
    settings.setExpressionContext(context)
    job = QgsMapRendererParallelJob(settings)
    job.start()
    job.waitForFinished()
    job.renderedImage().save(f"{folder}/{name}.png")
    return [error.message for error in job.errors()]


def leaf_conditions(rule, above=()):
    conditions = above + ((rule.filterExpression(),) if rule.filterExpression() else ())
    if not rule.children():
        return [" AND ".join(f"({c})" for c in conditions) or "true"]
    return [leaf for child in rule.children() for leaf in leaf_conditions(child, conditions)]


def drawn_by_rules(layer):
    conditions = leaf_conditions(layer.renderer().rootRule())
    assert not any(QgsExpression(c).hasParserError() for c in conditions)
    return [
        sum(1 for _ in layer.getFeatures(QgsFeatureRequest().setFilterExpression(condition)))
        for condition in conditions
    ]


def texts(layer):
    feature, found = next(layer.getFeatures()), {}
    for i, field in enumerate(layer.fields()):
        setup = layer.editorWidgetSetup(i)
        formatter = QgsApplication.fieldFormatterRegistry().fieldFormatter(setup.type())
        found[field.name()] = formatter.representValue(
            layer, i, setup.config(), None, feature[i]
        )
    return found


def display(layer):
    context = QgsExpressionContext(
        QgsExpressionContextUtils.globalProjectLayerScopes(layer)
    )
    context.setFeature(next(layer.getFeatures()))
    return QgsExpression(layer.displayExpression()).evaluate(context)


def there_at(layer, moment):
    context = QgsVectorLayerTemporalContext()
    context.setLayer(layer)
    span = QgsDateTimeRange(moment, moment.addSecs(1))
    condition = layer.temporalProperties().createFilterString(context, span)
    request = QgsFeatureRequest().setFilterExpression(condition)
    return sum(1 for _ in layer.getFeatures(request))


times = project.timeSettings().temporalRange()
moments = [times.begin().addSecs(hour * 3600) for hour in range(-1, 80)]
tree = project.layerTreeRoot()
visible = [layer for layer in tree.layerOrder() if tree.findLayer(layer.id()).isVisible()]
extent = QgsRectangle(project.viewSettings().defaultViewExtent())
found = {
    "read": read,
    "title": project.title(),
    "plane": project.crs().isValid() and not project.crs().isGeographic(),
    "crs": [project.crs().authid(), project.crs().description()],
    "visible": [layer.id() for layer in visible],
    "groups": [group.name() for group in tree.findGroups()],
    "themes": project.mapThemeCollection().mapThemes(),
    "layers": {
        layer.id(): {
            "valid": layer.isValid() and layer.crs().authid() == "EPSG:4326",
            "count": layer.featureCount(),
            "html": layer.htmlMetadata(),
        }
        for layer in project.mapLayers().values()
    },
    "times": [time.toSecsSinceEpoch() for time in (times.begin(), times.end())],
    "there": {
        layer.id(): [there_at(layer, moment) for moment in moments]
        for layer in project.mapLayers().values()
        if layer.temporalProperties().isActive()
    },
    "errors": draw(visible, project.crs(), extent, "project", project.backgroundColor()),
}
plain, found["plain"] = [], {}
whole = QgsRectangle()
for name in layers:
    layer = QgsVectorLayer(f"{file}|layername={name}", name, "ogr")
    message, styled = layer.loadDefaultStyle()
    found["plain"][name] = {
        "styled": styled,
        "renderer": layer.renderer().type(),
        "columns": [field.name() for field in layer.fields()],
        "texts": texts(layer),
        "display": display(layer),
        "aliases": [layer.attributeDisplayName(i) for i in range(layer.fields().count())],
        "by_rules": drawn_by_rules(layer),
        "count": layer.featureCount(),
    }
    plain.append(layer)
    if name == "channels":
        whole = layer.extent()
lonlat = QgsCoordinateReferenceSystem("EPSG:4326")
found["errors"] += draw(plain, lonlat, whole.buffered(whole.width() / 20), "plain", QColor("white"))
found["messages"] = messages
print(json.dumps(found), flush=True)
os._exit(0)  # QGIS's own end is not ours to test
"""


DEPARTURE = datetime(2026, 7, 1, 6, tzinfo=UTC)


@pytest.fixture(scope="session")
def departing(result: RunResult) -> RunResult:
    """The small run, as if it had a departure."""
    seasons = [one.model_copy(update={"departure": DEPARTURE}) for one in result.scenario.seasons]
    scenario = result.scenario.model_copy(update={"seasons": tuple(seasons)})
    return replace(result, scenario=scenario)


def environment(home: Path) -> dict[str, str]:
    return {
        "PATH": "/usr/bin:/bin",
        "QT_QPA_PLATFORM": "offscreen",
        "LC_ALL": "C.UTF-8",
        "HOME": str(home),
        "XDG_RUNTIME_DIR": str(home),
    }


@pytest.fixture(scope="session")
def qgis_python(tmp_path_factory: pytest.TempPathFactory) -> str:
    home = tmp_path_factory.mktemp("home")
    for python in (sys.executable, shutil.which("python3", path="/usr/bin")):
        probe = [str(python), "-c", "import qgis.core"]
        if (
            python
            and not subprocess.run(
                probe, env=environment(home), capture_output=True, check=False
            ).returncode
        ):
            return python
    pytest.skip("QGIS's Python is not installed (Debian: python3-qgis)")


def opened(python: str, file: Path, folder: Path) -> dict[str, Any]:
    folder.mkdir()
    done = ran(
        python,
        "-c",
        _QGIS,
        str(file),
        PROJECT,
        str(folder),
        ",".join(name for name, shape in pyogrio.list_layers(file) if shape is not None),
        env=environment(folder),
        timeout=120,
    )
    found: dict[str, Any] = json.loads(done)
    return found


def picture(path: Path) -> npt.NDArray[np.int64]:
    return (imread(path)[..., :3] * 255).round().astype(int)


def count(pixels: npt.NDArray[np.int64], hexadecimal: str, tolerance: int = 3) -> int:
    """Number of pixels of a colour."""
    colour = np.array(list(bytes.fromhex(hexadecimal.removeprefix("#"))))
    return int((abs(pixels - colour).max(axis=-1) <= tolerance).sum())


def blended(upper: str, lower: str, opacity: float) -> str:
    pairs = zip(bytes.fromhex(upper[1:]), bytes.fromhex(lower[1:]), strict=True)
    return "#" + bytes(round(opacity * a + (1 - opacity) * b) for a, b in pairs).hex()


def test_the_project_opens_as_a_finished_map(
    qgis_python: str, result: RunResult, tmp_path: Path
) -> None:
    """In another folder than it was written in: a run's files are moved to their destination."""
    (tmp_path / "staging").mkdir()
    write_geopackage(result, tmp_path / "staging" / "routes.gpkg")
    (tmp_path / "staging").rename(tmp_path / "results")
    found = opened(qgis_python, tmp_path / "results" / "routes.gpkg", tmp_path / "pictures")
    assert found["read"]
    assert found["plane"]
    assert found["crs"] == ["EPSG:32650", "WGS 84 / UTM zone 50N"]
    assert found["title"] == "Two islands"
    assert found["errors"] == []
    assert found["messages"] == []
    assert sorted(found["groups"]) == sorted(found["themes"]) == ["Summer", "Winter (December)"]
    assert len(found["layers"]) == 20
    assert all(layer["valid"] for layer in found["layers"].values())
    counts = [v["count"] for k, v in found["layers"].items() if k.startswith("routes")]
    assert sorted(counts) == sorted(len(result.case(s).routes) for s in ("summer", "winter"))
    pixels = picture(tmp_path / "pictures" / "project.png")
    total = pixels.shape[0] * pixels.shape[1]
    assert 0.3 < count(pixels, COLOURS["water"]) / total < 0.9
    assert 0.02 < count(pixels, COLOURS["land"]) / total < 0.3
    soft = blended(COLOURS["soft"], COLOURS["water"], 0.38)
    assert 0.005 < count(pixels, soft) / total < 0.4
    # Both seasons' best routes, and arrows of more than one class.
    for line in (season_colour(0), season_colour(1)):
        assert 0.0005 < count(pixels, line) / total < 0.05
    assert sum(count(pixels, COLOURS[f"speed{i}"]) > 50 for i in range(5)) >= 2


def test_plain_layers_are_styled_named_and_drawn(
    qgis_python: str, package: Path, tmp_path: Path
) -> None:
    found = opened(qgis_python, package, tmp_path / "pictures")
    for name, layer in found["plain"].items():
        assert layer["styled"], name
        assert layer["renderer"] == "RuleRenderer"
        # No column is shown by its raw name, and each feature is drawn by one rule.
        assert not set(layer["columns"]) & set(layer["aliases"])
        assert sum(layer["by_rules"]) == layer["count"]
        assert layer["count"] > 0
    assert found["errors"] == []
    pixels = picture(tmp_path / "pictures" / "plain.png")
    for colour in (COLOURS["land"], season_colour(0)):
        assert count(pixels, colour) > 300


def test_values_are_formatted_and_features_named(
    qgis_python: str, departing: RunResult, tmp_path: Path
) -> None:
    write_geopackage(departing, tmp_path / "routes.gpkg")
    plain = opened(qgis_python, tmp_path / "routes.gpkg", tmp_path / "pictures")["plain"]
    best = departing.routes[0].metrics
    shown = plain["routes"]["texts"]
    assert shown["length_m"] == f"{best.length_m:,.1f}"
    assert shown["optimality_gap"] == f"{best.optimality_gap:.3f}"
    assert shown["departure"] == "2026-07-01 06:00"
    assert plain["passage"]["texts"]["passed_at"] == "2026-07-01 06:00"
    assert plain["routes"]["display"] == f"1: {best.way}"
    assert "m/s towards" in plain["currents"]["display"]


def test_time_goes_on_where_there_is_a_departure(
    qgis_python: str, departing: RunResult, tmp_path: Path
) -> None:
    """A route is there while it is sailed, and a waypoint from when it is passed."""
    write_geopackage(departing, tmp_path / "routes.gpkg")
    found = opened(qgis_python, tmp_path / "routes.gpkg", tmp_path / "pictures")
    took = [one.metrics.duration_s for one in departing.routes]
    assert found["times"][0] == DEPARTURE.timestamp()
    assert found["times"][1] - found["times"][0] == pytest.approx(max(took), abs=1.0)
    for number, name in enumerate(("summer", "winter"), start=1):
        case = departing.case(name)
        ends = np.array([one.metrics.duration_s for one in case.routes])
        passed = np.concatenate([points.time_s for points in case_waypoints(case)])
        there = (found["there"][f"{layer}_season_{number}"] for layer in ("routes", "passage"))
        for hour, (routes, points) in enumerate(zip(*there, strict=True), -1):
            assert routes == (0 if hour < 0 else (ends >= 3600 * hour).sum())
            assert points == (passed <= 3600 * hour + 0.5).sum()


def test_bad_names_are_drawn_like_any_other(
    qgis_python: str, result: RunResult, tmp_path: Path
) -> None:
    write_geopackage(badly_named(result), tmp_path / "routes.gpkg")
    found = opened(qgis_python, tmp_path / "routes.gpkg", tmp_path / "pictures")
    assert found["read"]
    assert found["errors"] == []
    assert all(layer["valid"] for layer in found["layers"].values())
    for layer in found["layers"].values():
        assert "<script" not in layer["html"]
    expected = [len(r) for r in (result.case("summer").routes, result.case("winter").routes)]
    drawn = found["plain"]["routes"]["by_rules"]  # best and others, of one season and the other
    assert drawn == [1, expected[0] - 1, 1, expected[1] - 1]
    counts = [v["count"] for k, v in found["layers"].items() if k.startswith("routes")]
    assert sorted(counts) == sorted(expected)
    assert len(found["groups"]) == 2


def test_across_180_degrees_all_of_the_map_is_there(
    qgis_python: str, result: RunResult, package: Path, tmp_path: Path
) -> None:
    """The fixtures' run, moved 60.4 degrees east, where its land lies on both sides of 180.

    It is near the equator, where plane and degrees look nearly the same.
    """
    write_geopackage(moved_east(result, 60.4), tmp_path / "routes.gpkg")
    opened(qgis_python, package, tmp_path / "here")
    opened(qgis_python, tmp_path / "routes.gpkg", tmp_path / "there")
    here, there = (picture(tmp_path / place / "project.png") for place in ("here", "there"))
    for colour in (COLOURS["land"], COLOURS["water"], season_colour(0)):
        assert count(there, colour) == pytest.approx(count(here, colour), rel=0.06)


def test_a_plane_in_metres_opens_too(
    qgis_python: str, planar_result: RunResult, tmp_path: Path
) -> None:
    # As in the pipeline for a planar scenario; the fixture's no-go zone is wider than its land.
    exact = replace(planar_result, simplified=unsimplified(planar_result.fetched.land))
    write_geopackage(exact, tmp_path / "routes.gpkg")
    found = opened(qgis_python, tmp_path / "routes.gpkg", tmp_path / "pictures")
    assert found["read"]
    assert found["plane"]
    pixels = picture(tmp_path / "pictures" / "project.png")
    # An obstacle of 20 m in a plane of 100 m, which is shown whole with a margin.
    assert 0.01 < count(pixels, COLOURS["land"]) / pixels[..., 0].size < 0.06
