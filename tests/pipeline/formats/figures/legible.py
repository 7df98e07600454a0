"""What holds for every figure: texts keep apart, nothing is cut, land has its colour."""

from __future__ import annotations

import io
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.image import imread
from matplotlib.text import Text

from pipeline.formats.appearance import COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def assert_texts_apart(drawn: Figure) -> None:
    """Fail where texts of a figure overlap or leave it."""
    canvas = FigureCanvasAgg(drawn)
    drawn.draw(canvas.get_renderer())  # type: ignore[no-untyped-call]
    axes = [axis for panel in drawn.axes for axis in (panel.xaxis, panel.yaxis)]
    unseen = {
        tick.label1
        for axis in axes
        for tick in axis.get_major_ticks()
        if not min(axis.get_view_interval()) <= tick.get_loc() <= max(axis.get_view_interval())
    }
    boxes = [
        (text.get_text(), text.get_window_extent())
        for text in drawn.findobj(Text)
        if text.get_text() and text.get_visible() and text not in unseen
    ]
    for text, box in boxes:
        assert box.x0 >= -1, text
        assert box.x1 <= drawn.bbox.width + 1, text
        assert box.y0 >= -1, text
        assert box.y1 <= drawn.bbox.height + 1, text
    for (text, box), (other_text, other) in combinations(boxes, 2):
        apart = (
            box.x1 <= other.x0 + 1
            or other.x1 <= box.x0 + 1
            or box.y1 <= other.y0 + 1
            or other.y1 <= box.y0 + 1
        )
        assert apart, f"{text!r} overlaps {other_text!r}"


def ink_at_the_edge(drawn: Figure) -> float:
    """Share of the outermost pixels that are not the background."""
    canvas = FigureCanvasAgg(drawn)
    drawn.set_dpi(150)
    canvas.draw()  # type: ignore[no-untyped-call]
    pixels = canvas.buffer_rgba()  # type: ignore[no-untyped-call]
    seen = np.asarray(pixels)[..., :3].astype(int)
    edge = np.concatenate([seen[0], seen[-1], seen[:, 0], seen[:, -1]])
    return float((np.abs(edge - edge[0]).max(axis=1) > 8).mean())


def is_land(drawn: Figure, place: tuple[float, float]) -> bool:
    """Whether a place of the first map has the colour of land."""
    file = io.BytesIO()
    drawn.savefig(file, format="png", dpi=100)
    pixels = imread(io.BytesIO(file.getvalue()))[..., :3]
    # transData counts from below, in dots of the figure's own resolution.
    x, y = drawn.axes[0].transData.transform(place) * 100 / drawn.dpi
    return to_hex(tuple(pixels[len(pixels) - 1 - int(y), int(x)])) == COLOURS["land"]
