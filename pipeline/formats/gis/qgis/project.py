"""The QGIS project inside the GeoPackage, which opens as a finished map.

Layers are listed in a group per season, with land below; land is drawn over the soft no-go zones,
as in the paper.
"""

import io
import textwrap
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from pipeline.formats.figures.palette import COLOURS
from pipeline.formats.gis.layers.all_layers import LAYERS
from pipeline.formats.gis.layers.fields import FIELDS
from pipeline.formats.gis.layers.frames import Layer
from pipeline.formats.gis.qgis.layout import pages
from pipeline.formats.gis.qgis.map_crs import lonlat_system, map_crs
from pipeline.formats.gis.qgis.styles import style
from pipeline.formats.gis.qgis.symbols import Style
from pipeline.formats.gis.qgis.view import SeasonView, View
from pipeline.formats.gis.qgis.xml import clean, one_line, rendered
from pipeline.formats.shared.result import RunResult

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

    @property
    def geometry(self) -> str:
        """QGIS's name for its type of geometry."""
        return _GEOMETRIES[self.layer.geometry_type]

    @property
    def style(self) -> Style:
        """How it is drawn."""
        return style(self.layer.name, self.view)

    @property
    def routes_identity(self) -> str:
        """Identifier of its season's routes."""
        return replace(self, layer=_LAYERS["routes"]).identity

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
) -> str:
    """Write the project's XML."""
    crs = map_crs(result)
    return rendered(
        "project.qgs.jinja",
        title=one_line(result.scenario.title or result.scenario.name),
        crs=crs,
        lonlat=lonlat_system(),
        layers=_project_layers(replace(view, convergence=crs.convergence)),
        seasons=view.seasons,
        season_layers=_SEASON_LAYERS,
        columns=columns,
        fields=FIELDS,
        file_name=file_name,
        pages=pages(crs),
        water=bytes.fromhex(COLOURS["water"].removeprefix("#")),
        result=result,
        credits=_credits(result),
        licences=dict.fromkeys(credit.licence for credit in result.credits if credit.licence),
    )


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


def _credits(result: RunResult) -> str:
    """All credits as one text, wrapped to fit on a map."""
    texts = dict.fromkeys(credit.text for credit in result.credits)
    return clean("\n".join(line for text in texts for line in textwrap.wrap(text, _CREDITS_WIDTH)))


def _sql(text: str) -> str:
    """Write text for SQL, odd characters in hexadecimal: QGIS parses the text of a source."""
    if text.replace("-", "").replace("_", "").isalnum():
        return f"'{text}'"
    return f"CAST(X'{text.encode('utf-8', 'replace').hex()}' AS TEXT)"
