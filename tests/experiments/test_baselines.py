"""Every baseline: its path leads from start to goal, clear of what it has to keep off."""

import dataclasses
import pickle
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import shapely

import renew
from experiments.baselines.class_search import Graph, best_of_classes
from experiments.baselines.energy_graph import energies
from experiments.baselines.registry import PLANNERS
from experiments.environments.loading import Environment, load_environment
from experiments.environments.model import Case, EnvironmentSpec
from experiments.jobs import Job, Result, run_job
from experiments.workers import results_of
from pipeline.machine.store import Store
from renew.classes.h_signature import Rays
from tests.experiments.scenes import VESSEL, islands_voyage

pytest.importorskip("ompl")

PADDING = 2.0
BASELINES = [planner for planner in PLANNERS.values() if planner.group != "ours"]
CALLS = (("calls", 40_000),)


def small_environment(folder: Path, obstacles: Sequence[shapely.Polygon] = ()) -> Environment:
    """The islands' scene as an environment, with a fixed padding; or other obstacles in it."""
    voyage = islands_voyage()
    rings = [list(one.exterior.coords) for one in obstacles or voyage.chart.no_go]
    scenario = {
        "schema_version": 1,
        "name": "small",
        "title": "Small",
        "start": voyage.start.tolist(),
        "goal": voyage.goal.tolist(),
        "vessel": {"speed_m_s": VESSEL.speed, "turn_rate_deg_s": 35, "length_m": VESSEL.length},
        "plane": {"extent": [0, 0, 60, 60], "credit": "a test's", "obstacles": rings},
        "seasons": [{"name": "gyre", "gyre": {"amplitude": 0.6}}],
        "planner": {"distinct_by": 0},
    }
    spec = EnvironmentSpec(
        schema_version=1,
        name="small",
        title="Small",
        scene="ours",
        remark="A test's.",
        scenario=scenario,
        classes=4,
        nodes=300,
        cases=(Case(name="fixed", title="fixed", season="gyre", padding=PADDING),),
    )
    return load_environment(spec, Store(folder, owner="small"))


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], list[Result]]:
    """Every baseline in bare and in padded water, twice with the same seed."""
    folder = tmp_path_factory.mktemp("small")
    environment = folder / "small.pickle"
    environment.write_bytes(pickle.dumps(small_environment(folder)))
    jobs = [
        Job("small", "fixed", planner.name, 3, water, CALLS)
        for planner in BASELINES
        for water in ("bare", "padded")
        for _ in range(2)
    ]
    found: dict[tuple[str, str], list[Result]] = {}
    for result in results_of(jobs, Work(environment), 2):
        found.setdefault((result.job.planner, result.job.water), []).append(result)
    return found


@dataclasses.dataclass(frozen=True)
class Work:
    """Runs a job on an environment's file."""

    environment: Path

    def __call__(self, job: Job) -> Result:
        """Run it."""
        return run_job(job, self.environment, self.environment)


@pytest.mark.slow
@pytest.mark.parametrize("planner", [planner.name for planner in BASELINES])
@pytest.mark.parametrize("water", ["bare", "padded"])
def test_paths_are_clear_and_the_same_seed_gives_the_same_path(
    planner: str, water: str, results: dict[tuple[str, str], list[Result]]
) -> None:
    voyage = islands_voyage()
    land = shapely.union_all(list(voyage.chart.no_go))
    one, other = results[planner, water]
    assert one.failure == "", one.failure
    for judged in one.paths:
        path = judged.candidate.path
        np.testing.assert_allclose(path[[0, -1]], [voyage.start, voyage.goal], atol=1e-9)
        least = shapely.distance(shapely.LineString(path), land)
        # Chords of a Dubins arc may be off by 0.1 % of its radius.
        assert least >= (PADDING - 2e-3 if water == "padded" else 0.0)
        assert not judged.judgement.crosses_land
        assert judged.judgement.fuel >= 0.9 * best_known(voyage.chart, voyage.start, voyage.goal)
    for a, b in zip(one.paths, other.paths, strict=True):
        np.testing.assert_array_equal(a.candidate.path, b.candidate.path)
        assert a.judgement == b.judgement


def best_known(chart: renew.Chart, start: np.ndarray, goal: np.ndarray) -> float:
    """Fuel of the unpadded optimum."""
    voyage = islands_voyage()
    return renew.plan(chart, voyage.current, VESSEL, start, goal, padding="none").best.fuel


