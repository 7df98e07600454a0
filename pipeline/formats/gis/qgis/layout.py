"""Print layouts of the QGIS project, A4 and A3: title, map, legend, scale bar and credits."""

from __future__ import annotations

import uuid
from typing import Any

from lxml import etree

from pipeline.formats.figures.graticule import nice_step
from pipeline.formats.figures.palette import COLOURS
from pipeline.formats.gis.qgis.map_crs import MapCrs

Element = Any  # lxml has no types

_PAGES_MM = {"A4": (297.0, 210.0), "A3": (420.0, 297.0)}
# Margin of a page, and on an A4 page the height of the title and the credits and the width of the
# legend; on A3 they are larger by the ratio of the pages.
_MARGIN_MM, _TITLE_MM, _CREDITS_MM, _LEGEND_MM = 10.0, 12.0, 16.0, 62.0
_TITLE_PT, _CREDITS_PT = 16.0, 6.0
# Sizes of the legend's texts, and the space above each line.
_LEGEND_PT = {"title": 9.0, "group": 8.0, "subgroup": 7.0, "symbol": 6.5, "symbolLabel": 6.5}
_LEGEND_GAP_MM = 0.9
# QGIS's numbers of the items' kinds.
_MAP, _LABEL, _LEGEND, _SCALE_BAR, _PAGE = 65639, 65641, 65642, 65646, 65638
_NAUTICAL_MILE_M, _METRES_PER_DEGREE = 1852.0, 111_195.0
# Length of half a scale bar, as a share of the map's width.
_BAR_SHARE = 1 / 10
# Size of the numbers of a scale bar, points.
_BAR_PT = 7.0


def put_layouts(root: Element, crs: MapCrs, title: str, credit: str) -> None:
    """Add a print layout for each size of page."""
    layouts = etree.SubElement(root, "Layouts")
    for name, page in _PAGES_MM.items():
        layout = etree.SubElement(
            layouts, "Layout", name=f"{title} ({name})", units="mm", printResolution="300"
        )
        collection = etree.SubElement(layout, "PageCollection")
        _item(collection, _PAGE, (0.0, 0.0, *page), f"{name} page")
        _put_items(layout, crs, (title, credit), page, name)


def _put_items(
    layout: Element, crs: MapCrs, texts: tuple[str, str], page: tuple[float, float], name: str
) -> None:
    """Add the items of a page, of a width and height in millimetres."""
    width, height = page
    scale = width / _PAGES_MM["A4"][0]
    title_mm, credits_mm, legend_mm = (s * scale for s in (_TITLE_MM, _CREDITS_MM, _LEGEND_MM))
    inner = width - 2 * _MARGIN_MM
    top, low = _MARGIN_MM + title_mm, height - _MARGIN_MM - credits_mm
    map_mm = inner - legend_mm
    frame = _item(layout, _MAP, (_MARGIN_MM, top, map_mm, low - top), f"{name} map", frame=True)
    xmin, ymin, xmax, ymax = crs.bounds
    grown = _with_ratio((xmin, ymin, xmax, ymax), map_mm / (low - top))
    water = bytes.fromhex(COLOURS["water"].removeprefix("#"))
    shades = {name: str(value) for name, value in zip(("red", "green", "blue"), water, strict=True)}
    etree.SubElement(frame, "BackgroundColor", {**shades, "alpha": "255"})
    names = ("xmin", "ymin", "xmax", "ymax")
    sides = {side: f"{value:.8f}" for side, value in zip(names, grown, strict=True)}
    etree.SubElement(frame, "Extent", sides)
    _label(layout, texts[0], (_MARGIN_MM, _MARGIN_MM, inner, title_mm), _TITLE_PT * scale, name)
    _label(layout, texts[1], (_MARGIN_MM, low + 2, inner, credits_mm), _CREDITS_PT * scale, name)
    legend = _item(layout, _LEGEND, (_MARGIN_MM + map_mm + 2, top, 0, 0), f"{name} legend")
    settings = {"map_uuid": frame.get("uuid"), "legendFilterByMap": "1", "resizeToContents": "1"}
    sizes = {"symbolWidth": f"{5 * scale:g}", "symbolHeight": f"{2.5 * scale:g}"}
    for key, value in (settings | sizes).items():
        legend.set(key, value)
    styles = etree.SubElement(legend, "styles")
    for style, size_pt in _LEGEND_PT.items():
        gap = f"{_LEGEND_GAP_MM * scale:g}"
        text = etree.SubElement(
            styles, "style", name=style, alignment="1", marginTop=gap, marginLeft=gap
        )
        etree.SubElement(text, "styleFont", description=_font(size_pt * scale))
    _scale_bar(layout, frame, crs, grown, low)


