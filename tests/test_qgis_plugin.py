"""The plugin in QGIS itself, without a window: its tools plan, show layers, refuse and cancel."""

import json
import os
import shutil
import sys
import time
import tomllib
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import geopandas
import gpxpy.gpx
import numpy as np
import pandas as pd
import pyproj
import pytest
import shapely

from pipeline.scenario.catalogue import names
from pipeline.sources.current_field import Field
from tests.bench.figure import recorded
from tests.commands import ended, ran
from tests.conftest import ROOT
from tests.pipeline.sources.cf.grib_files import write_grib
from tests.pipeline.synthetic_currents import dataset, sea
from tests.true_scale import GEOD

pytestmark = pytest.mark.slow

RENEW = Path(sys.executable).with_name("renew")
# Debian's own `qgis_process` gives its program an option that this does not know.
QGIS = shutil.which("qgis_process.bin") or shutil.which("qgis_process")
# Calls `renew run` as an algorithm does, and cancels after a while.
_CANCEL = """
import sys, threading, time
sys.path[:0] = ["/usr/share/qgis/python/plugins", sys.argv[1]]
from qgis.core import QgsApplication, QgsProcessingException, QgsProcessingFeedback
application = QgsApplication([], False)
application.initQgis()
from renew_routes import program
feedback = QgsProcessingFeedback()
threading.Timer(float(sys.argv[3]), feedback.cancel).start()
begun = time.monotonic()
try:
    program.run(["run", "palawan-usv", "--offline", "--output", sys.argv[2]], feedback)
except QgsProcessingException as error:
    print(error, time.monotonic() - begun, flush=True)
import os
os._exit(0)  # QGIS's own end is not ours to test
"""
# Runs an algorithm as QGIS's window does, and lists the layer tree from the top down.
_SHOW = """
import json, os, sys
sys.path[:0] = ["/usr/share/qgis/python/plugins", sys.argv[1]]
from qgis.core import QgsApplication, QgsProcessingContext, QgsProcessingFeedback, QgsProject
application = QgsApplication([], True)
application.initQgis()
from processing.core.Processing import Processing
Processing.initialize()
from processing.gui.Postprocessing import handleAlgorithmResults
from renew_routes.provider import Provider
provider, registry = Provider(), QgsApplication.processingRegistry()
registry.addProvider(provider)
project, context, feedback = QgsProject.instance(), QgsProcessingContext(), QgsProcessingFeedback()
context.setProject(project)
algorithm = registry.createAlgorithmById("renew:scenario")
algorithm.run({"SCENARIO": "single-gyre", "OUTPUT": sys.argv[2]}, context, feedback)
handleAlgorithmResults(algorithm, context, feedback)
for _ in range(20):
    application.processEvents()
tree = [node.layer() for node in project.layerTreeRoot().findLayers()]
print(json.dumps([[layer.name(), layer.renderer().type()] for layer in tree]), flush=True)
os._exit(0)
"""


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Install the plugin into a profile of its own; give the variables of QGIS's process."""
    if QGIS is None:
        pytest.skip("QGIS is not installed (Debian: qgis)")
    folder = tmp_path_factory.mktemp("home")
    variables = {
        **{name: text for name, text in os.environ.items() if name != "PYTHONPATH"},
        "QT_QPA_PLATFORM": "offscreen",
        "XDG_RUNTIME_DIR": str(folder),
        "QGIS_CUSTOM_CONFIG_PATH": str(folder),
    }
    ran(RENEW, "qgis", "install", env=variables)
    enable = [QGIS, "plugins", "enable", "renew_routes"]
    ran(*enable, env=variables)
    return variables


def planned(home: dict[str, str], algorithm: str, **values: object) -> dict[str, Any]:
    """Run an algorithm; return its results, or its error under "error"."""
    given = [f"{name}={value}" for name, value in values.items()]
    command = [str(QGIS), "--json", "run", f"renew:{algorithm}", "--", *given]
    done = ended(*command, env=home)
    if done.returncode:
        return {"error": done.stderr}
    results: dict[str, Any] = json.loads(done.stdout)["results"]
    return results


def test_the_dialog_has_lists_and_file_buttons(home: dict[str, str]) -> None:
    """Months and members stand with the usual ones, the rest under the advanced ones."""
    told = json.loads(ran(str(QGIS), "--json", "help", "renew:route", env=home))["parameters"]
    kinds = {name: one["type"]["id"] for name, one in told.items()}
    expected = {"VESSEL": "enum", "VESSEL_FILE": "file", "CURRENTS": "file", "DEPTHS": "file"}
    expected |= {"SHUT": "source", "LAND": "source", "DEPART": "datetime", "START": "point"}
    assert {name: kinds[name] for name in expected} == expected
    assert set(told["VESSEL"]["available_options"].values()) == set(names("vessels"))
    usual = {name for name, one in told.items() if not one["is_advanced"]}
    assert {"MONTH", "MEMBERS", "CURRENTS", "VESSEL"} <= usual
    assert "EXPLAIN_GAP" not in usual
    checks = json.loads(ran(str(QGIS), "--json", "help", "renew:check", env=home))["parameters"]
    assert {"FILE", "LINE", "DEPART"} <= set(checks)
    assert not {"START", "GOAL", "VIA", "UNTIL", "HAVENS"} & set(checks)


