"""A whole run: its results, resumption, and independent seasons."""

import csv
import json
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import renew
from pipeline.errors import RequestError, StageError
from pipeline.run import Event, Outcome, run
from pipeline.scenario.catalogue import read_toml, scenario_path
from pipeline.scenario.loading import load_scenario, parse_scenario
from pipeline.scenario.model import Scenario
from tests.pipeline.formats import small_run
from tests.pipeline.results import plain_pages, rows_of
from tests.pipeline.voyage.waters import scenario_of
from tests.tree import tree

pytestmark = pytest.mark.usefixtures("plain_report")


def single_gyre(**planner: object) -> Scenario:
    """Return the catalogue's single gyre with some of its planner's options changed."""
    table = read_toml(scenario_path("single-gyre"))
    table["planner"] |= planner
    return parse_scenario(table)


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run single-gyre once, and return the folder of its results."""
    output = tmp_path_factory.mktemp("first") / "outputs"
    threads = threading.enumerate()
    with plain_pages():
        outcome = run(single_gyre(classes=4), output)
    # Bounds and libraries are worked at in other threads, which end with the run.
    assert threading.enumerate() == threads
    assert outcome.exit_code == 0
    assert outcome.fresh
    return output


def test_a_run_writes_its_results(first: Path) -> None:
    folder = first / "single-gyre"
    names = {path.name for path in folder.iterdir()}
    assert {"routes.gpkg", "report.html", "metrics.csv", "manifest.json"} <= names
    with (folder / "metrics.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["rank"] for row in rows] == [str(i + 1) for i in range(len(rows))]
    fuels = [float(row["fuel"]) for row in rows]
    assert fuels == sorted(fuels)
    # The paper needs 96.08 at its own clearance; a least-fuel path must not need more.
    assert fuels[0] < 96.08
    assert {row["collisions"] for row in rows} == {"0"}
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["seasons"][0]["status"] == "planned"


def test_a_second_run_writes_nothing_and_reports_the_same(first: Path) -> None:
    before = tree(first)
    outcome = run(single_gyre(classes=4), first)
    assert not outcome.fresh
    assert outcome.exit_code == 0
    assert tree(first) == before
    assert rows_of(outcome.result)[0].fuel > 0


def test_changed_results_are_written_again_without_planning(first: Path) -> None:
    table = first / "single-gyre" / "metrics.csv"
    whole = table.read_text()
    table.write_text(whole[:-20])
    plans = tree(first / ".artefacts" / "plan")
    assert run(single_gyre(classes=4), first).fresh
    assert table.read_text() == whole
    assert tree(first / ".artefacts" / "plan") == plans


def test_another_option_plans_again_in_the_same_scene(first: Path, tmp_path: Path) -> None:
    del tmp_path
    scenes = tree(first / ".artefacts" / "project")
    outcome = run(single_gyre(classes=2), first)
    assert outcome.fresh
    assert tree(first / ".artefacts" / "project") == scenes
    assert len(list((first / ".artefacts" / "plan").glob("*.artefact"))) == 2


def test_every_stage_is_reported(first: Path) -> None:
    events: list[Event] = []
    run(single_gyre(classes=4), first, on_event=events.append)
    begun = [event.stage for event in events if event.status == "begun"]
    assert begun == ["fetch", "simplify", "project", "choose", "plan", "compare", "write"]
    assert [event.stage for event in events if event.status == "done" and not event.season] == begun


def test_a_fault_after_the_plan_is_said_and_loses_no_plan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(what: str) -> Callable[..., None]:
        def raises(*_: object) -> None:
            raise renew.GeometryError(f"the fault of {what}")

        return raises

    late = {
        "pipeline.stages.compare.side_bound": "bounds",
        "pipeline.stages.compare.way_names": "names",
        "pipeline.stages.compare.shut_straits": "straits",
        "pipeline.stages.compare.waiting_notes": "notes",
        "pipeline.formats.tables.write_metrics": "a file",
    }
    with monkeypatch.context() as patched:
        for name, what in late.items():
            patched.setattr(name, fails(what))
        outcome = run(single_gyre(classes=4), tmp_path)
    said = "; ".join(outcome.failures)
    for what in ("bounds", "names", "straits", "notes", "a file"):
        assert f"the fault of {what}" in said, said
    assert outcome.exit_code == 1
    folder = tmp_path / "single-gyre"
    names = {path.name for path in folder.iterdir()}
    assert {"routes.gpkg", "report.html", "manifest.json", "scenario.toml"} <= names
    assert "metrics.csv" not in names
    assert "metrics.csv" not in json.loads((folder / "manifest.json").read_text())["outputs"]
    # Without the faults the next run writes what was left out.
    again = run(single_gyre(classes=4), tmp_path)
    assert (again.exit_code, again.fresh) == (0, True)
    assert (folder / "metrics.csv").is_file()


@pytest.mark.slow
def test_a_fault_beyond_the_chosen_region_loses_no_plan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        raise ValueError("the fault of the wider region")

    monkeypatch.setattr("pipeline.run.wider_region", fails)
    voyage = {"start": "119.0E 8.6N", "goal": "119.4E 8.6N", "vessel": "usv-7m"}
    scenario, _ = scenario_of({**voyage, "currents": ("still",)})
    outcome = run(scenario, tmp_path, offline=True)
    (said,) = outcome.failures
    assert "the choice of a wider region failed" in said
    assert "the fault of the wider region" in said
    assert outcome.result.routes
    assert (outcome.directory / "routes.gpkg").is_file()


def test_a_folder_that_cannot_be_written_is_a_failure_with_a_remedy(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RequestError, match=r"--output: .* is not a folder"):
        run(single_gyre(classes=1), tmp_path / "file")
    (tmp_path / "outputs").mkdir()
    (tmp_path / "outputs" / ".artefacts").write_text("")
    with pytest.raises(StageError, match="--output"):
        run(single_gyre(classes=1), tmp_path / "outputs")


@pytest.mark.slow
def test_palawan_both_seasons(tmp_path: Path) -> None:
    """On the real chart: no land, no collision, both sides in both seasons."""
    scenario = load_scenario("palawan-season")
    outcome = run(scenario, tmp_path, offline=True)
    assert outcome.exit_code == 0
    rows = rows_of(outcome.result)
    for season in ("summer", "winter"):
        ways = {row.main_passage for row in outcome.result.case(season).measures.routes}
        assert {"west of Palawan", "east of Palawan"} <= ways
    assert all(row.land_m == 0 for row in rows)
    assert all(row.collisions == 0 for row in rows)
    begun = time.perf_counter()
    assert not run(scenario, tmp_path, offline=True).fresh
    assert time.perf_counter() - begun < 5


def test_the_text_of_an_outcome_is_a_line(tmp_path: Path) -> None:
    """A notebook keeps it: with the whole chart in it, it was half a megabyte."""
    outcome = Outcome(small_run.parts(), tmp_path, fresh=True, seconds=1.0)
    assert repr(outcome) == f"Outcome(directory={tmp_path!r}, fresh=True, seconds=1.0)"
