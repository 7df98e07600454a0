"""The documents' pictures: small, shown, and up to date with the code."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image

from pipeline.loading import load_scenario
from pipeline.run import planned_scenario
from tests.conftest import ROOT
from tests.pipeline.formats.figures.__main__ import DOCS, PICTURES

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pipeline.formats.shared.result import RunResult

MAX_BYTES = 300_000


def test_the_pictures_exist_and_are_small() -> None:
    assert {path.stem for path in DOCS.glob("*.png")} == set(PICTURES)
    for path in DOCS.glob("*.png"):
        assert path.stat().st_size < MAX_BYTES
        with Image.open(path) as picture:
            picture.verify()


def test_the_readme_shows_and_describes_every_picture() -> None:
    text = (ROOT / "README.md").read_text("utf-8")
    shown = re.findall(r"!\[([^\]]*)\]\(([^)\s]+)\)", text)
    assert {link for _, link in shown} == {f"docs/{name}.png" for name in PICTURES}
    assert all(len(text) > 20 for text, _ in shown)


@pytest.fixture(scope="module")
def gyre(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunResult]:
    folder = tmp_path_factory.mktemp("gyre")
    with planned_scenario(load_scenario("single-gyre"), folder, offline=True) as result:
        yield result


@pytest.mark.parametrize(
    "name", [name for name, (scenario, _, _) in PICTURES.items() if scenario == "single-gyre"]
)
def test_the_gyres_pictures_are_up_to_date(name: str, gyre: RunResult) -> None:
    """If not, draw them again: `python -m tests.pipeline.formats.figures`."""
    _, dpi, drawing = PICTURES[name]
    file = io.BytesIO()
    drawing(gyre).savefig(file, format="png", dpi=dpi)
    now = imread(io.BytesIO(file.getvalue()))[..., :3]
    published = imread(DOCS / f"{name}.png")[..., :3]
    assert published.shape == now.shape
    assert (np.abs(published - now).max(axis=-1) > 0.2).mean() < 0.01
