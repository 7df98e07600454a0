"""The whole run: tables, report, and what is said where something is missing."""

import csv
import json
from pathlib import Path

import pytest

from experiments.environments import loading
from experiments.environments.loading import load_spec, names
from experiments.run import chosen_specs, run
from pipeline.errors import RequestError
from tests.commands import PYTHON, ended

pytest.importorskip("ompl")


@pytest.mark.parametrize("name", names())
def test_the_environments_are_valid(name: str) -> None:
    spec = load_spec(name)
    assert spec.name == name
    assert spec.remark


def test_published_rows_are_those_of_the_publication() -> None:
    four = load_spec("four-gyre").published
    fuels = [row.fuel for row in four if row.classes is None]
    assert fuels == [202.25, 236.27, 293.34, 235.09, 269.92, 219.17, 224.84, 215.15]
    assert sum(row.trials or 0 for name in _PAPERS for row in _ours(name)) == 5890


_PAPERS = ("four-gyre", "hansando", "far-east")


def _ours(name: str) -> list:  # type: ignore[type-arg]
    return [row for row in load_spec(name).published if row.planner == "RENEW"]


def test_an_unknown_environment_is_one_clear_error() -> None:
    with pytest.raises(RequestError, match=r"--only gyer: no such environment; there are: abl"):
        chosen_specs(quick=False, only=["gyer"])


def test_a_faulty_environment_is_refused_with_all_its_faults(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (loading.FOLDER / "single-gyre.toml").read_text("utf-8")
    text = text.replace("padding = 3.27", "padding = -1").replace("station_m", "station")
    (tmp_path / "single-gyre.toml").write_text(text, "utf-8")
    monkeypatch.setattr(loading, "FOLDER", tmp_path)
    with pytest.raises(RequestError) as caught:
        load_spec("single-gyre")
    faults = "\n".join(caught.value.faults)
    assert "cases[2].padding = -1" in faults
    assert "unknown key station" in faults


def test_without_ompl_one_line_says_what_to_do(root: Path, tmp_path: Path) -> None:
    hide = (
        "import runpy, sys; sys.modules['ompl'] = None; "
        "runpy.run_module('experiments', run_name='__main__', alter_sys=True)"
    )
    arguments = ["--quick", "--output", str(tmp_path)]
    done = ended(*PYTHON, hide, *arguments, cwd=root)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: the package 'ompl' is not installed")
    assert "make setup" in line
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def quick_runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two quick runs of the single gyre with the same seeds."""
    folders = [tmp_path_factory.mktemp(f"run{i}") for i in range(2)]
    specs = chosen_specs(quick=True, only=["single-gyre"])
    return [run(specs, folder, quick=True).parent for folder in folders]


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    # Measured, and so different from run to run.
    return [{name: value for name, value in row.items() if name != "seconds"} for row in rows]


@pytest.mark.slow
def test_the_same_seeds_give_the_same_tables(quick_runs: list[Path]) -> None:
    one, other = quick_runs
    tables = sorted(path.name for path in one.glob("*.csv"))
    assert "main.csv" in tables
    assert "equal-padding.csv" in tables
    for name in tables:
        assert _rows(one / name) == _rows(other / name), name


@pytest.mark.slow
def test_the_report_is_one_file_that_loads_nothing(quick_runs: list[Path]) -> None:
    page = (quick_runs[0] / "report.html").read_text("utf-8")
    assert "96.08" in page
    assert 'src="http' not in page
    assert "<script" not in page
    assert page.count('src="data:image/png;base64,') >= 2


@pytest.mark.slow
def test_a_quick_run_has_every_planner_in_both_environments(tmp_path: Path) -> None:
    from experiments.baselines.registry import PLANNERS

    report = run(chosen_specs(quick=True), tmp_path, quick=True)
    facts = json.loads((report.parent / "facts.json").read_text("utf-8"))
    # Two minutes on two processors, by processor time: others may be at work beside the test.
    assert float(facts["time"].split()[-2]) <= 4.0
    main, equal = (_rows(report.parent / f"{name}.csv") for name in ("main", "equal-padding"))
    for title in ("Single gyre", "4-gyre"):
        ran = {row["planner"] for row in main + equal if row["environment"] == title}
        assert ran >= set(PLANNERS)
    assert not [row for row in equal if row["ours_is"] == "lost"]
    ours = {
        (row["environment"], row["case"]): float(row["fuel"])
        for row in main
        if row["planner"] == "RENEW" and row["origin"] == "computed"
    }
    assert ours["Single gyre", "the published clearance, 12.55 m"] <= 89.6
    assert ours["4-gyre", "adaptive padding"] <= 201.5
