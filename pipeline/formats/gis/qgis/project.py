"""The QGIS project inside the GeoPackage, which opens as a finished map.

Layers are listed in a group per season, with land below; land is drawn over the soft no-go zones,
as in the paper.
"""

from __future__ import annotations

import io
import textwrap
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from lxml import etree

from pipeline.formats.figures.palette import COLOURS
from pipeline.formats.gis.layers.all_layers import LAYERS
from pipeline.formats.gis.layers.frames import Layer
from pipeline.formats.gis.qgis.layout import put_layouts
from pipeline.formats.gis.qgis.map_crs import MapCrs, ReferenceSystem, lonlat_system, map_crs
from pipeline.formats.gis.qgis.styles import style
from pipeline.formats.gis.qgis.symbols import MAX_TITLE_LENGTH, clean, one_line
from pipeline.formats.gis.qgis.view import SeasonView, View
from pipeline.formats.shared.result import RunResult

Element = Any  # lxml has no types

# Drawing order, from the top down.
_DRAWING_ORDER = (
    *("islands", "passage", "routes", "path_points", "contingency", "legs"),
    *("hazards", "coast", "chart_areas", "no_go", "soft_no_go", "channels", "currents"),
    "depth_areas",
)
# Layers of a season's group -> whether the leading season shows them at first.
_SEASON_LAYERS = {
    "passage": True,
    "routes": True,
    "legs": True,
    "path_points": False,
    "contingency": False,
    "channels": False,
    "soft_no_go": True,
    "currents": True,
}
# Geometry type of a layer -> QGIS's name for it.
_GEOMETRIES = {"LineString": "Line", "Point": "Point", "MultiPolygon": "Polygon"}
_LAYERS = {layer.name: layer for layer in LAYERS}
# Maximum number of characters of a line of credits on the map.
_CREDITS_WIDTH = 100


@dataclass(frozen=True)
class _ProjectLayer:
    """A layer of the project: one season's part of a layer of the file, or all of it."""

    layer: Layer
    view: View
    season: SeasonView | None

    @property
    def identity(self) -> str:
        """The layer's identifier inside the project; QGIS wants more than ten characters."""
        part = "all_seasons" if self.season is None else f"season_{self.season.number}"
        return f"{self.layer.name}_{part}"

    @property
    def is_on(self) -> bool:
        """Whether it is drawn at first: land, all best routes, and one season in full."""
        if self.season is None or self.layer.name == "routes":
            return True
        return self.season.leads and _SEASON_LAYERS[self.layer.name]

    def source(self, file_name: str) -> str:
        """Data source of its features, relative to the project."""
        source = f"./{file_name}|layername={self.layer.name}"
        if self.season is None:
            return source
        return f'{source}|subset="season" = {_sql(self.season.name)}'


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
    title = one_line(result.scenario.title or result.scenario.name, MAX_TITLE_LENGTH)
    root = etree.Element("qgis", version="3.22.0", projectname=title)
    etree.SubElement(root, "title").text = title
    crs = map_crs(result)
    _put_system(etree.SubElement(root, "projectCrs"), crs.system)
    layers = _project_layers(replace(view, convergence=crs.convergence))
    _put_tree(root, layers, view, file_name)
    _put_canvas(root, crs)
    parent = etree.SubElement(root, "projectlayers")
    for layer in layers:
        _put_layer(parent, layer, result, columns[layer.layer.name], file_name)
    _put_relations(root, layers)
    _put_themes(root, layers, view)
    put_layouts(root, crs, title, _credits(result))
    _put_properties(root, result, title)
    _put_metadata(root, result, title)
    document: bytes = etree.tostring(
        root,
        encoding="UTF-8",
        xml_declaration=True,
        doctype="<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>",
    )
    return document


