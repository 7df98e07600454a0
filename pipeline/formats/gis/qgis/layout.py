"""Print layouts of the QGIS project, A4 and A3: title, map, legend, scale bar and credits."""

from dataclasses import dataclass

from pipeline.formats.figures.graticule import nice_step
from pipeline.formats.gis.qgis.map_crs import Bounds, MapCrs

_PAGES_MM = {"A4": (297.0, 210.0), "A3": (420.0, 297.0)}
# Margin of a page, and on an A4 page the height of the title and the credits and the width of the
# legend; on A3 they are larger by the ratio of the pages.
_MARGIN_MM, _TITLE_MM, _CREDITS_MM, _LEGEND_MM = 10.0, 12.0, 16.0, 62.0
_NAUTICAL_MILE_M, _METRES_PER_DEGREE = 1852.0, 111_195.0
# Length of half a scale bar, as a share of the map's width.
_BAR_SHARE = 1 / 10


@dataclass(frozen=True)
class Page:
    """A page of a print layout.

    Attributes
    ----------
    scale : ratio of its width to that of an A4 page, by which fonts are larger, too.
    boxes : item -> its left, top, width and height, mm.
    bounds : of its map.
    bar_miles : length of each half of the scale bar, nautical miles.
    """

    name: str
    scale: float
    boxes: dict[str, tuple[float, float, float, float]]
    bounds: Bounds
    bar_miles: float


def pages(crs: MapCrs) -> list[Page]:
    """Lay out a page of each size."""
    return [_page(name, *size_mm, crs) for name, size_mm in _PAGES_MM.items()]


def _page(name: str, width: float, height: float, crs: MapCrs) -> Page:
    """Lay out a page of a width and height in millimetres."""
    scale = width / _PAGES_MM["A4"][0]
    title_mm, credits_mm, legend_mm = (s * scale for s in (_TITLE_MM, _CREDITS_MM, _LEGEND_MM))
    inner = width - 2 * _MARGIN_MM
    top, low = _MARGIN_MM + title_mm, height - _MARGIN_MM - credits_mm
    map_mm = inner - legend_mm
    bounds = _with_ratio(crs.bounds, map_mm / (low - top))
    unit_m = _METRES_PER_DEGREE if crs.is_lonlat else 1.0
    boxes = {
        "page": (0.0, 0.0, width, height),
        "map": (_MARGIN_MM, top, map_mm, low - top),
        "title": (_MARGIN_MM, _MARGIN_MM, inner, title_mm),
        "credits": (_MARGIN_MM, low + 2, inner, credits_mm),
        "legend": (_MARGIN_MM + map_mm + 2, top, 0.0, 0.0),
        "map scale": (_MARGIN_MM + 3, low - 16, 60.0, 13.0),
    }
    miles = nice_step((bounds[2] - bounds[0]) * unit_m * _BAR_SHARE / _NAUTICAL_MILE_M)
    return Page(name, scale, boxes, bounds, miles)


def _with_ratio(bounds: Bounds, ratio: float) -> Bounds:
    """Bounds grown about their middle to a ratio of width to height."""
    xmin, ymin, xmax, ymax = bounds
    width, height = max(xmax - xmin, ratio * (ymax - ymin)), max(ymax - ymin, (xmax - xmin) / ratio)
    x, y = (xmin + xmax) / 2, (ymin + ymax) / 2
    return x - width / 2, y - height / 2, x + width / 2, y + height / 2