@pytest.mark.slow
def test_rivals_with_fuel_as_objective_come_near_the_optimum(
    results: dict[tuple[str, str], list[Result]],
) -> None:
    voyage = islands_voyage()
    ours = renew.plan(
        voyage.chart, voyage.current, VESSEL, voyage.start, voyage.goal, padding=PADDING
    ).best.fuel
    for planner in BASELINES:
        if planner.group == "fuel":
            best = results[planner.name, "padded"][0].best
            assert best is not None
            assert 0.999 * ours <= best.judgement.fuel <= 1.06 * ours, planner.name


@pytest.mark.slow
def test_a_baseline_without_a_way_says_so(tmp_path: Path) -> None:
    file = tmp_path / "walled.pickle"
    # A gap of 1 cm, which none of the methods finds: without any, the scene is refused.
    wall = [shapely.box(0, 28, 30.5, 32), shapely.box(30.51, 28, 60, 32)]
    file.write_bytes(pickle.dumps(small_environment(tmp_path, wall)))
    jobs = [Job("small", "fixed", name, 0, "bare", CALLS) for name in ("A*", "PRM", "isochrone")]
    failures = {result.job.planner: result.failure for result in results_of(jobs, Work(file), 1)}
    assert failures["A*"] == "no path on a grid of 2 m"
    assert failures["PRM"] == "no path on a roadmap of 300 nodes"
    assert "isochrones lead nowhere" in failures["isochrone"]


def test_the_class_search_finds_the_shortest_path_of_each_class() -> None:
    """On a grid of 4 by 4 nodes around one island, against all simple paths."""
    import networkx as nx

    chart = renew.Chart(shapely.box(-1, -1, 4, 4), [shapely.box(1.2, 1.2, 1.8, 1.8)])
    rays = Rays.of(chart)
    grid = nx.grid_2d_graph(4, 4)
    order = [(0, 0), (3, 3), *(node for node in grid if node not in ((0, 0), (3, 3)))]
    number = {node: i for i, node in enumerate(order)}
    nodes = np.array(order, dtype=float)
    edges = np.array([(number[a], number[b]) for u, v in grid.edges for a, b in ((u, v), (v, u))])
    cost = np.linalg.norm(nodes[edges[:, 1]] - nodes[edges[:, 0]], axis=1)
    found = best_of_classes(Graph(nodes, edges, cost), rays, 4)
    shortest: dict[tuple[int, ...], float] = {}
    for row in nx.all_simple_paths(grid, (0, 0), (3, 3)):
        word = rays.word(np.array(row, dtype=float))
        shortest[word] = min(shortest.get(word, np.inf), len(row) - 1)
    lengths = {rays.word(path): len(path) - 1 for path in found}
    assert len(lengths) == len(found) >= 2
    for word, length in lengths.items():
        assert length == shortest[word]


def test_the_energy_of_a_leg_is_least_over_all_speeds() -> None:
    current = renew.UniformCurrent(0.3, 0.4)
    a, b = np.array([[0.0, 0.0]]), np.array([[10.0, 0.0]])
    speeds = np.linspace(1e-3, 2, 200_001)
    through = (speeds - 0.3) ** 2 + 0.4**2
    allowed = through <= 1.0
    by_hand = ((1.0 + through) * 10.0 / speeds)[allowed].min()
    assert energies(a, b, current, 1.0)[0] == pytest.approx(by_hand, rel=1e-6)


@pytest.mark.slow
def test_trees_of_poses_step_and_give_up_as_their_budget_says(tmp_path: Path) -> None:
    """Longer steps give smaller trees, and a tree that has used up its calls says so."""
    environment = small_environment(tmp_path)
    files = {}
    for step in (3.0, 20.0):
        files[step] = tmp_path / f"step{step}.pickle"
        spec = environment.spec.model_copy(update={"dubins_step_m": step})
        files[step].write_bytes(pickle.dumps(dataclasses.replace(environment, spec=spec)))
    states = {}
    for step, file in files.items():
        (result,) = results_of([Job("small", "fixed", "RRT-D", 1)], Work(file), 1)
        assert result.best is not None
        states[step] = result.best.candidate.states
    assert states[3.0] > 2 * states[20.0]
    few = Job("small", "fixed", "RRT*-D", 1, options=(("calls", 20),))
    (result,) = results_of([few], Work(files[3.0]), 1)
    assert result.failure == "no path within 20 calls"
