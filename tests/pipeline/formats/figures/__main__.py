"""Draw the documents' pictures: `python -m tests.pipeline.formats.figures [CHARTS]`."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from PIL import Image

from experiments.figures import method
from pipeline.findings.result import RunResult
from pipeline.formats.figures.kinds import Kind, figure
from pipeline.formats.figures.season_map import overview_figure
from pipeline.run import planned_scenario
from pipeline.scenario.loading import load_scenario
from tests.conftest import ROOT
from tests.validators import chromium

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURES_FOLDER = ROOT / "docs" / "pictures"
# Scenarios on NOAA's cell US5BOSCD.
BOSTON, BOSTON_TIDE = "boston-enc", "boston-tide"
# Time in which the currents of a report's map have begun to drift, ms.
_DRIFTING_MS = 3000
# Number of colours: more look the same and take twice the space.
_COLOURS = 256


class Picture(NamedTuple):
    """What is drawn of a scenario's result: planned with these `currents`, or with its own."""

    scenario: str
    draw: Callable[[RunResult], Figure]
    dpi: int
    currents: str | None = None


def of_season(season: str, kind: Kind) -> Callable[[RunResult], Figure]:
    """One kind of figure of one season."""
    return lambda result: figure(result.case(season), kind)


PICTURES = {
    "palawan-season": Picture("palawan-season", lambda result: overview_figure(result.cases), 160),
    "palawan-winter-along": Picture("palawan-season", of_season("winter", Kind.ALONG), 160),
    "single-gyre-mesh": Picture("single-gyre", partial(method.mesh, season="gyre"), 130),
    "single-gyre-channels": Picture("single-gyre", partial(method.channels, season="gyre"), 100),
    "single-gyre-padding": Picture("single-gyre", partial(method.padding, season="gyre"), 130),
    "palawan-usv": Picture("palawan-usv", of_season("winter", Kind.ROUTES), 130),
    "hansando": Picture("hansando", of_season("winter", Kind.ROUTES), 130),
    "far-east": Picture("far-east", of_season("winter", Kind.ROUTES), 130),
    BOSTON: Picture(BOSTON, of_season("winter", Kind.ROUTES), 130, "still"),
    BOSTON_TIDE: Picture(BOSTON_TIDE, of_season("springs", Kind.ALONG), 130),
}
# Figures of the experiments, if `outputs` holds a whole run of them.
EXPERIMENTS = {
    f"experiments-{name}": name
    for name in ("single-gyre-planners", "four-gyre-planners", "fuel-against-seconds")
}


def draw(output: Path, charts: Path | None) -> None:
    """Draw all pictures, from results in an output folder, where missing ones are planned.

    Without the folder of charts that holds NOAA's cell US5BOSCD those of Boston stay as they are.
    """
    for name, picture in PICTURES.items():
        needs_charts = picture.scenario in {BOSTON, BOSTON_TIDE}
        if needs_charts and charts is None:
            continue
        scenario = load_scenario(
            picture.scenario,
            charts=[{"path": str(charts)}] if needs_charts else (),
            currents=(picture.currents,) if picture.currents else (),
        )
        with planned_scenario(scenario, output, offline=True) as result:
            drawn = io.BytesIO()
            picture.draw(result).savefig(drawn, format="png", dpi=picture.dpi)
            save(Image.open(drawn), name)
    photograph(output / "palawan-season" / "report.html")
    for name, drawing in EXPERIMENTS.items():
        file = output / "experiments" / f"{drawing}.png"
        if file.is_file():
            save(Image.open(file), name)


def photograph(page: Path) -> None:
    """Save what a report shows first, its answer and its map, if it is there and Chromium is."""
    with chromium() as browser:
        if browser is None or not page.is_file():
            return
        tab = browser.new_page(viewport={"width": 1400, "height": 900})
        tab.goto(page.resolve().as_uri())
        tab.wait_for_timeout(_DRIFTING_MS)
        save(Image.open(io.BytesIO(tab.screenshot())), "report")


def save(image: Image.Image, name: str) -> None:
    """Save a picture in few colours."""
    few = image.convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE)
    few.save(PICTURES_FOLDER / f"{name}.png", optimize=True)
    sys.stdout.write(f"docs/pictures/{name}.png\n")


if __name__ == "__main__":
    draw(ROOT / "outputs", Path(sys.argv[1]) if len(sys.argv) > 1 else None)
