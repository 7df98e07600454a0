"""The documents' pictures: small, used, and what the code draws."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image

from pipeline.loading import load_scenario
from pipeline.run import planned
from tests.conftest import ROOT
from tests.pipeline.formats.figures.__main__ import DOCS, PICTURES

if TYPE_CHECKING:
    from pipeline.formats.shared.result import RunResult

MOST_BYTES = 300_000


def test_the_pictures_are_there_and_small_and_no_others() -> None:
    assert {path.stem for path in DOCS.glob("*.png")} == set(PICTURES)
    for path in DOCS.glob("*.png"):
        assert path.stat().st_size < MOST_BYTES
        with Image.open(path) as picture:
            picture.verify()


def test_the_readme_shows_every_picture_and_says_what_is_to_be_seen() -> None:
    text = (ROOT / "README.md").read_text("utf-8")
    shown = re.findall(r"!\[([^\]]*)\]\(([^)\s]+)\)", text)
    assert {link for _, link in shown} == {f"docs/{name}.png" for name in PICTURES}
    assert all(len(words) > 20 for words, _ in shown)


@pytest.fixture(scope="module")
def gyre(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    return planned(load_scenario("single-gyre"), tmp_path_factory.mktemp("gyre"), offline=True)


@pytest.mark.parametrize(
    "name", [name for name, (scenario, _, _) in PICTURES.items() if scenario == "single-gyre"]
)
def test_the_published_gyres_pictures_are_what_is_drawn_now(name: str, gyre: RunResult) -> None:
    """If not, make them anew: `python -m tests.pipeline.formats.figures`."""
    _, dpi, drawing = PICTURES[name]
    file = io.BytesIO()
    drawing(gyre).savefig(file, format="png", dpi=dpi)
    now = imread(io.BytesIO(file.getvalue()))[..., :3]
    kept = imread(DOCS / f"{name}.png")[..., :3]
    assert kept.shape == now.shape
    assert (np.abs(kept - now).max(axis=-1) > 0.2).mean() < 0.01
