"""What is embedded in the page, so that it loads nothing: scripts, style sheets, encoded data.

A coast of 50,000 vertices then takes half a megabyte of JSON, decoded in milliseconds.
"""

import base64
import hashlib
import json
import math
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Self

import numpy as np
import shapely

from pipeline._types import FloatArray, Geometries, IntArray
from pipeline.formats.shared.palette import COLOURS, DARK, SEASON_COLOURS, SEASON_COLOURS_ON_DARK
from pipeline.formats.shared.result import RunResult

_HERE = Path(__file__).parent
_LEAFLET = _HERE / "vendor" / "leaflet"
# In the order of their dependencies.
_SCRIPTS = (
    *("data", "text", "units", "currents", "particles", "probe"),
    *("map", "voyage", "strip", "report"),
)
# A rule that would fetch an image, for Leaflet's markers and layer button: the page uses neither.
_FETCHING_RULE = re.compile(r"[^{}]*\{[^{}]*url\([^{}]*\}")


@cache
def script() -> str:
    """Leaflet, then our own files in one scope."""
    leaflet = (_LEAFLET / "leaflet.js").read_text(encoding="utf-8")
    own = "\n".join(
        (_HERE / "scripts" / f"{name}.js").read_text(encoding="utf-8") for name in _SCRIPTS
    )
    return f'\n{leaflet}\n(() => {{\n"use strict";\n{own}\n}})();\n'


def style_colours() -> dict[str, object]:
    """Colours by the names that `report.css` takes them by."""
    return {
        "light": COLOURS,
        "dark": DARK,
        "seasons_on_light": SEASON_COLOURS,
        "seasons_on_dark": SEASON_COLOURS_ON_DARK,
    }


@cache
def leaflet_style() -> str:
    """Leaflet's style sheet without the rules that fetch images."""
    return _FETCHING_RULE.sub("", (_LEAFLET / "leaflet.css").read_text(encoding="utf-8"))


