"""The algorithms: their parameters, the command line of each, and the layers that they give."""

import csv
import shlex
import sqlite3
from functools import partial
from pathlib import Path
from typing import ClassVar

import processing
from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsProcessing,
    QgsProcessingAlgorithm,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingLayerPostProcessorInterface,
    QgsProcessingOutputFile,
    QgsProcessingOutputNumber,
    QgsProcessingOutputString,
    QgsProcessingParameterDateTime,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterFeatureSource,
    QgsProcessingParameterFile,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterPoint,
    QgsProcessingParameterString,
    QgsProcessingUtils,
)
from qgis.PyQt.QtCore import QTimer

from .program import run

_DEGREES = "EPSG:4326"
# Property of a layer: its package, and its rank among those shown.
_RANK = "renew/rank"
# Layers of routes.gpkg that are shown, from the lowest up.
_SHOWN = (
    *("soft_no_go", "coast", "currents", "diversions", "coverage", "routes", "passage"),
    "havens",
)
# Names and titles of the layers of a GeoPackage that have features.
_FILLED = (
    "SELECT table_name, identifier FROM gpkg_contents JOIN gpkg_ogr_contents USING (table_name) "
    "WHERE feature_count > 0"
)


class _Styled(QgsProcessingLayerPostProcessorInterface):
    """Gives a layer its style in the GeoPackage, which Processing replaces, its title and place."""

    # QGIS holds no reference to these objects.
    kept: ClassVar[list["_Styled"]] = []

    def __init__(self, package, title, rank):
        """Keep what the layer is to have; `rank` counts from the lowest layer up."""
        super().__init__()
        self.package, self.title, self.rank = package, title, rank
        self.kept.append(self)

    def postProcessLayer(self, layer, context, feedback):
        """Style a layer; QGIS calls it before the layer is in the tree."""
        del feedback
        layer.loadDefaultStyle()
        layer.setName(self.title)
        layer.setCustomProperty(_RANK, [self.package, self.rank])
        QTimer.singleShot(0, partial(_order, context.project(), self.package))


def _order(project, package):
    """Move the layers of a package to the top of the layer tree, in the order of their ranks."""
    ranked = []
    for node in project.layerTreeRoot().findLayers():
        found = node.layer().customProperty(_RANK) if node.layer() else None
        if found and found[0] == package:
            ranked.append((int(found[1]), node))
    for _, node in sorted(ranked, key=lambda one: one[0]):
        parent = node.parent()
        parent.insertChildNode(0, node.clone())
        parent.removeChildNode(node)


