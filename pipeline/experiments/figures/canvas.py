"""A map of an environment in metres: land, current, paths."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from pipeline.formats.figures.palette import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    import renew
    from renew._types import FloatArray

# Number of arrows of the current along a side.
_ARROWS = 22
# Labels of paths with Okabe and Ito's colours and dashes, so that colour is not all that tells.
_COLOURS = ("#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8b5a2b", "#444444")
_DASHES = ("-", "--", "-.", ":")


def draw_environment(
    axes: Axes, chart: renew.Chart, current: renew.CurrentField, title: str
) -> None:
    """Water, current and land, with equal scales."""
    xmin, ymin, xmax, ymax = chart.bounds
    axes.set_facecolor(COLOURS["water"])
    x, y = (np.linspace(low, high, _ARROWS + 2)[1:-1] for low, high in ((xmin, xmax), (ymin, ymax)))
    points = np.stack(np.meshgrid(x, y), axis=-1)
    velocity = current(points)
    axes.quiver(
        points[..., 0], points[..., 1], velocity[..., 0], velocity[..., 1],
        color=COLOURS["speed1"], width=0.003, zorder=1,
    )  # fmt: skip
    draw_area(axes, shapely.MultiPolygon(chart.no_go), COLOURS["land"], COLOURS["coast"])
    axes.set(xlim=(xmin, xmax), ylim=(ymin, ymax), aspect="equal", xlabel="x (m)", ylabel="y (m)")
    axes.set_title(title, fontsize=10, loc="left")


def draw_area(
    axes: Axes,
    area: shapely.geometry.base.BaseGeometry,
    face: str,
    edge: str,
    opacity: float = 1.0,
) -> None:
    """Fill polygons, with their holes."""
    for polygon in shapely.get_parts(area):
        rings = [polygon.exterior, *polygon.interiors]
        outline = Outline.make_compound_path(
            *(Outline(np.asarray(ring.coords), closed=True) for ring in rings)
        )
        axes.add_patch(
            PathPatch(outline, facecolor=face, edgecolor=edge, lw=0.6, alpha=opacity, zorder=2)
        )


def draw_path(axes: Axes, path: FloatArray, label: str, number: int | None) -> None:
    """Draw a planner's path; ours, without a number, stands out."""
    if number is None:
        axes.plot(*path.T, color=COLOURS["best"], lw=2.6, label=label, zorder=5)
        return
    colour = _COLOURS[number % len(_COLOURS)]
    dash = _DASHES[number // len(_COLOURS) % len(_DASHES)]
    axes.plot(*path.T, color=colour, ls=dash, lw=1.1, label=label, zorder=4)


def mark_ends(axes: Axes, start: FloatArray, goal: FloatArray) -> None:
    """Mark start and goal."""
    for point, mark, label in ((start, "o", "start"), (goal, "s", "goal")):
        axes.plot(*point, mark, color=COLOURS["ink"], ms=5, zorder=6, label=f"_{label}")
        axes.annotate(
            label,
            (float(point[0]), float(point[1])),
            xytext=(5, -10),
            textcoords="offset points",
            fontsize=8,
        )