def test_a_scenario_is_planned_as_on_the_command_line(home: dict[str, str], tmp_path: Path) -> None:
    found = planned(home, "scenario", SCENARIO="single-gyre", OUTPUT=tmp_path)
    assert found["FUEL"] == pytest.approx(recorded("gyre")["fuel"], rel=1e-4)
    assert Path(found["REPORT"]).is_file()
    assert len(geopandas.read_file(found["GEOPACKAGE"], layer="routes"))


def test_points_and_layers_in_another_crs_are_a_voyage(
    home: dict[str, str], tmp_path: Path
) -> None:
    """From points of a web map, around an area that lies on the straight way."""
    shut = shapely.box(120.02, 9.95, 120.06, 10.0)
    layer = geopandas.GeoDataFrame(geometry=[shut], crs=4326).to_crs(32651)
    layer.to_file(tmp_path / "shut.gpkg")
    to_web = pyproj.Transformer.from_crs(4326, 3857, always_xy=True)
    ends = {"START": (119.95, 9.98), "GOAL": (120.15, 9.97)}
    points = {
        name: "{},{} [EPSG:3857]".format(*to_web.transform(*place)) for name, place in ends.items()
    }
    water = {"CURRENTS": "still", "SHUT": tmp_path / "shut.gpkg"}
    found = planned(home, "route", **points, **water, OUTPUT=tmp_path / "results")
    assert "error" not in found, found
    line = geopandas.read_file(found["GEOPACKAGE"], layer="routes").geometry.iloc[0]
    line = shapely.line_merge(line)
    for place, end in zip(ends.values(), (line.coords[0], line.coords[-1]), strict=True):
        assert end[:2] == pytest.approx(place, abs=1e-4)
    assert not line.intersects(shut.buffer(-1e-4))


def test_ways_to_havens_of_a_layer_are_planned(home: dict[str, str], tmp_path: Path) -> None:
    havens = geopandas.GeoDataFrame(
        {"name": ["north"]}, geometry=geopandas.points_from_xy([120.04], [9.98]), crs=4326
    )
    havens.to_crs(32651).to_file(tmp_path / "havens.gpkg")
    found = planned(
        home,
        "route",
        START="119.95,9.98",
        GOAL="120.15,9.97",
        CURRENTS="still",
        HAVENS=tmp_path / "havens.gpkg",
        WITHIN="3h",
        OUTPUT=tmp_path / "results",
    )
    assert "error" not in found, found
    known = geopandas.read_file(found["GEOPACKAGE"], layer="havens")
    assert known["name"].tolist() == ["north"]
    assert len(geopandas.read_file(found["GEOPACKAGE"], layer="diversions"))


def test_the_best_departure_is_chosen_around_land_of_the_users_own(
    home: dict[str, str], tmp_path: Path
) -> None:
    """In a GRIB file of currents that change, as a sailor has it."""
    axes = np.arange(117.0, 123.1, 0.25), np.arange(7.0, 13.1, 0.25)
    still = sea(*axes)
    hours = [Field(*axes, share * still.u, share * still.v) for share in np.linspace(1.0, -1.0, 12)]
    times = pd.date_range("2026-07-01T05:00", periods=12, freq="h")
    currents = write_grib(tmp_path / "hours.grb", dataset(*hours, times=times))
    land = shapely.box(120.04, 9.93, 120.06, 10.0)
    geopandas.GeoDataFrame(geometry=[land], crs=4326).to_crs(32651).to_file(tmp_path / "land.gpkg")
    voyage = {"START": "119.95,9.98", "GOAL": "120.15,9.97", "LAND": tmp_path / "land.gpkg"}
    window = {"DEPART": "2026-07-01T06:00:00", "UNTIL": "2026-07-01T08:00:00"}
    found = planned(home, "leave", **voyage, **window, CURRENTS=currents, OUTPUT=tmp_path / "out")
    assert "error" not in found, found
    assert "2026-07-01T06:00" <= found["DEPARTURE"] <= "2026-07-01T08:00:59"
    lines = geopandas.read_file(found["GEOPACKAGE"], layer="routes").geometry
    assert not lines.intersects(land.buffer(-1e-5)).any()
    departures = pd.read_csv(Path(found["OUTPUT"]) / "departures.csv")
    assert len(departures) > 1
    assert departures.fuel.min() == pytest.approx(found["FUEL"], rel=1e-3)