class _Algorithm(QgsProcessingAlgorithm):
    """What the algorithms share: the folder of results, and what is shown of them."""

    NAME, TITLE, HELP = "", "", ""

    def createInstance(self):
        """Return a new one, as QGIS asks before each run."""
        return type(self)()

    def name(self):
        """Return the name behind `renew:`."""
        return self.NAME

    def displayName(self):
        """Return the name in the toolbox."""
        return self.TITLE

    def shortHelpString(self):
        """Return the text beside the parameters."""
        return self.HELP

    def initAlgorithm(self, configuration=None):
        """Declare parameters and outputs."""
        del configuration
        for parameter in self.inputs():
            self.addParameter(parameter)
        more = QgsProcessingParameterString("MORE", "More options of the command", optional=True)
        more.setFlags(more.flags() | QgsProcessingParameterDefinition.FlagAdvanced)
        self.addParameter(more)
        self.addParameter(QgsProcessingParameterFolderDestination("OUTPUT", "Folder of results"))
        self.addOutput(QgsProcessingOutputFile("GEOPACKAGE", "Routes and all other layers"))
        self.addOutput(QgsProcessingOutputFile("REPORT", "Report"))
        self.addOutput(QgsProcessingOutputNumber("FUEL", "Fuel of the best route"))
        self.addOutput(QgsProcessingOutputNumber("LENGTH_M", "Length of the best route, m"))
        self.addOutput(QgsProcessingOutputString("DEPARTURE", "Departure, where there is one"))

    def inputs(self):
        """Return the parameters of the algorithm."""
        raise NotImplementedError

    def command(self, parameters, context, feedback):
        """Return the command line for some values of the parameters."""
        raise NotImplementedError

    def processAlgorithm(self, parameters, context, feedback):
        """Plan, and show the layers."""
        output = Path(self.parameterAsString(parameters, "OUTPUT", context))
        output.mkdir(parents=True, exist_ok=True)
        more = shlex.split(self.parameterAsString(parameters, "MORE", context))
        command = [*self.command(parameters, context, feedback), "--output", str(output), *more]
        answer = run(command, feedback)
        folder = Path(answer["directory"])
        package = folder / "routes.gpkg"
        self._show(package, context)
        best = min(answer["routes"], key=lambda one: (one["rank"], one["fuel"]), default={})
        feedback.pushInfo(f"Report: {folder / 'report.html'}")
        return {
            "OUTPUT": str(folder),
            "GEOPACKAGE": str(package),
            "REPORT": str(folder / "report.html"),
            "FUEL": best.get("fuel"),
            "LENGTH_M": best.get("length_m"),
            "DEPARTURE": best.get("departure") or "",
        }

    def _show(self, package, context):
        """Load layers into the project when the algorithm has ended; they bring their styles."""
        if context.project() is None:
            return
        with sqlite3.connect(f"{package.as_uri()}?mode=ro", uri=True) as base:
            titles = dict(base.execute(_FILLED).fetchall())
        for name in _SHOWN:
            if name in titles:
                details = QgsProcessingContext.LayerDetails(titles[name], context.project())
                styled = _Styled(str(package), titles[name], _SHOWN.index(name))
                details.setPostProcessor(styled)
                context.addLayerToLoadOnCompletion(f"{package}|layername={name}", details)

    def in_degrees(self, parameters, name, context, feedback):
        """Write a layer to a file in degrees; return its path, "" without a layer."""
        if not parameters.get(name):
            return ""
        file = QgsProcessingUtils.generateTempFilename(f"{name.lower()}.gpkg")
        done = processing.run(
            "native:reprojectlayer",
            {"INPUT": parameters[name], "TARGET_CRS": _DEGREES, "OUTPUT": file},
            context=context,
            feedback=feedback,
            is_child_algorithm=True,
        )
        return done["OUTPUT"]


class _Voyage(_Algorithm):
    """A voyage between two points, by `renew go`."""

    def inputs(self):
        """Points, vessel, time, currents, land, shut areas, depths, havens."""
        polygons, points = [QgsProcessing.TypeVectorPolygon], [QgsProcessing.TypeVectorPoint]
        return [
            QgsProcessingParameterPoint("START", "Start"),
            QgsProcessingParameterPoint("GOAL", "Goal"),
            QgsProcessingParameterString(
                "VESSEL", "Vessel: one of the catalogue, or a TOML file", defaultValue="usv-7m"
            ),
            *self.times(),
            QgsProcessingParameterString(
                "CURRENTS",
                "Currents: a file, a pattern of files or a source's name (empty: chosen)",
                optional=True,
            ),
            QgsProcessingParameterFeatureSource(
                "LAND", "Land (empty: the world's)", polygons, optional=True
            ),
            QgsProcessingParameterFeatureSource("SHUT", "Shut areas", polygons, optional=True),
            QgsProcessingParameterFile("DEPTHS", "Grid of depths", optional=True),
            QgsProcessingParameterString("DRAUGHT", "Draught, such as 1.2m", optional=True),
            QgsProcessingParameterFeatureSource(
                "HAVENS", "Havens, by their column `name`", points, optional=True
            ),
            QgsProcessingParameterString("WITHIN", "A haven within, such as 6h", optional=True),
        ]

    def times(self):
        """Return the parameters of the voyage's time."""
        raise NotImplementedError

    def options(self, parameters, context):
        """Return the options of the voyage's time."""
        raise NotImplementedError

    def command(self, parameters, context, feedback):
        """Return `renew go` with its options."""
        degrees = QgsCoordinateReferenceSystem(_DEGREES)
        command = ["go"]
        for name in ("START", "GOAL"):
            point = self.parameterAsPoint(parameters, name, context, degrees)
            command.append(f"{point.x():.7f},{point.y():.7f}")
        command += self.options(parameters, context)
        for option in ("vessel", "currents", "depths", "draught", "within"):
            text = self.parameterAsString(parameters, option.upper(), context).strip()
            command += [f"--{option}", text] if text else []
        for option, name in (("charts", "LAND"), ("avoid", "SHUT"), ("havens", "HAVENS")):
            path = self.in_degrees(parameters, name, context, feedback)
            command += [f"--{option}", path] if path else []
        return command

    def moment(self, parameters, name, context):
        """Return a time, which is UTC, as the command takes it; "" where none is given."""
        time = self.parameterAsDateTime(parameters, name, context)
        return time.toString("yyyy-MM-dd'T'HH:mm'Z'") if time.isValid() else ""