def _project_layers(view: View) -> list[_ProjectLayer]:
    """All layers of the project in their drawing order, the top one first.

    The leading season is below the others, since its best route is wider.
    """
    layers = []
    for name in _DRAWING_ORDER:
        if name not in _SEASON_LAYERS:
            layers.append(_ProjectLayer(_LAYERS[name], view, None))
            continue
        layers += [
            _ProjectLayer(_LAYERS[name], replace(view, seasons=(season,)), season)
            for season in sorted(view.seasons, key=lambda season: season.leads)
            if season.planned or name == "currents"
        ]
    return layers


def _put_tree(root: Element, layers: Sequence[_ProjectLayer], view: View, file_name: str) -> None:
    """List the layers: a group per season, the leading one first, then land."""
    tree = etree.SubElement(root, "layer-tree-group")
    for season in sorted(view.seasons, key=lambda season: not season.leads):
        group = etree.SubElement(
            tree,
            "layer-tree-group",
            name=one_line(season.title, MAX_TITLE_LENGTH),
            checked="Qt::Checked",
            expanded="1" if season.leads else "0",
        )
        for name in _SEASON_LAYERS:
            for one in layers:
                if one.layer.name == name and one.season is season:
                    _put_node(group, one, file_name)
    for one in layers:
        if one.season is None:
            _put_node(tree, one, file_name)
    order = etree.SubElement(tree, "custom-order", enabled="1")
    for one in layers:
        etree.SubElement(order, "item").text = one.identity


def _put_node(group: Element, one: _ProjectLayer, file_name: str) -> None:
    """List a layer in the tree."""
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
    parent: Element, one: _ProjectLayer, result: RunResult, columns: Sequence[str], file_name: str
) -> None:
    """Describe a layer: source, style and credits."""
    layer = etree.SubElement(
        parent,
        "maplayer",
        type="vector",
        geometry=_GEOMETRIES[one.layer.geometry_type],
        wkbType=one.layer.geometry_type,
        styleCategories="AllStyleCategories",
    )
    etree.SubElement(layer, "id").text = one.identity
    etree.SubElement(layer, "datasource").text = one.source(file_name)
    etree.SubElement(layer, "layername").text = one.layer.title
    _put_system(etree.SubElement(layer, "srs"), lonlat_system())
    metadata = etree.SubElement(layer, "resourceMetadata")
    etree.SubElement(metadata, "type").text = "dataset"
    etree.SubElement(metadata, "title").text = one.layer.title
    etree.SubElement(metadata, "abstract").text = one.layer.description
    _put_credits(metadata, result)
    etree.SubElement(layer, "provider", encoding="UTF-8").text = "ogr"
    style(one.layer.name, one.view).put(layer, columns)


def _put_canvas(root: Element, crs: MapCrs) -> None:
    """Open the map on the whole chart."""
    canvas = etree.SubElement(root, "mapcanvas", name="theMapCanvas", annotationsVisible="1")
    etree.SubElement(canvas, "units").text = "degrees" if crs.is_lonlat else "meters"
    extent = etree.SubElement(canvas, "extent")
    settings = etree.SubElement(root, "ProjectViewSettings", UseProjectScales="0")
    full = etree.SubElement(settings, "DefaultViewExtent")
    for name, value in zip(("xmin", "ymin", "xmax", "ymax"), crs.bounds, strict=True):
        etree.SubElement(extent, name).text = f"{value:.8f}"
        full.set(name, f"{value:.8f}")
    _put_system(full, crs.system)
    etree.SubElement(canvas, "rotation").text = "0"
    _put_system(etree.SubElement(canvas, "destinationsrs"), crs.system)


def _put_relations(root: Element, layers: Sequence[_ProjectLayer]) -> None:
    """Relate waypoints and legs to their route, whose form then lists them."""
    relations = etree.SubElement(root, "relations")
    for one in layers:
        if one.layer.name not in {"passage", "legs"} or one.season is None:
            continue
        relation = etree.SubElement(
            relations,
            "relation",
            id=f"{one.identity}_of_route",
            name=one.layer.title,
            strength="Association",
            referencingLayer=one.identity,
            referencedLayer=replace(one, layer=_LAYERS["routes"]).identity,
        )
        etree.SubElement(relation, "fieldRef", referencingField="rank", referencedField="rank")


