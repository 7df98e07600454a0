"""Numbers or names on the islands that tell ways apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pipeline.formats.figures.artists import SMALL_PT, drawable
from pipeline.formats.figures.palette import COLOURS
from pipeline.formats.shared.result import RunResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Length of the longest name, in characters, that is drawn whole.
_MAX_LENGTH = 24


def draw_island_labels(axes: Axes, result: RunResult) -> None:
    """Write each island's number or name on it, on a halo, below the routes' ends."""
    from matplotlib.patheffects import withStroke

    for island in result.evaluation.islands:
        axes.text(
            island.x,
            island.y,
            drawable(island.label, _MAX_LENGTH),
            ha="center",
            va="center",
            fontsize=SMALL_PT,
            fontweight="bold",
            color=COLOURS["ink"],
            zorder=7.8,
            parse_math=False,
            path_effects=[withStroke(linewidth=2.2, foreground=COLOURS["halo"])],
        )
