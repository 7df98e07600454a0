"""Off a terminal a line of JSON shows now and then that a run is at work."""

import json
import re
import threading
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline.cli import reporting as progress_module
from pipeline.cli.answer import answer
from pipeline.cli.main import app
from pipeline.cli.reporting import progress
from pipeline.findings.note_words import note_text
from pipeline.model import Note
from pipeline.run import Event, run
from pipeline.scenario.catalogue import read_toml, scenario_path
from pipeline.scenario.loading import load_scenario, parse_scenario
from tests.pipeline.small_plane import small_plane
from tests.pipeline.small_region import with_stand_in


def test_a_line_says_what_is_at_work_until_the_run_ends(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress_module, "_HEARTBEAT_S", 0.1)
    table = read_toml(scenario_path("single-gyre"))
    table["seasons"].append({"name": "second", "uniform": {"u": 0.1}})
    first = table["seasons"][0]["name"]
    threads = threading.active_count()
    note = Note.of("margin-raised", margin_m=10.0, accuracy_m=25.0)
    with progress(parse_scenario(table), ["a note"], as_json=True) as on_event:
        on_event(Event("simplify", "note", detail=note_text(note), note=note))
        on_event(Event("plan", "begun"))
        time.sleep(0.25)
        on_event(Event("plan", "done", season=first))
        time.sleep(0.25)
    assert threading.active_count() == threads
    lines = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert lines[0]["detail"] == "a note"
    assert lines[1]["note"]["values"] == {"margin_m": 10.0, "accuracy_m": 25.0}
    assert lines[1]["note"]["text"] == lines[1]["detail"]
    beats = [line for line in lines if line.get("status") == "working"]
    assert {line["stage"] for line in beats} == {"plan"}
    assert [first, "second"] in [line["seasons"] for line in beats]
    assert beats[-1]["seasons"] == ["second"]
    assert beats[-1]["seconds"] >= 0.4
    time.sleep(0.25)
    assert capsys.readouterr().err == ""


