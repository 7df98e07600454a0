"""A plan as HTML for a notebook: an inline SVG map and a table, without a plotting library."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from renew._types import FloatArray

# Width of the map, CSS pixels; its height follows, up to twice as much.
_WIDTH = 420.0
# Colours of the routes, best first (Okabe and Ito: told apart by colour-blind readers, too).
_COLOURS = ("#d55e00", "#0072b2", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
# Number of routes that are drawn and listed.
_MAX_ROUTES = len(_COLOURS)


@dataclass(frozen=True)
class Line:
    """A route as it is drawn: path (n, 2) m, its triangles (t, 3, 2) m, and a row of the table."""

    path: FloatArray
    channel: FloatArray
    cells: tuple[str, ...]


def plan_html(
    lines: Sequence[Line], chosen: int, soft_no_go: BaseGeometry, header: Sequence[str]
) -> str:
    """Return a map of routes over their channels, and their figures; best first, six at most.

    `soft_no_go` is that of the chosen route, m.
    """
    shown = list(lines[:_MAX_ROUTES])
    points = np.concatenate(
        [line.path for line in shown] + [x.channel.reshape(-1, 2) for x in shown]
    )
    low, high = points.min(axis=0), points.max(axis=0)
    scale = _WIDTH / max(high[0] - low[0], (high[1] - low[1]) / 2, 1e-9)
    width, height = ((high - low) * scale).tolist()

    def place(xy: FloatArray) -> str:
        pixels = np.stack([(xy[:, 0] - low[0]) * scale, (high[1] - xy[:, 1]) * scale], axis=1)
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in pixels)

    water = [
        f'<polygon points="{place(triangle)}"/>' for line in shown for triangle in line.channel
    ]
    zones = [
        f'<polygon points="{place(np.asarray(part.exterior.coords))}"/>'
        for part in shapely.get_parts(soft_no_go)
        if part.geom_type == "Polygon"
    ]
    routes = [
        f'<polyline points="{place(line.path)}" stroke="{_COLOURS[rank]}" '
        f'stroke-width="{3 if rank == chosen else 1.5}"/>'
        for rank, line in reversed(list(enumerate(shown)))
    ]
    ends = [
        f'<circle cx="{xy.split(",")[0]}" cy="{xy.split(",")[1]}" r="4"/>'
        for xy in (place(shown[0].path[[0]]), place(shown[0].path[[-1]]))
    ]
    rows = [
        f'<tr><td><span style="color:{_COLOURS[rank]}" aria-hidden="true">━</span> {rank + 1}</td>'
        + "".join(f"<td>{escape(cell)}</td>" for cell in line.cells)
        + "</tr>"
        for rank, line in enumerate(shown)
    ]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" width="{width:.0f}" '
        f'height="{height:.0f}" viewBox="-6 -6 {width + 12:.1f} {height + 12:.1f}" '
        'style="max-width:100%;height:auto;background:#fff">'
        f"<title>{len(shown)} routes, the best as the thickest line</title>"
        f'<g fill="#e3eff8" stroke="#c4d9e8" stroke-width="0.5">{"".join(water)}</g>'
        f'<g fill="#f2b134" fill-opacity="0.45">{"".join(zones)}</g>'
        f'<g fill="none" stroke-linejoin="round">{"".join(routes)}</g>'
        f'<g fill="#222">{"".join(ends)}</g></svg>'
        f"<table><thead><tr>{''.join(f'<th>{escape(text)}</th>' for text in ('', *header))}</tr>"
        f"</thead><tbody>{''.join(rows)}</tbody></table>"
    )
