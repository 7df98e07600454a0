"""`renew plot`: figures of an earlier run, or of one that is planned for them."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import matplotlib as mpl
import pytest
from matplotlib.image import imread
from typer.testing import CliRunner

from pipeline.cli.main import app
from pipeline.errors import StageError
from pipeline.findings.names import output_directory
from pipeline.formats.figures import kinds as plot_module
from pipeline.formats.figures.kinds import Form, Kind, draw
from pipeline.run import Event, EventHandler, planned_scenario, run
from pipeline.scenario.catalogue import read_toml, scenario_path
from pipeline.scenario.loading import parse_scenario, scenario_text
from pipeline.scenario.model import Scenario
from tests.pipeline.results import plain_pages
from tests.tree import tree

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def scenario(classes: int = 2, **changes: object) -> Scenario:
    """Return the catalogue's single gyre with few classes.

    With one there is no other side whose fuel would be bounded, which takes longer than the plan.
    """
    table = read_toml(scenario_path("single-gyre"))
    table["planner"]["classes"] = classes
    return parse_scenario(table | changes)


def plot(
    asked: Scenario,
    output: Path,
    *,
    kinds: tuple[Kind, ...] = (),
    form: Form = "png",
    on_event: EventHandler | None = None,
) -> list[Path]:
    """Draw figures of all cases, as the command does."""
    with planned_scenario(asked, output, on_event=on_event) as result:
        folder = output_directory(output.resolve(), asked.name) / "figures"
        return draw(result, result.cases, folder, kinds=kinds, form=form)


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the results of a run, without figures."""
    folder = tmp_path_factory.mktemp("plot") / "outputs"
    with plain_pages():
        run(scenario(), folder)
    return folder


def test_all_figures_of_a_run_are_drawn_and_nothing_else_changes(output: Path) -> None:
    before = tree(output)
    settings = dict(mpl.rcParams)
    events: list[Event] = []
    files = plot(scenario(), output, on_event=events.append)
    folder = output / "single-gyre" / "figures"
    assert [file.name for file in files] == [f"gyre-{kind}.png" for kind in Kind]
    assert sorted(folder.iterdir()) == sorted(files)
    after = tree(output)
    assert {name: after[name] for name in before} == before
    results = (output / "single-gyre").resolve().relative_to(output.resolve())
    assert after.keys() - before.keys() == {f"{results}/figures/{file.name}" for file in files}
    # The stored plan was used; nothing but figures was written.
    assert "write" not in {event.stage for event in events}
    assert dict(mpl.rcParams) == settings
    for file in files:
        assert imread(file).shape[1] >= 1000


@pytest.mark.slow
def test_the_same_figure_is_the_same_file_in_its_format(output: Path) -> None:
    contents = {}
    for form in get_args(Form):
        (first,) = plot(scenario(), output, kinds=(Kind.ROUTES,), form=form)
        contents[form] = first.read_bytes()
        (again,) = plot(scenario(), output, kinds=(Kind.ROUTES,), form=form)
        assert again == first
        assert again.read_bytes() == contents[form]
    assert contents["pdf"].startswith(b"%PDF-1.")
    text = contents["svg"].decode()
    assert text.count("<svg") == 1
    # The whole extent is in it as vectors, not as an image.
    assert "<image" not in text
    assert len(re.findall("<path", text)) > 20


@pytest.mark.usefixtures("plain_report")
def test_a_scenario_without_a_run_is_planned_and_only_figures_are_written(tmp_path: Path) -> None:
    files = plot(scenario(classes=1), tmp_path / "new", kinds=(Kind.ALONG,))
    visible = [name for name in tree(tmp_path / "new") if not name.startswith(".artefacts")]
    assert visible == ["single-gyre/figures/gyre-along.png"]
    assert [str(file.relative_to(tmp_path / "new")) for file in files] == visible
    plans = tree(tmp_path / "new" / ".artefacts" / "plan")
    assert plans
    # A run continues from there.
    assert run(scenario(classes=1), tmp_path / "new").fresh
    assert tree(tmp_path / "new" / ".artefacts" / "plan") == plans


@pytest.mark.slow
def test_a_failed_season_leaves_the_others_figures(tmp_path: Path) -> None:
    seasons = [
        {"name": "calm", "uniform": {"u": 0.1, "v": 0.0}},
        {"name": "torrent", "uniform": {"u": 3.0, "v": 0.0}},
    ]
    file = tmp_path / "asked.toml"
    file.write_text(scenario_text(scenario(classes=1, seasons=seasons)))
    figures = ("--figure", "routes", "--figure", "along", "--format", "svg")
    asked = (str(file), "--output", str(tmp_path), *figures)
    code, out, err = invoke(*asked)
    assert [Path(line).name for line in out.split()] == ["calm-routes.svg", "calm-along.svg"]
    assert code == 1
    assert err.splitlines()[-1].startswith("error: season 'torrent': ")
    assert invoke(*asked, "--season", "calm")[0] == 0


def test_figures_that_cannot_be_written_are_a_failure_with_a_remedy(
    output: Path, tmp_path: Path
) -> None:
    shutil.copytree(output, tmp_path, symlinks=True, dirs_exist_ok=True)
    figures = tmp_path / "single-gyre" / "figures"
    shutil.rmtree(figures, ignore_errors=True)
    figures.write_text("in the way")
    with pytest.raises(StageError, match=r"gyre-routes\.png.*--output"):
        plot(scenario(), tmp_path, kinds=(Kind.ROUTES,))
    assert figures.read_text() == "in the way"


def test_an_interrupted_figure_leaves_the_earlier_one_complete(
    output: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (file,) = plot(scenario(), output, kinds=(Kind.ROUTES,))
    whole = tree(output)
    # A resolution that exceeds any memory.
    monkeypatch.setattr(plot_module, "_DPI", 1e6)
    with pytest.raises((ValueError, MemoryError)):
        plot(scenario(), output, kinds=(Kind.ROUTES,))
    assert tree(output) == whole
    assert imread(file).size


def test_no_run_replaces_the_folder_while_figures_are_saved(
    output: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save = plot_module._save

    def run_meanwhile(drawing: Figure, path: Path, title: str) -> None:
        with pytest.raises(StageError, match="another run of 'single-gyre'"):
            run(scenario(title="Another"), output)
        save(drawing, path, title)

    monkeypatch.setattr(plot_module, "_save", run_meanwhile)
    (file,) = plot(scenario(), output, kinds=(Kind.ROUTES,))
    assert file.is_file()


def invoke(*arguments: str) -> tuple[int, str, str]:
    """Run a command; return exit code, standard output and standard error."""
    done = CliRunner().invoke(app, ["plot", *arguments], catch_exceptions=False)
    return done.exit_code, done.stdout, done.stderr


def test_wrong_requests_exit_with_2_and_one_line(tmp_path: Path) -> None:
    place = ("--output", str(tmp_path / "none"))
    code, out, err = invoke("single-gyre", "--season", "spring", *place)
    assert (code, out) == (2, "")
    assert err.splitlines() == ["error: single-gyre has no season 'spring': it has gyre"]
    for wrong in (("--figure", "chart"), ("--format", "gif")):
        code, _, err = invoke("single-gyre", *wrong, *place)
        assert code == 2
        assert wrong[1] in err
    assert not (tmp_path / "none").exists()
