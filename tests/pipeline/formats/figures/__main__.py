"""Draw the documents' pictures in docs/pictures/: `python -m tests.pipeline.formats.figures`."""

from __future__ import annotations

import io
import sys
from typing import TYPE_CHECKING

from PIL import Image

from pipeline.formats.figures.kinds import Kind, figure
from pipeline.formats.figures.maps.season_map import overview_figure
from pipeline.loading import load_scenario
from pipeline.run import planned_scenario
from tests.conftest import ROOT

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from matplotlib.figure import Figure

    from pipeline.formats.shared.result import RunResult

PICTURES_FOLDER = ROOT / "docs" / "pictures"
# Number of colours: more look the same and take twice the space.
_COLOURS = 256

PICTURES: dict[str, tuple[str, int, Callable[[RunResult], Figure]]] = {
    "palawan-season": ("palawan-season", 160, overview_figure),
    "palawan-winter-along": (
        "palawan-season",
        160,
        lambda result: figure(result, "winter", Kind.ALONG),
    ),
    **{
        f"single-gyre-{kind.value}": (
            "single-gyre",
            dpi,
            lambda result, kind=kind: figure(result, "gyre", kind),  # type: ignore[misc]
        )
        for kind, dpi in ((Kind.MESH, 130), (Kind.CHANNELS, 100), (Kind.PADDING, 130))
    },
}
"""Name -> scenario, dots per inch, and what to draw of its result."""


def draw(output: Path) -> None:
    """Draw all pictures, from results in an output folder, where missing ones are planned."""
    scenarios = {scenario for scenario, _, _ in PICTURES.values()}
    results = {}
    for name in sorted(scenarios):
        with planned_scenario(load_scenario(name), output, offline=True) as result:
            results[name] = result
    for name, (scenario, dpi, drawing) in PICTURES.items():
        drawn = io.BytesIO()
        drawing(results[scenario]).savefig(drawn, format="png", dpi=dpi)
        few = Image.open(drawn).convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE)
        few.save(PICTURES_FOLDER / f"{name}.png", optimize=True)
        sys.stdout.write(f"docs/pictures/{name}.png\n")


if __name__ == "__main__":
    draw(ROOT / "outputs")