def test_a_route_of_a_file_is_checked(home: dict[str, str], tmp_path: Path) -> None:
    """With a vessel of the user's own; it leaves when the file says."""
    left = datetime(2026, 7, 1, 6, tzinfo=UTC)
    places = [(9.98, 119.95), (9.99, 120.05), (9.97, 120.15)]
    route = gpxpy.gpx.GPXRoute(name="mine")
    route.points = [gpxpy.gpx.GPXRoutePoint(*place, name=f"P{place[1]:g}") for place in places]
    route.points[0].time = left
    gpx = gpxpy.gpx.GPX()
    gpx.routes.append(route)
    (tmp_path / "mine.gpx").write_text(gpx.to_xml())
    (tmp_path / "mine.toml").write_text((ROOT / "catalog/vessels/blueboat.toml").read_text())
    given = {"FILE": tmp_path / "mine.gpx", "VESSEL_FILE": tmp_path / "mine.toml"}
    found = planned(home, "check", **given, CURRENTS="still", OUTPUT=tmp_path / "out")
    assert "error" not in found, found
    rows = geopandas.read_file(found["PLACES"])
    points = rows[rows.what == "point"]
    assert points["name"].tolist() == ["P119.95", "P120.05", "P120.15"]
    at = np.array(places)
    length = GEOD.line_length(at[:, 1], at[:, 0])
    assert found["LENGTH_M"] == pytest.approx(length, rel=1e-5)
    speed = tomllib.loads((tmp_path / "mine.toml").read_text())["speed_m_s"]
    assert found["DURATION_S"] == pytest.approx(length / speed, rel=1e-5)
    passed = pd.to_datetime(points.passed, utc=True)
    assert passed.iloc[0] == pd.to_datetime(points.stated, utc=True).iloc[0] == left
    took = (passed.iloc[-1] - left).total_seconds()
    assert took == pytest.approx(found["DURATION_S"], abs=1.0)
    assert "least-fuel route" in found["SAID"]


def test_a_line_of_a_layer_in_another_crs_is_checked(home: dict[str, str], tmp_path: Path) -> None:
    """Across land of the user's own, where it is told and marked."""
    land = shapely.box(120.04, 9.93, 120.06, 10.0)
    line = shapely.LineString([(119.95, 9.97), (120.15, 9.97)])
    for name, shape in (("land", land), ("line", line)):
        layer = geopandas.GeoDataFrame(geometry=[shape], crs=4326)
        layer.to_crs(32651).to_file(tmp_path / f"{name}.gpkg")
    given = {"LINE": tmp_path / "line.gpkg", "LAND": tmp_path / "land.gpkg"}
    found = planned(
        home, "check", **given, VESSEL="usv-7m", CURRENTS="still", OUTPUT=tmp_path / "out"
    )
    assert "OVER LAND: 2.19 km" in found["SAID"]
    rows = geopandas.read_file(found["PLACES"]).set_index("what")
    across = GEOD.geometry_length(line.intersection(land))
    assert rows.loc["crosses", "length_m"] == pytest.approx(across, rel=1e-4)
    assert rows.loc["crosses", "geometry"].coords[0] == pytest.approx((120.05, 9.97), abs=1e-4)
    turns = rows.loc[["a turn meets land"]].geometry
    assert 1 < len(turns) < 100
    assert turns.within(land.buffer(0.01)).all()
    assert (
        "Give a route" in planned(home, "check", CURRENTS="still", OUTPUT=tmp_path / "out")["error"]
    )


def test_what_the_program_refuses_is_the_algorithms_error(
    home: dict[str, str], tmp_path: Path
) -> None:
    found = planned(home, "scenario", SCENARIO="no-such-thing", OUTPUT=tmp_path)
    assert "no-such-thing" in found["error"]
    voyage = {"START": "119.95,9.98", "GOAL": "120.15,9.97", "CURRENTS": "still"}
    times = {"DEPART": "2026-07-02T06:00:00", "UNTIL": "2026-07-01T06:00:00"}
    found = planned(home, "leave", **voyage, **times, OUTPUT=tmp_path)
    assert "--until" in found["error"]


def scripted(home: dict[str, str], script: str, *arguments: str) -> str:
    """Run a script with QGIS's Python, which has the plugin; return what it prints."""
    plugins = Path(home["QGIS_CUSTOM_CONFIG_PATH"]) / "profiles" / "default" / "python" / "plugins"
    command = ["/usr/bin/python3", "-c", script, str(plugins), *arguments]
    return ran(*command, env=home)


def test_layers_have_their_styles_titles_and_order(home: dict[str, str], tmp_path: Path) -> None:
    tree = json.loads(scripted(home, _SHOW, str(tmp_path / "out")).splitlines()[-1])
    shown = ["Waypoints", "Routes", "Currents", "Land", "Soft no-go zones"]
    assert [name for name, _ in tree] == [name for name in shown if [name, "RuleRenderer"] in tree]
    assert {"Routes", "Currents"} <= {name for name, _ in tree}


def test_a_cancelled_plan_ends(home: dict[str, str], tmp_path: Path) -> None:
    said = scripted(home, _CANCEL, str(tmp_path / "out"), "3")
    assert "Cancelled" in said
    assert 3.0 <= float(said.split()[-1]) < 30.0
    time.sleep(1.0)
    listed = ran("/bin/ps", "-eo", "args")
    assert str(tmp_path / "out") not in listed