def test_a_temporary_cache_of_machine_code_is_noted(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("renew._compiled.cache_is_temporary", lambda: True)
    with progress(parse_scenario(read_toml(scenario_path("single-gyre")))):
        pass
    assert "compiled again after a reboot" in capsys.readouterr().err


@pytest.mark.usefixtures("plain_report")
def test_each_file_that_is_written_is_a_part_of_the_stage(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    asked = parse_scenario(read_toml(scenario_path("single-gyre")))
    with progress(asked, as_json=True) as on_event:
        outcome = run(asked, tmp_path, on_event=on_event)
    lines = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    parts = [line["detail"] for line in lines if line["event"] == "part"]
    written = {path.name for path in outcome.directory.iterdir()} - {"manifest.json"}
    assert {part.split(" (")[0] for part in parts} == written
    assert parts[-1].endswith(f"({len(written)} of {len(written)})")


@pytest.mark.usefixtures("plain_report")
def test_where_no_terminal_is_and_no_json_is_asked_for_lines_are_plain_text(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    asked = parse_scenario(read_toml(scenario_path("single-gyre")))
    with progress(asked, ["a note"]) as on_event:
        run(asked, tmp_path, on_event=on_event)
    lines = capsys.readouterr().err.splitlines()
    assert lines[:2] == ["single-gyre: note: a note", "single-gyre: Fetching land and currents"]
    assert "single-gyre: Planning and verifying" in lines
    assert not any("{" in line for line in lines)
    assert len(lines) < 15


# --- What was planned on other currents than the preferred ones says so first, or not at all ---


@pytest.fixture
def file(tmp_path: Path) -> str:
    """Return the path of a scenario that prefers a source which needs the network."""
    path = tmp_path / "across.toml"
    path.write_text(with_stand_in("stand-in"), encoding="utf-8")
    return str(path)


@pytest.mark.usefixtures("plain_report")
def test_the_answer_comes_first_then_the_sides_then_the_doubts(
    file: str, across_outputs: Path
) -> None:
    arguments = ["run", file, "--offline", "--output", str(across_outputs)]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    said, table, doubts, written = result.stdout.split("\n\n")
    assert re.match(r"(Go \w+ |The best route, ).*\d km \(", said.splitlines()[1])
    assert table.startswith("way ")
    assert len(table.splitlines()) == 2, "one class, one side"
    current, *others = doubts.splitlines()
    assert current.startswith("! Current of 2020-06-17, not 2024-07: Embedded ")
    assert "not copernicus-glorys-monthly (why: --verbose)" in current
    assert (
        "! No depths in this chart: the draught was not used, and shoals are not avoided" in others
    )
    assert written.startswith(("Written to", "Unchanged in"))
    assert len(result.stdout.splitlines()) <= 20
    # The same table, asked for by its name, is of that day, too.
    arguments += ["--currents", "embedded-palawan"]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.stdout.count("2020-06-17") == 1
    assert "! Current of 2020-06-17, not 2024-07: Embedded " in result.stdout


@pytest.mark.usefixtures("plain_report")
def test_reasons_and_choices_are_told_if_they_are_asked_for(
    file: str, across_outputs: Path
) -> None:
    arguments = ["run", file, "--offline", "--output", str(across_outputs), "--verbose"]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert "- copernicus-glorys-monthly: " in result.stdout
    assert "needs the network" in result.stdout
    assert "- planned on Embedded " in result.stdout
    assert "- routes keep an offing of" in result.stdout
    assert "In report.html: 1 route" in result.stdout
    assert "1 classes" not in result.stdout
    assert "1 routes" not in result.stdout


@pytest.mark.usefixtures("plain_report")
def test_no_row_of_the_answer_is_wider_than_the_terminal(file: str, across_outputs: Path) -> None:
    outcome = run(load_scenario(file), across_outputs, offline=True)
    for width in (60, 80, 120):
        for verbose in (False, True):
            lines = answer(outcome, width, verbose=verbose).splitlines()
            assert max(map(len, lines)) <= width
        doubts = answer(outcome, width).split("\n\n")[2].splitlines()
        assert all(line.startswith("! ") for line in doubts)


@pytest.mark.slow
def test_two_seasons_are_answered_in_twenty_lines_of_eighty_characters(tmp_path: Path) -> None:
    outcome = run(load_scenario("palawan-season"), tmp_path, offline=True)
    said = answer(outcome, 80)
    lines = said.splitlines()
    assert len(lines) + 2 <= 20, "a blank line and the folder follow"
    assert [line[:21] for line in lines[1:3]] == ["Summer: go WEST of Pa", "Winter: go EAST of Pa"]
    assert max(map(len, lines)) <= 80
    _, table, doubts = said.split("\n\n")
    assert [len(block.splitlines()) for block in (table, doubts)] == [5, 4]
    assert all(line.startswith("! ") for line in doubts.splitlines())


@pytest.mark.usefixtures("plain_report")
def test_choices_are_reported_and_no_land_was_missed(tmp_path: Path) -> None:
    """A plane without obstacles: nothing to choose, and nothing to turn away from."""
    path = tmp_path / "open.toml"
    path.write_text(small_plane("open").replace("obstacles", "# obstacles"), encoding="utf-8")
    arguments = ["run", str(path), "--output", str(tmp_path / "outputs"), "--verbose"]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    assert "Turns:" not in result.stdout
    _, table, *_ = result.stdout.split("\n\n")
    head, row = (re.split(" {2,}", line) for line in table.splitlines())
    assert row[head.index("clear")] == "-"


def test_strict_plans_nothing_on_a_stand_in(file: str, across_outputs: Path) -> None:
    plans = set(across_outputs.glob(".artefacts/plan/*"))
    arguments = ["run", file, "--offline", "--strict", "--output", str(across_outputs)]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 1
    assert result.stdout == ""
    lines = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    assert "season 'summer' would be planned on" in lines[0]
    assert "needs the network" in lines[0]
    assert set(across_outputs.glob(".artefacts/plan/*")) == plans


def test_quiet_and_json_take_the_tables_place(file: str, across_outputs: Path) -> None:
    arguments = ["run", file, "--offline", "--output", str(across_outputs)]
    quiet = CliRunner().invoke(app, [*arguments, "--quiet"], catch_exceptions=False)
    assert (quiet.exit_code, quiet.stdout, quiet.stderr) == (0, "", "")
    done = CliRunner().invoke(app, [*arguments, "--quiet", "--json"], catch_exceptions=False)
    assert done.stderr == ""
    assert [route["rank"] for route in json.loads(done.stdout)["routes"]] == [1]
    wrong = CliRunner().invoke(app, ["run", "palawan-saeson", "--quiet"])
    assert wrong.exit_code == 2
    assert "palawan-season" in wrong.stderr
