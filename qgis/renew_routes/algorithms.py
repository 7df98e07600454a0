"""The algorithms: their parameters, the command line of each, and the layers that they give."""

import csv
import json
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
    QgsProcessingParameterBoolean,
    QgsProcessingParameterDateTime,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFeatureSource,
    QgsProcessingParameterFile,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterPoint,
    QgsProcessingParameterString,
    QgsProcessingUtils,
)
from qgis.PyQt.QtCore import QTimer

from .program import run
from .voyage import DEFAULT_VESSEL, typed, voyage_options

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


def _load(context, source, title, processor=None):
    """Load a layer into the project, if there is one, when the algorithm has ended."""
    if context.project() is not None:
        details = QgsProcessingContext.LayerDetails(title, context.project())
        details.setPostProcessor(processor)
        context.addLayerToLoadOnCompletion(source, details)


class _Algorithm(QgsProcessingAlgorithm):
    """What the algorithms share: the folder of results, and what is shown of them."""

    NAME, TITLE, HELP = "", "", ""
    RESULTS = (
        (QgsProcessingOutputFile, "GEOPACKAGE", "Routes and all other layers"),
        (QgsProcessingOutputFile, "REPORT", "Report"),
        (QgsProcessingOutputNumber, "FUEL", "Fuel of the best route"),
        (QgsProcessingOutputNumber, "LENGTH_M", "Length of the best route, m"),
        (QgsProcessingOutputString, "DEPARTURE", "Departure, where there is one"),
    )

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
        for kind, name, label in self.RESULTS:
            self.addOutput(kind(name, label))

    def inputs(self):
        """Return the parameters of the algorithm."""
        raise NotImplementedError

    def command(self, parameters, context, feedback):
        """Return the command line for some values of the parameters."""
        raise NotImplementedError

    def answer(self, parameters, context, feedback):
        """Run the command; return its answer, a dictionary."""
        output = Path(self.parameterAsString(parameters, "OUTPUT", context))
        output.mkdir(parents=True, exist_ok=True)
        more = shlex.split(self.parameterAsString(parameters, "MORE", context))
        command = self.command(parameters, context, feedback)
        return run([*command, "--output", str(output), *more], feedback)

    def processAlgorithm(self, parameters, context, feedback):
        """Plan, and show the layers."""
        answer = self.answer(parameters, context, feedback)
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
        with sqlite3.connect(f"{package.as_uri()}?mode=ro", uri=True) as base:
            titles = dict(base.execute(_FILLED).fetchall())
        for name in _SHOWN:
            if name in titles:
                styled = _Styled(str(package), titles[name], _SHOWN.index(name))
                _load(context, f"{package}|layername={name}", titles[name], styled)

    def in_degrees(self, parameters, name, context, feedback, ending="gpkg"):
        """Write a layer to a file in degrees; return its path, "" without a layer."""
        if not parameters.get(name):
            return ""
        file = QgsProcessingUtils.generateTempFilename(f"{name.lower()}.{ending}")
        done = processing.run(
            "native:reprojectlayer",
            {"INPUT": parameters[name], "TARGET_CRS": _DEGREES, "OUTPUT": file},
            context=context,
            feedback=feedback,
            is_child_algorithm=True,
        )
        return done["OUTPUT"]


# QGIS refuses words that its usual filter does not match, such as "still".
_ANY = "All files (*)"
# Names of parameters that are not those of their options.
_OWN_NAMES = {"charts": "LAND", "avoid": "SHUT"}
# Name of the parameter for a vessel that is not in the list.
_OWN_FILE = "VESSEL_FILE"
# Options that stand above "Advanced parameters".
_FIRST = (
    *("start", "goal", "vessel", "month", "depart", "until", "arrive_by", "currents", "charts"),
    *("avoid", "depths", "draught", "havens", "within", "members"),
)
_GEOMETRIES = {
    "polygon": QgsProcessing.TypeVectorPolygon,
    "point": QgsProcessing.TypeVectorPoint,
}

_KINDS = {
    "place": QgsProcessingParameterPoint,
    "time": QgsProcessingParameterDateTime,
    "flag": partial(QgsProcessingParameterBoolean, defaultValue=False),
    "text": QgsProcessingParameterString,
    **dict.fromkeys(("file", "source"), partial(QgsProcessingParameterFile, fileFilter=_ANY)),
}


