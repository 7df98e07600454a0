"""Where a chart has depths, texts for readers don't call all that is no-go land."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
import shapely
from matplotlib.text import Text

from pipeline.cli.answer import answer
from pipeline.findings.note_words import note_texts
from pipeline.findings.result import RunResult
from pipeline.formats.figures.kinds import Kind, figure
from pipeline.formats.passage.routes import write_gpx
from pipeline.formats.report.page import gather, render
from pipeline.geo.projection import DepthCover
from pipeline.run import Outcome
from pipeline.stages.compare import safety_notes
from tests.pipeline.formats import small_run
from tests.pipeline.formats.page import Page
from tests.pipeline.results import rows_of, with_measures, with_rows

WORD = re.compile(r"\bland\b", re.IGNORECASE)


def charted(result: RunResult) -> RunResult:
    """The same run on a chart with depths, and with turns that met what is no-go."""
    result = with_rows(result, lambda _, row: replace(row, uncharted_share=0.0, collisions=1))
    for case in result.cases:
        turns = tuple(replace(one, collided=one.collided | True) for one in case.measures.turns)
        result = with_measures(result, case.name, turns=turns)
    fetched = small_run.with_zones(result).fetched
    return replace(
        result, fetched=replace(fetched, land=replace(fetched.land, depths=DepthCover()))
    )


@pytest.fixture(scope="module")
def with_depths() -> RunResult:
    return charted(small_run.parts())


def said(texts: list[str]) -> list[str]:
    """Texts that speak of land, except the name of the test's source and the legend of land."""
    own = [text.replace(small_run.LAND.name, "").replace(small_run.LAND.url, "") for text in texts]
    return [text for text in own if WORD.search(text) and text.strip() not in {"land", "Land"}]


def terminal(result: RunResult, folder: Path) -> str:
    outcome = Outcome(result, folder, fresh=True, seconds=1.0)
    return answer(outcome, verbose=True) + outcome._repr_html_()


def test_the_report_explains_no_go_areas_once(with_depths: RunResult) -> None:
    html = re.sub(r"(?s)<(script|style).*?</\1>", "", render(gather(with_depths)))
    elements = Page(html).elements
    leaves = [element.flat_text for element in elements if not element.children]
    labels = [element.attributes.get("aria-label", "") for element in elements]
    (explained,) = said([*leaves, *labels])
    assert explained.startswith("Land, hazards with room around them, and water that is charted")
    text = " ".join(leaves)
    assert "simulated hard-over turns met no-go areas" in " ".join(html.split())
    assert "Distance to no-go areas" in text


def test_the_terminal_speaks_of_no_go_areas(with_depths: RunResult, tmp_path: Path) -> None:
    text = terminal(with_depths, tmp_path)
    assert not said(text.splitlines())
    assert "clear of no-go areas</th>" in text
    assert all("met no-go areas" in note for note in note_texts(safety_notes(with_depths)))


def test_plotters_speak_of_no_go_areas(with_depths: RunResult, tmp_path: Path) -> None:
    season = with_depths.results[0].name
    write_gpx(with_depths.case(season), tmp_path / "a.gpx")
    text = (tmp_path / "a.gpx").read_text("utf-8").replace(small_run.LAND.text, "")
    assert not said(re.findall(r">([^<]+)<", text))
    assert "or more from no-go areas" in text


@pytest.mark.parametrize("kind", Kind)
def test_figures_speak_of_no_go_areas(with_depths: RunResult, kind: Kind) -> None:
    drawn = figure(with_depths.case(with_depths.results[0].name), kind)
    assert not said([text.get_text() for text in drawn.findobj(Text)])


def test_a_chart_of_land_speaks_of_land(result: RunResult, tmp_path: Path) -> None:
    assert "Distance to land" in render(gather(result))
    assert "clear of land</th>" in terminal(result, tmp_path)
    assert result.land_label == "land"


def test_uncharted_water_in_the_chart_is_not_called_land(with_depths: RunResult) -> None:
    land = with_depths.fetched.land

    def label(area: shapely.Polygon) -> str:
        zone = replace(land.zones[0], kind="uncharted", area=area)
        fetched = replace(with_depths.fetched, land=replace(land, zones=(zone,)))
        return replace(with_depths, fetched=fetched).land_label

    west, south, east, north = with_depths.scenario.area.bounds
    assert label(shapely.box(west - 1, south, west + 0.1, north)) == "land or uncharted"
    assert label(shapely.box(east + 0.1, south, east + 1, north)) == "land"


def test_the_table_gives_the_fuel_of_other_sides_beside_the_best(tmp_path: Path) -> None:
    result = small_run.parts()
    rows = rows_of(result)
    of_best = next(row for row in rows if row.rank == 1)
    has_sides = any(row.main_passage != of_best.main_passage for row in rows)

    def told(more: float) -> str:
        dear = with_rows(
            result, lambda _, row: replace(row, fuel=1e7 * (1 + more * (row.rank > 1)))
        )
        return answer(Outcome(dear, tmp_path, fresh=True, seconds=1.0))

    assert has_sides
    assert "+10.0 %" in told(0.1)
    assert "dearer" not in told(0.1)
    assert "+30.0 %" not in told(0.3)
    assert "more, at least 25% dearer" in told(0.3)
