"""Environments: charts with as few vertices as the paper's, and the side that a path passes on."""

import re

import numpy as np
import pytest
import shapely

import renew
from experiments.environments.coarse import coarse, vertices
from experiments.environments.loading import Environment, load_environment, load_spec, names
from pipeline.errors import RequestError
from pipeline.machine.store import Store
from tests.conftest import ROOT

CORNERS = 4
ENDS = np.array([[1.0, 1.0], [99.0, 99.0]])


def disc(x: float, y: float, radius: float) -> shapely.Polygon:
    return shapely.Point(x, y).buffer(radius, quad_segs=32)


def test_vertices_are_those_of_islands_and_of_the_extents_corners() -> None:
    chart = renew.Chart(shapely.box(0, 0, 100, 100), [shapely.box(40, 30, 60, 70)])
    assert vertices(chart) == CORNERS + 4


@pytest.mark.parametrize("most", [60, 30, 10])
def test_a_coarse_chart_has_few_vertices_and_its_large_islands(most: int) -> None:
    land = [disc(50, 50, 20), disc(80, 20, 0.5)]
    chart = coarse(renew.Chart(shapely.box(0, 0, 100, 100), land), land, most, ENDS)
    assert most / 2 - CORNERS <= vertices(chart) <= most
    # Inscribed regular polygons of n corners have n sin(2 pi / n) / (2 pi) of a circle's area.
    assert chart.hard_no_go.area == pytest.approx(np.pi * 20**2, rel=0.4)
    assert chart.hard_no_go.contains(shapely.Point(50, 50))


def test_no_coarse_chart_leaves_an_end_on_land() -> None:
    land = [shapely.box(0, 0, 50, 50)]
    with pytest.raises(RequestError, match="both ends in the water"):
        coarse(renew.Chart(shapely.box(0, 0, 100, 100), land), land, 20, ENDS)


@pytest.fixture(scope="module")
def palawan(tmp_path_factory: pytest.TempPathFactory) -> Environment:
    store = Store(tmp_path_factory.mktemp("store"))
    return load_environment(load_spec("palawan-as-published"), store)


# Through the South China Sea, and through the Sulu Sea, as a map shows them.
@pytest.mark.parametrize(
    ("abeam", "side"), [((117.0, 10.5), "west"), ((118.0, 9.9), "west"), ((120.2, 9.3), "east")]
)
def test_the_side_on_which_a_path_passes(
    palawan: Environment, abeam: tuple[float, float], side: str
) -> None:
    lonlat = np.array([palawan.result.scenario.start, abeam, palawan.result.scenario.goal])
    assert palawan.side(palawan.result.water.projection.to_plane(lonlat)) == side


@pytest.mark.slow
def test_at_the_papers_scale_the_side_flips_on_a_chart_of_its_size_only(
    palawan: Environment,
) -> None:
    """What README, paper map and claims say; the figures are in docs/figures/sides.csv."""
    found = {}
    for case in palawan.spec.cases:
        voyage = palawan.voyage(case)
        assert case.vertices is None or vertices(voyage.chart) <= case.vertices
        ends, options = (voyage.start, voyage.goal), palawan.options(case)
        plan = renew.plan(voyage.chart, voyage.current, voyage.vessel, *ends, **options)  # type: ignore[arg-type]
        found[case.name] = palawan.side(plan.best.path)
    assert found == {
        "summer": "west",
        "winter": "west",
        "summer-73": "west",
        "winter-73": "east",
        "summer-34": "west",
        "winter-34": "east",
    }


def test_environments_that_the_page_names_exist() -> None:
    text = (ROOT / "docs" / "explanation" / "experiments.md").read_text("utf-8")
    named = re.findall(r"--only ([\w-]+)", text)
    assert named
    assert set(named) <= set(names())