def _parameter(option, *, required):
    """Return the parameter for an option of a voyage."""
    label = f"{option['label']} (UTC)" if option["kind"] == "time" else option["label"]
    make = _KINDS[option["kind"]]
    if "choices" in option:
        listed = {"options": option["choices"], "defaultValue": DEFAULT_VESSEL}
        make = partial(QgsProcessingParameterEnum, usesStaticStrings=True, **listed)
    elif option["layer"]:
        make = partial(QgsProcessingParameterFeatureSource, types=[_GEOMETRIES[option["layer"]]])
    return make(_name(option), label, optional=not required)


def _name(option):
    """Return the name of an option's parameter."""
    return _OWN_NAMES.get(option["name"], option["name"].upper())


class _Voyage(_Algorithm):
    """A voyage between two points, by `renew go`."""

    COMMAND = "go"
    # Options that this algorithm needs, and those that it does not ask for.
    REQUIRED, WITHOUT = ("start", "goal"), ()

    def voyage_options(self):
        """Return the options that the algorithm asks for, the usual ones first."""
        asked = [one for one in voyage_options() if one["name"] not in self.WITHOUT]
        first = [one for one in asked if one["name"] in _FIRST]
        return first + [one for one in asked if one not in first]

    def inputs(self):
        """Return a parameter for each option."""
        parameters = []
        for option in self.voyage_options():
            parameter = _parameter(option, required=option["name"] in self.REQUIRED)
            several = " Several are separated by ';'." if option["several"] else ""
            parameter.setHelp(f"{option['help']}{several}")
            if option["name"] not in _FIRST:
                advanced = QgsProcessingParameterDefinition.FlagAdvanced
                parameter.setFlags(parameter.flags() | advanced)
            parameters.append(parameter)
            if "choices" in option:
                label = f"{option['label']} of your own, a TOML file"
                parameters.append(QgsProcessingParameterFile(_OWN_FILE, label, optional=True))
        return parameters

    def command(self, parameters, context, feedback):
        """Return the command with its options."""
        options = self.voyage_options()
        texts = {
            option["name"]: self.text(option, parameters, context, feedback) for option in options
        }
        own = self.parameterAsString(parameters, _OWN_FILE, context)
        return [self.COMMAND, *typed(options, {**texts, "vessel": own or texts["vessel"]})]

    def text(self, option, parameters, context, feedback):
        """Return an option's value as the command takes it; "" where none is given."""
        name, kind = _name(option), option["kind"]
        if kind == "place":
            degrees = QgsCoordinateReferenceSystem(_DEGREES)
            point = self.parameterAsPoint(parameters, name, context, degrees)
            return f"{point.x():.7f},{point.y():.7f}"
        if kind == "time":
            time = self.parameterAsDateTime(parameters, name, context)
            return time.toString("yyyy-MM-dd'T'HH:mm'Z'") if time.isValid() else ""
        if kind == "flag":
            return "yes" if self.parameterAsBoolean(parameters, name, context) else ""
        if option["layer"]:
            return self.in_degrees(parameters, name, context, feedback)
        return self.parameterAsString(parameters, name, context).strip()


class RouteFromAToB(_Voyage):
    """Routes for one voyage."""

    NAME, TITLE = "route", "Route from A to B"
    HELP = (
        "Plans the routes of least fuel from start to goal, one for each way round the islands, "
        "with hard-over turns simulated along each. Give a month, or a departure (UTC), from which "
        "the currents change on the way."
    )


class WhenToLeave(_Voyage):
    """The best departure of a voyage."""

    NAME, TITLE = "leave", "When to leave"
    REQUIRED, WITHOUT = ("start", "goal", "depart", "until"), ("month",)
    HELP = (
        "Plans departures between two times (UTC) in currents that change, and chooses the one "
        "that needs least fuel. All that were planned are in the table of departures."
    )

    def processAlgorithm(self, parameters, context, feedback):
        """Plan, and list the departures."""
        results = super().processAlgorithm(parameters, context, feedback)
        table = Path(results["OUTPUT"]) / "departures.csv"
        if table.is_file():
            with table.open(encoding="utf-8", newline="") as file:
                for row in csv.reader(file):
                    feedback.pushInfo("  ".join(row))
            _load(context, str(table), "departures")
        return results


