"""The QGIS project inside the GeoPackage: what opens as a finished map.

A group a season, land below; the drawing order puts land over the soft no-go zones, as the paper
does.
"""

from __future__ import annotations

import io
import textwrap
import zipfile
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from lxml import etree

from pipeline.formats.figures.palette import COLOURS
from pipeline.formats.gis.layers import LAYERS
from pipeline.formats.gis.map_crs import ground, lonlat
from pipeline.formats.gis.styles import style
from pipeline.formats.gis.symbols import LONGEST_TITLE, clean, short

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from pipeline.formats.gis.layers import Layer
    from pipeline.formats.gis.map_crs import Ground, System
    from pipeline.formats.gis.view import SeasonView, View
    from pipeline.formats.shared.result import RunResult

    Element = Any  # lxml has no types

# From the top of the map down: land lies over the zones around it, as in the paper.
_ORDER = (*("waypoints", "routes", "contingency", "no_go", "soft_no_go", "channels", "currents"),)
# In a season's group, and whether they are shown when it leads.
_IN_GROUP = {
    "waypoints": True,
    "routes": True,
    "contingency": False,
    "channels": False,
    "soft_no_go": True,
    "currents": True,
}
_KINDS = {"LineString": "Line", "Point": "Point", "MultiPolygon": "Polygon"}
_LAYERS = {layer.name: layer for layer in LAYERS}
_LINE = 100


@dataclass(frozen=True)
class _Shown:
    """A layer of the project: one season's part of a layer of the file, or all of it."""

    layer: Layer
    view: View
    season: SeasonView | None

    @property
    def identity(self) -> str:
        """The layer's name inside the project; QGIS wants more than ten letters."""
        part = "all_seasons" if self.season is None else f"season_{self.season.number}"
        return f"{self.layer.name}_{part}"

    @property
    def is_on(self) -> bool:
        """Whether it is drawn at first: land, all best routes, and one season in full."""
        if self.season is None or self.layer.name == "routes":
            return True
        return self.season.leads and _IN_GROUP[self.layer.name]

    def source(self, file_name: str) -> str:
        """Where its features are, beside the project."""
        place = f"./{file_name}|layername={self.layer.name}"
        if self.season is None:
            return place
        return f'{place}|subset="season" = {_sql(self.season.name)}'


def qgz(
    result: RunResult, view: View, columns: Mapping[str, Sequence[str]], file_name: str
) -> bytes:
    """Write the project as a .qgz; `columns` are those of each layer of the file `file_name`."""
    document = _document(result, view, columns, file_name)
    stamp = result.created.timetuple()[:6]
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        entry = zipfile.ZipInfo("routes.qgs", stamp)
        entry.compress_type = zipfile.ZIP_DEFLATED
        archive.writestr(entry, document)
    return packed.getvalue()


def _document(
    result: RunResult, view: View, columns: Mapping[str, Sequence[str]], file_name: str
) -> bytes:
    """Write the project's XML."""
    title = short(result.scenario.title or result.scenario.name, LONGEST_TITLE)
    root = etree.Element("qgis", version="3.22.0", projectname=title)
    etree.SubElement(root, "title").text = title
    plane = ground(result)
    _put_system(etree.SubElement(root, "projectCrs"), plane.system)
    shown = _shown(replace(view, convergence=plane.convergence))
    _put_tree(root, shown, view, file_name)
    _put_canvas(root, plane)
    layers = etree.SubElement(root, "projectlayers")
    for one in shown:
        _put_layer(layers, one, result, columns[one.layer.name], file_name)
    _put_themes(root, shown, view)
    _put_properties(root, result)
    _put_metadata(root, result, title)
    document: bytes = etree.tostring(
        root,
        encoding="UTF-8",
        xml_declaration=True,
        doctype="<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>",
    )
    return document


def _shown(view: View) -> list[_Shown]:
    """All layers of the project in their drawing order, the top one first.

    The season that leads is below the others: its best route is the wider one.
    """
    shown = []
    for name in _ORDER:
        if name not in _IN_GROUP:
            shown.append(_Shown(_LAYERS[name], view, None))
            continue
        shown += [
            _Shown(_LAYERS[name], replace(view, seasons=(season,)), season)
            for season in sorted(view.seasons, key=lambda season: season.leads)
            if season.planned or name == "currents"
        ]
    return shown


def _put_tree(root: Element, shown: Sequence[_Shown], view: View, file_name: str) -> None:
    """List the layers: a group a season, the leading one first, then land."""
    tree = etree.SubElement(root, "layer-tree-group")
    for season in sorted(view.seasons, key=lambda season: not season.leads):
        group = etree.SubElement(
            tree,
            "layer-tree-group",
            name=short(season.title, LONGEST_TITLE),
            checked="Qt::Checked",
            expanded="1" if season.leads else "0",
        )
        for name in _IN_GROUP:
            for one in shown:
                if one.layer.name == name and one.season is season:
                    _put_node(group, one, file_name)
    for one in shown:
        if one.season is None:
            _put_node(tree, one, file_name)
    order = etree.SubElement(tree, "custom-order", enabled="1")
    for one in shown:
        etree.SubElement(order, "item").text = one.identity


def _put_node(group: Element, one: _Shown, file_name: str) -> None:
    """List a layer."""
    etree.SubElement(
        group,
        "layer-tree-layer",
        id=one.identity,
        name=one.layer.title,
        source=one.source(file_name),
        providerKey="ogr",
        checked="Qt::Checked" if one.is_on else "Qt::Unchecked",
        expanded="1" if one.is_on and one.season is not None else "0",
    )