def _put_themes(root: Element, layers: Sequence[_ProjectLayer], view: View) -> None:
    """Add a map theme for each season by itself."""
    themes = etree.SubElement(root, "visibility-presets")
    for season in view.seasons:
        theme = etree.SubElement(
            themes, "visibility-preset", name=one_line(season.title, MAX_TITLE_LENGTH)
        )
        for one in layers:
            if one.season is None or (one.season is season and _SEASON_LAYERS[one.layer.name]):
                etree.SubElement(theme, "layer", id=one.identity, style="default", visible="1")


def _put_properties(root: Element, result: RunResult, title: str) -> None:
    """Set the colour of the water, and show title, scale and small credits on the map."""
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
    shown = ("TitleLabel", title, 14), ("CopyrightLabel", _credits(result), 7)
    for decoration, text, size_pt in shown:
        label = etree.SubElement(properties, decoration)
        etree.SubElement(label, "Enabled", type="bool").text = "true"
        etree.SubElement(label, "Label", type="QString").text = text
        font = f'<text-style fontSize="{size_pt}" fontSizeUnit="Point" textColor="38,50,60,255"/>'
        etree.SubElement(label, "Font", type="QString").text = font
    scale = etree.SubElement(properties, "ScaleBar")
    etree.SubElement(scale, "Enabled", type="bool").text = "true"
    # Lower left: a long title above the map would meet it in the upper corner.
    etree.SubElement(scale, "Placement", type="int").text = "0"
    measure = etree.SubElement(properties, "Measure")
    etree.SubElement(measure, "Ellipsoid", type="QString").text = "EPSG:7030"


def _put_metadata(root: Element, result: RunResult, title: str) -> None:
    """Describe the project: title, sources and time of creation."""
    metadata = etree.SubElement(root, "projectMetadata")
    etree.SubElement(metadata, "identifier").text = clean(result.scenario.name)
    etree.SubElement(metadata, "title").text = _as_html(result.scenario.title or title)
    etree.SubElement(metadata, "abstract").text = _as_html(result.scenario.description)
    _put_credits(metadata, result)
    etree.SubElement(metadata, "author").text = "RENEW"
    etree.SubElement(metadata, "creation").text = result.created.strftime("%Y-%m-%dT%H:%M:%S")


def _put_credits(metadata: Element, result: RunResult) -> None:
    """Add the credit and licence of each source."""
    for credit in result.credits:
        etree.SubElement(metadata, "rights").text = _as_html(credit.text)
    for licence in dict.fromkeys(credit.licence for credit in result.credits if credit.licence):
        etree.SubElement(metadata, "license").text = _as_html(licence)


def _credits(result: RunResult) -> str:
    """All credits as one text, wrapped to fit on a map."""
    texts = dict.fromkeys(credit.text for credit in result.credits)
    return clean("\n".join(line for text in texts for line in textwrap.wrap(text, _CREDITS_WIDTH)))


def _put_system(parent: Element, system: ReferenceSystem) -> None:
    """Describe a reference system."""
    element = etree.SubElement(parent, "spatialrefsys", nativeFormat="Wkt")
    etree.SubElement(element, "wkt").text = system.wkt
    etree.SubElement(element, "authid").text = system.authority
    etree.SubElement(element, "description").text = system.name


def _sql(text: str) -> str:
    """Write text for SQL, odd characters in hexadecimal: QGIS parses the text of a source."""
    if text.replace("-", "").replace("_", "").isalnum():
        return f"'{text}'"
    return f"CAST(X'{text.encode('utf-8', 'replace').hex()}' AS TEXT)"


def _as_html(text: str) -> str:
    """Text for where QGIS shows HTML, so that no markup takes effect."""
    return clean(text).replace("<", "&lt;")