class CheckARoute(_Voyage):
    """A route that the user has already, by `renew check-route`."""

    NAME, TITLE, COMMAND = "check", "Check a route", "check-route"
    HELP = (
        "Says what a route of yours costs in fuel and time, and whether it is safe: of a file, or "
        "the first line of a layer. Beside it stand the least-fuel route of its own side and the "
        "best of all. A departure that is left out is the one that the file states."
    )
    REQUIRED = ()
    # What a route of one's own leaves open, or says itself.
    WITHOUT = tuple(one["name"] for one in voyage_options() if "only_plans" in one)
    RESULTS = (
        (QgsProcessingOutputNumber, "FUEL", "Fuel"),
        (QgsProcessingOutputNumber, "LENGTH_M", "Length, m"),
        (QgsProcessingOutputNumber, "DURATION_S", "Time under way, s"),
        (QgsProcessingOutputString, "SAID", "What was found"),
        (QgsProcessingOutputFile, "PLACES", "Places along the route"),
    )

    def inputs(self):
        """Return the route, as a file or a layer, and a parameter for each option."""
        lines = [QgsProcessing.TypeVectorLine]
        return [
            QgsProcessingParameterFile("FILE", "Route: GPX, RTZ or GeoJSON", optional=True),
            QgsProcessingParameterFeatureSource(
                "LINE", "Or a layer of lines", lines, optional=True
            ),
            *super().inputs(),
        ]

    def command(self, parameters, context, feedback):
        """Return `renew check-route` with the file, or one of the layer, and the options."""
        file = self.parameterAsString(parameters, "FILE", context) or self.in_degrees(
            parameters, "LINE", context, feedback, "geojson"
        )
        if not file:
            raise QgsProcessingException("Give a route: a file, or a layer of lines.")
        command, *options = super().command(parameters, context, feedback)
        return [command, file, *options]

    def processAlgorithm(self, parameters, context, feedback):
        """Check, say what was found, and show the places."""
        seasons = self.answer(parameters, context, feedback)["seasons"]
        said = [line for season in seasons for line in season["said"]]
        for line in said:
            feedback.pushInfo(line)
        features = [feature for season in seasons for feature in _places(season)]
        places = Path(self.parameterAsString(parameters, "OUTPUT", context)) / "places.geojson"
        places.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
        _load(context, str(places), "Places along the route")
        return {
            "PLACES": str(places),
            "FUEL": seasons[0]["fuel"],
            "LENGTH_M": seasons[0]["length_m"],
            "DURATION_S": seasons[0]["duration_s"],
            "SAID": "\n".join(said),
        }


def _places(season):
    """Yield the points of a checked route, then what is on its way, as features of GeoJSON."""

    def feature(what, place, name="", length_m=None, **times):
        properties = {"season": season["season"], "what": what, "name": name, "length_m": length_m}
        point = {"type": "Point", "coordinates": [place["lon"], place["lat"]]}
        return {"type": "Feature", "properties": properties | times, "geometry": point}

    for one in season["points"]:
        yield feature("point", one, one["name"], passed=one["passed"], stated=one["stated"])
    for what in ("crosses", "against_lanes"):
        for one in season[what]:
            yield feature(what.replace("_", " "), one["place"], one["name"], one["length_m"])
    # Turns are simulated every few metres; one place in about 100 m is enough on a map.
    met = season["turns_meet_land_from"]
    for place in {(round(one["lon"], 3), round(one["lat"], 3)): one for one in met}.values():
        yield feature("a turn meets land", place)
    if season["nearest"]:
        yield feature("land is nearest", season["nearest"])


class Scenario(_Algorithm):
    """A scenario's routes, by `renew run`."""

    NAME, TITLE = "scenario", "Plan a scenario"
    HELP = "Plans a scenario: one of the catalogue by its name, or a TOML file."

    def inputs(self):
        """Scenario, charts and currents."""
        return [
            QgsProcessingParameterString("SCENARIO", "Scenario: a name, or a TOML file"),
            QgsProcessingParameterFile("CHARTS", "Charts, in place of its own", optional=True),
            QgsProcessingParameterFile(
                "CURRENTS", "Currents, in place of its own", optional=True, fileFilter=_ANY
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