def _scale_bar(
    layout: Element, frame: Element, crs: MapCrs, extent: tuple[float, ...], low: float
) -> None:
    """Add a scale bar in nautical miles, in the map's lower left corner."""
    unit_m = _METRES_PER_DEGREE if crs.is_lonlat else 1.0
    miles = nice_step((extent[2] - extent[0]) * unit_m * _BAR_SHARE / _NAUTICAL_MILE_M)
    bar = _item(layout, _SCALE_BAR, (_MARGIN_MM + 3, low - 16, 60, 13), f"{frame.get('id')} scale")
    settings = {
        "style": "Single Box",
        "unitType": "nautical miles",
        "unitLabel": "NM",
        "numUnitsPerSegment": f"{miles:g}",
        "numSegments": "2",
        "numSegmentsLeft": "0",
        "numMapUnitsPerScaleBarUnit": "1",
        "mapUuid": frame.get("uuid"),
        "height": "1.5",
        "labelBarSpace": "1",
    }
    for key, value in settings.items():
        bar.set(key, value)
    etree.SubElement(bar, "scaleBarFont", description=_font(_BAR_PT))


def _label(
    layout: Element, text: str, box: tuple[float, float, float, float], size_pt: float, name: str
) -> None:
    """Add text in a font size."""
    label = _item(layout, _LABEL, box, f"{name} {'title' if size_pt > 10 else 'credits'}")
    label.set("labelText", text)
    etree.SubElement(label, "LabelFont", description=_font(size_pt))


def _font(size_pt: float) -> str:
    """A plain font as Qt describes it."""
    return f"Sans Serif,{size_pt:g},-1,5,50,0,0,0,0,0"


def _item(
    parent: Element,
    kind: int,
    box: tuple[float, float, float, float],
    name: str,
    *,
    frame: bool = False,
) -> Element:
    """Add an item of a kind at a place (left, top, width, height in millimetres)."""
    left, top, width, height = box
    identity = f"{{{uuid.uuid5(uuid.NAMESPACE_URL, f'renew:{name}')}}}"
    return etree.SubElement(
        parent,
        "LayoutItem",
        type=str(kind),
        id=name,
        uuid=identity,
        templateUuid=identity,
        position=f"{left:g},{top:g},mm",
        positionOnPage=f"{left:g},{top:g},mm",
        size=f"{width:g},{height:g},mm",
        frame="true" if frame else "false",
        background="true" if frame else "false",
        visibility="1",
        opacity="1",
        zValue=str(len(parent)),
    )


def _with_ratio(
    bounds: tuple[float, float, float, float], ratio: float
) -> tuple[float, float, float, float]:
    """Bounds grown about their middle to a ratio of width to height."""
    xmin, ymin, xmax, ymax = bounds
    width, height = max(xmax - xmin, ratio * (ymax - ymin)), max(ymax - ymin, (xmax - xmin) / ratio)
    x, y = (xmin + xmax) / 2, (ymin + ymax) / 2
    return x - width / 2, y - height / 2, x + width / 2, y + height / 2