def _put_layer(
    parent: Element, one: _Shown, result: RunResult, columns: Sequence[str], file_name: str
) -> None:
    """Describe a layer: its source, its look and its credits."""
    layer = etree.SubElement(
        parent,
        "maplayer",
        type="vector",
        geometry=_KINDS[one.layer.geometry_type],
        wkbType=one.layer.geometry_type,
        styleCategories="AllStyleCategories",
    )
    etree.SubElement(layer, "id").text = one.identity
    etree.SubElement(layer, "datasource").text = one.source(file_name)
    etree.SubElement(layer, "layername").text = one.layer.title
    _put_system(etree.SubElement(layer, "srs"), lonlat())
    metadata = etree.SubElement(layer, "resourceMetadata")
    etree.SubElement(metadata, "type").text = "dataset"
    etree.SubElement(metadata, "title").text = one.layer.title
    etree.SubElement(metadata, "abstract").text = one.layer.description
    _put_credits(metadata, result)
    etree.SubElement(layer, "provider", encoding="UTF-8").text = "ogr"
    style(one.layer.name, one.view).put(layer, columns)


def _put_canvas(root: Element, plane: Ground) -> None:
    """Show all of the waters at first."""
    canvas = etree.SubElement(root, "mapcanvas", name="theMapCanvas", annotationsVisible="1")
    etree.SubElement(canvas, "units").text = "degrees" if plane.is_lonlat else "meters"
    extent = etree.SubElement(canvas, "extent")
    settings = etree.SubElement(root, "ProjectViewSettings", UseProjectScales="0")
    full = etree.SubElement(settings, "DefaultViewExtent")
    for name, value in zip(("xmin", "ymin", "xmax", "ymax"), plane.bounds, strict=True):
        etree.SubElement(extent, name).text = f"{value:.8f}"
        full.set(name, f"{value:.8f}")
    _put_system(full, plane.system)
    etree.SubElement(canvas, "rotation").text = "0"
    _put_system(etree.SubElement(canvas, "destinationsrs"), plane.system)


def _put_themes(root: Element, shown: Sequence[_Shown], view: View) -> None:
    """Offer each season by itself as a map theme."""
    themes = etree.SubElement(root, "visibility-presets")
    for season in view.seasons:
        theme = etree.SubElement(
            themes, "visibility-preset", name=short(season.title, LONGEST_TITLE)
        )
        for one in shown:
            if one.season is None or (one.season is season and _IN_GROUP[one.layer.name]):
                etree.SubElement(theme, "layer", id=one.identity, style="default", visible="1")


def _put_properties(root: Element, result: RunResult) -> None:
    """Colour the water, and keep the credits on the map."""
    properties = etree.SubElement(root, "properties")
    gui = etree.SubElement(properties, "Gui")
    for name, value in zip(
        ("Red", "Green", "Blue"), bytes.fromhex(COLOURS["water"].removeprefix("#")), strict=True
    ):
        etree.SubElement(gui, f"CanvasColor{name}Part", type="int").text = str(value)
    reference = etree.SubElement(properties, "SpatialRefSys")
    etree.SubElement(reference, "ProjectionsEnabled", type="int").text = "1"
    paths = etree.SubElement(properties, "Paths")
    etree.SubElement(paths, "Absolute", type="bool").text = "false"
    label = etree.SubElement(properties, "CopyrightLabel")
    etree.SubElement(label, "Enabled", type="bool").text = "true"
    etree.SubElement(label, "Label", type="QString").text = _credits(result)
    measure = etree.SubElement(properties, "Measure")
    etree.SubElement(measure, "Ellipsoid", type="QString").text = "EPSG:7030"


def _put_metadata(root: Element, result: RunResult, title: str) -> None:
    """Say what the project is, whose data it shows and when it was made."""
    metadata = etree.SubElement(root, "projectMetadata")
    etree.SubElement(metadata, "identifier").text = clean(result.scenario.name)
    etree.SubElement(metadata, "title").text = _as_html(result.scenario.title or title)
    etree.SubElement(metadata, "abstract").text = _as_html(result.scenario.description)
    _put_credits(metadata, result)
    etree.SubElement(metadata, "author").text = "RENEW"
    etree.SubElement(metadata, "creation").text = result.created.strftime("%Y-%m-%dT%H:%M:%S")


def _put_credits(metadata: Element, result: RunResult) -> None:
    """Name each source with its licence."""
    for credit in result.credits:
        etree.SubElement(metadata, "rights").text = _as_html(credit.text)
    for licence in dict.fromkeys(credit.licence for credit in result.credits if credit.licence):
        etree.SubElement(metadata, "license").text = _as_html(licence)


def _credits(result: RunResult) -> str:
    """Give all credits in one text, in lines that fit on a map."""
    texts = dict.fromkeys(credit.text for credit in result.credits)
    return clean("\n".join(line for text in texts for line in textwrap.wrap(text, _LINE)))


def _put_system(parent: Element, system: System) -> None:
    """Describe a reference system."""
    element = etree.SubElement(parent, "spatialrefsys", nativeFormat="Wkt")
    etree.SubElement(element, "wkt").text = system.wkt
    etree.SubElement(element, "authid").text = system.authority
    etree.SubElement(element, "description").text = system.name


def _sql(text: str) -> str:
    """Write text for SQL; a provider takes a source's text apart, so that odd names are coded."""
    if text.replace("-", "").replace("_", "").isalnum():
        return f"'{text}'"
    return f"CAST(X'{text.encode('utf-8', 'replace').hex()}' AS TEXT)"


def _as_html(text: str) -> str:
    """Text for where QGIS shows HTML: what looks like an element stays text."""
    return clean(text).replace("<", "&lt;")
