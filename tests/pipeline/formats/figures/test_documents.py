"""The documents' pictures: small, shown, and up to date with the code."""

import io
import re
from collections.abc import Iterator

import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image

from pipeline.findings.result import RunResult
from pipeline.run import planned_scenario
from pipeline.scenario.loading import load_scenario
from tests.conftest import ROOT
from tests.pipeline.formats.figures.__main__ import EXPERIMENTS, PICTURES, PICTURES_FOLDER

MAX_BYTES = 300_000
NAMES = {*PICTURES, *EXPERIMENTS, "report"}


def test_the_pictures_exist_and_are_small() -> None:
    assert {path.stem for path in PICTURES_FOLDER.glob("*.png")} == NAMES
    for path in PICTURES_FOLDER.glob("*.png"):
        assert path.stat().st_size < MAX_BYTES
        with Image.open(path) as picture:
            picture.verify()


def test_every_picture_is_shown_and_described() -> None:
    shown = [
        ((page.parent / link).resolve(), text)
        for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md"))
        for text, link in re.findall(r"!\[([^\]]*)\]\(([^)\s]+)\)", page.read_text("utf-8"))
    ]
    assert {PICTURES_FOLDER / f"{name}.png" for name in NAMES} <= {path for path, _ in shown}
    assert [path for path, text in shown if len(text) <= 20] == []


@pytest.fixture(scope="module")
def gyre(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunResult]:
    folder = tmp_path_factory.mktemp("gyre")
    with planned_scenario(load_scenario("single-gyre"), folder, offline=True) as result:
        yield result


@pytest.mark.gate_share(1)
@pytest.mark.parametrize(
    "name", [name for name, one in PICTURES.items() if one.scenario == "single-gyre"]
)
def test_the_gyres_pictures_are_up_to_date(name: str, gyre: RunResult) -> None:
    """If not, draw them again: `python -m tests.pipeline.formats.figures`."""
    picture = PICTURES[name]
    file = io.BytesIO()
    picture.draw(gyre).savefig(file, format="png", dpi=picture.dpi)
    now = imread(io.BytesIO(file.getvalue()))[..., :3]
    published = imread(PICTURES_FOLDER / f"{name}.png")[..., :3]
    assert published.shape == now.shape
    assert (np.abs(published - now).max(axis=-1) > 0.2).mean() < 0.01