def content_hash(text: str) -> str:
    """Hash of a script as in a Content-Security-Policy: `sha256-…`."""
    digest = hashlib.sha256(text.encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"


# Minimum steps along a chart's longer side; at most ten times as many: 1 m each on 700 km.
_MIN_STEPS = 2e5
# Number of steps in a series' range; more are not needed, as a fifth digit is never shown.
_SERIES_STEPS = 50_000

# Number of cells along each side of the chart, at whose corners positions are given: between them
# they are interpolated, on 30 degrees to within 0.01 minute.
_CELLS = 40
# Unit of the positions, degrees: a thousandth of a minute.
_UNIT_DEG = 1 / 60_000


@dataclass(frozen=True)
class Lattice:
    """Coordinates as whole steps from the chart's lower left corner.

    `origin` (2,) and `step` are in planar metres; `step_m` is the step in metres at true scale, a
    power of ten.
    """

    origin: FloatArray
    step: float
    step_m: float

    @classmethod
    def of(cls, bounds: tuple[float, float, float, float], scale: float) -> Self:
        """Choose the step for a chart's bounds (planar metres) at a scale."""
        xmin, ymin, xmax, ymax = bounds
        side_m = max(xmax - xmin, ymax - ymin) * scale
        step_m = 10.0 ** math.floor(math.log10(side_m / _MIN_STEPS))
        return cls(np.array([xmin, ymin]), step_m / scale, step_m)

    def to_steps(self, points: FloatArray) -> IntArray:
        """Round planar points (n, 2) to whole steps (n, 2)."""
        return np.rint((points - self.origin) / self.step).astype(np.int64)

    def line(self, points: FloatArray) -> list[int]:
        """Flat x, y, dx, dy, …: the first point, then the moves between points; no zero moves."""
        moves = np.diff(self.to_steps(points), axis=0, prepend=0)
        keep = np.asarray(moves.any(axis=1))
        keep[:1] = True
        return moves[keep].ravel().tolist()

    def rings(self, areas: Geometries) -> list[list[int]]:
        """Every ring of polygonal geometries (n,); outer rings anticlockwise, holes clockwise.

        Rings are not closed by repeating the first point; those smaller than a step are dropped.
        """
        polygons = shapely.orient_polygons(shapely.get_parts(areas))
        is_polygon = shapely.get_type_id(polygons) == shapely.GeometryType.POLYGON
        rings = shapely.get_rings(polygons[is_polygon])
        lines = (self.line(shapely.get_coordinates(ring)[:-1]) for ring in rings)
        return [line for line in lines if len(line) >= 6]


def series(values: FloatArray) -> dict[str, object]:
    """Values (n,) as `{"step": s, "moves": [...]}`; moves are None if any value is infinite.

    The last value is exact unless it is small beside the others.
    """
    if not np.isfinite(values).all():
        return {"step": 1.0, "moves": None}
    reach = float(np.abs(values).max(initial=0.0))
    last = abs(float(values[-1])) if len(values) else 0.0
    # The last value is a whole number of steps, so fuel and time end at the route's own figures.
    step = (last if last > 0.1 * reach else reach) / _SERIES_STEPS or 1.0
    moves = np.diff(np.rint(values / step).astype(np.int64), prepend=0)
    return {"step": step, "moves": moves.tolist()}


def within(areas: Geometries, extent: shapely.Polygon) -> Geometries:
    """Clip geometries (n,) to the extent; those inside stay unchanged."""
    shapely.prepare(extent)
    areas = areas[shapely.intersects(extent, areas)]
    outside = ~shapely.covers(extent, areas)
    clipped = areas.copy()
    clipped[outside] = shapely.intersection(areas[outside], extent)
    return clipped


def coarser(areas: Geometries, tolerance: float, max_vertices: int) -> Geometries:
    """Simplify geometries (n,) with a growing tolerance until they have at most `max_vertices`.

    Islets smaller than the tolerance become empty. There are at most twenty rounds.
    """
    for _ in range(20):
        excess = shapely.get_num_coordinates(areas).sum() / max_vertices
        if excess <= 1:
            break
        west, south, east, north = shapely.bounds(areas).T
        visible = np.maximum(east - west, north - south) >= tolerance
        areas = np.where(visible, shapely.simplify(areas, tolerance), shapely.Polygon())
        # A round visits all vertices: a larger factor takes fewer rounds where they are many.
        tolerance *= 4 if excess > 8 else 2
    return areas


def json_for_script(data: object) -> str:
    """JSON for a `<script>` element, without any `<` that could end it or open a comment."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def place_on_map(result: RunResult, place: FloatArray) -> str:
    """A place (2,) of the plane for a button: "x,y", in true metres from the lower left corner."""
    xmin, ymin, _, _ = result.scene.chart.bounds
    x, y = (np.asarray(place) - [xmin, ymin]) * result.scene.projection.scale
    return f"{x:.0f},{y:.0f}" if max(abs(x), abs(y)) >= 1e4 else f"{x:.6g},{y:.6g}"


def positions(result: RunResult, lattice: Lattice) -> dict[str, object] | None:
    """Longitudes and latitudes at the corners of a grid over the chart; None in a plane.

    Row by row from below, each in units of a thousandth of a minute as the difference to the value
    before. Longitudes run on beyond 180 degrees.
    """
    if result.scenario.is_planar:
        return None
    xmin, ymin, xmax, ymax = result.scene.chart.bounds
    x, y = np.linspace(xmin, xmax, _CELLS + 1), np.linspace(ymin, ymax, _CELLS + 1)
    corners = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    lon, lat = result.scene.projection.to_lonlat(corners).T
    lon = np.degrees(np.unwrap(np.radians(lon).reshape(len(y), len(x)), axis=1))
    lon = np.degrees(np.unwrap(np.radians(lon), axis=0)).ravel()
    whole = np.rint(np.stack([lon, lat]) / _UNIT_DEG).astype(np.int64)
    return {
        "cells": _CELLS,
        "unit": _UNIT_DEG,
        "size": [(xmax - xmin) / lattice.step, (ymax - ymin) / lattice.step],
        "lon": np.diff(whole[0], prepend=0).tolist(),
        "lat": np.diff(whole[1], prepend=0).tolist(),
    }