class RouteFromAToB(_Voyage):
    """Routes for one voyage."""

    NAME, TITLE = "route", "Route from A to B"
    HELP = (
        "Plans the routes of least fuel from start to goal, one for each way round the islands, "
        "with hard-over turns simulated along each. Give a month, or a departure (UTC), from which "
        "the currents change on the way."
    )

    def times(self):
        """Month or departure."""
        return [
            QgsProcessingParameterString("MONTH", "Month, such as 2024-07", optional=True),
            QgsProcessingParameterDateTime("DEPART", "Departure, UTC", optional=True),
        ]

    def options(self, parameters, context):
        """Month or departure."""
        month = self.parameterAsString(parameters, "MONTH", context).strip()
        depart = self.moment(parameters, "DEPART", context)
        found = ["--month", month] if month else []
        return found + (["--depart", depart] if depart else [])


class WhenToLeave(_Voyage):
    """The best departure of a voyage."""

    NAME, TITLE = "leave", "When to leave"
    HELP = (
        "Plans departures between two times (UTC) in currents that change, and chooses the one "
        "that needs least fuel. All that were planned are in the table of departures."
    )

    def times(self):
        """First and last departure, and latest arrival."""
        return [
            QgsProcessingParameterDateTime("DEPART", "First departure, UTC"),
            QgsProcessingParameterDateTime("UNTIL", "Last departure, UTC"),
            QgsProcessingParameterDateTime("ARRIVE_BY", "Latest arrival, UTC", optional=True),
        ]

    def options(self, parameters, context):
        """First and last departure, and latest arrival."""
        found = []
        for name in ("DEPART", "UNTIL", "ARRIVE_BY"):
            time = self.moment(parameters, name, context)
            found += [f"--{name.lower().replace('_', '-')}", time] if time else []
        return found

    def processAlgorithm(self, parameters, context, feedback):
        """Plan, and list the departures."""
        results = super().processAlgorithm(parameters, context, feedback)
        table = Path(results["OUTPUT"]) / "departures.csv"
        if table.is_file():
            with table.open(encoding="utf-8", newline="") as file:
                for row in csv.reader(file):
                    feedback.pushInfo("  ".join(row))
            if context.project() is not None:
                details = QgsProcessingContext.LayerDetails("departures", context.project())
                context.addLayerToLoadOnCompletion(str(table), details)
        return results


class Scenario(_Algorithm):
    """A scenario's routes, by `renew run`."""

    NAME, TITLE = "scenario", "Plan a scenario"
    HELP = "Plans a scenario: one of the catalogue by its name, or a TOML file."

    def inputs(self):
        """Scenario, charts and currents."""
        return [
            QgsProcessingParameterString("SCENARIO", "Scenario: a name, or a TOML file"),
            QgsProcessingParameterFile("CHARTS", "Charts, in place of its own", optional=True),
            QgsProcessingParameterString(
                "CURRENTS", "Currents, in place of its own", optional=True
            ),
        ]

    def command(self, parameters, context, feedback):
        """Return `renew run` with its options."""
        del feedback
        scenario = self.parameterAsString(parameters, "SCENARIO", context).strip()
        if not scenario:
            raise QgsProcessingException("Name a scenario, or give its file.")
        command = ["run", scenario]
        for option in ("charts", "currents"):
            text = self.parameterAsString(parameters, option.upper(), context).strip()
            command += [f"--{option}", text] if text else []
        return command
