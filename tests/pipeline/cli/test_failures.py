"""Whatever is typed or goes wrong is a line and an exit code, never a traceback."""

import json
import os
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from pipeline.cli.failures import exit_code_of, reported_errors
from pipeline.cli.main import app
from tests.commands import PYTHON, ended
from tests.conftest import ROOT
from tests.pipeline.processes import QUICK, SLOW, renew, started
from tests.pipeline.small_region import small_region


def refusal(*arguments: str) -> tuple[int, str]:
    """Return the exit code and the only line of a command."""
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    return result.exit_code, line


@pytest.fixture
def quick(tmp_path: Path) -> str:
    """Return the path of a valid scenario."""
    path = tmp_path / "quick.toml"
    path.write_text(QUICK)
    return str(path)


@pytest.mark.parametrize("command", ["run", "plot", "check", "show"])
@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ("~nosuchuser/x.toml", "home folder that does not exist"),
        ("a\0b.toml", "U+0000"),
        ("x" * 5000 + "/y.toml", "too long"),
        ("\udcff.toml", "not UTF-8"),
        ("/dev/null", "is a device"),
        ("pipe.toml", "is a FIFO"),
        ("deep.toml", "nested too deeply"),
        ("brackets.toml", "nested too deeply"),
    ],
)
def test_a_scenario_that_cannot_be_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, asked: str, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe.toml")
    (tmp_path / "deep.toml").write_text("a = " + "[" * 3000 + "]" * 3000)
    (tmp_path / "brackets.toml").write_text("a = " + "{a=" * 3000)
    code, line = refusal(command, asked)
    assert code == 2
    assert line.startswith("error: ")
    assert said in line
    assert len(line) < 600


@pytest.mark.parametrize("depth", [50, 200, 400, 480, 900])
def test_any_depth_of_nesting_is_a_line(tmp_path: Path, depth: int) -> None:
    path = tmp_path / "deep.toml"
    path.write_text(QUICK + "obstacle = " + "[" * depth + "]" * depth)
    assert refusal("check", str(path))[0] == 2


@pytest.mark.parametrize("command", ["run", "plot"])
@pytest.mark.parametrize(
    ("output", "said"),
    [
        ("~nosuchuser/x", "home folder that does not exist"),
        ("x" * 300, "too long"),
        ("x/" * 3000, "too long"),
        ("\udcff", "not UTF-8"),
        ("quick.toml", "is not a folder"),
        ("quick.toml/below", "lies below a file"),
    ],
)
def test_an_output_that_cannot_be_a_folder(
    quick: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    output: str,
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    before = set(tmp_path.iterdir())
    code, line = refusal(command, quick, "--output", output)
    assert code == 2
    assert said in line
    assert set(tmp_path.iterdir()) == before


@pytest.mark.gate_share(10)
@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("~nosuchuser/x", "home folder that does not exist"),
        ("./a\0b", "U+0000"),
        ("./" + "x" * 5000, "too long"),
        ("./" + "x/" * 2500, "too long"),
        ("/dev/null", "is a device"),
        ("./pipe", "is a FIFO"),
        ("./link", "is a FIFO"),
        ("./loop", "leads back to itself"),
        ("./none", "does not exist"),
    ],
)
@pytest.mark.parametrize("key", ["chart.source", "chart.source.path", "currents", "group"])
def test_a_path_in_a_scenario_that_cannot_be_read(
    tmp_path: Path, key: str, path: str, said: str
) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name, target in (("link", "pipe"), ("loop", "loop")):
        (tmp_path / name).symlink_to(target)
    quoted, chart, currents = json.dumps(path), '"osm-land"', '"embedded-palawan"'
    if key.startswith("chart"):
        chart = quoted if key == "chart.source" else f"{{ path = {quoted} }}"
    else:
        currents = quoted if key == "currents" else f"[{quoted}]"
    scenario = tmp_path / "odd.toml"
    scenario.write_text(
        f"{small_region('odd')}[chart]\nsource = {chart}\n[[seasons]]\nname = 'summer'\n"
        f"valid = '2024-07'\ncurrents = [{currents}]\n"
    )
    for command in ("run", "check"):
        code, line = refusal(command, str(scenario))
        assert code == 2
        assert said in line
        assert len(line) < 400


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_output_is_the_machines_fault(quick: str, tmp_path: Path) -> None:
    (tmp_path / "locked").mkdir(mode=0o500)
    code, line = refusal("run", quick, "--output", str(tmp_path / "locked"))
    assert code == 1
    assert "--output" in line


def test_an_output_where_no_folder_can_be_made_is_the_machines_fault(quick: str) -> None:
    """Linux refuses a folder in /proc as if the one above were missing."""
    code, line = refusal("run", quick, "--output", "/proc/outputs")
    assert code == 1
    assert "choose another folder with --output" in line


@pytest.mark.parametrize("command", ["run", "check"])
def test_a_working_directory_that_was_removed(tmp_path: Path, command: str) -> None:
    (tmp_path / "gone").mkdir()
    (tmp_path / "quick.toml").write_text(QUICK)
    program = (
        "import os, sys\n"
        f"os.chdir({str(tmp_path / 'gone')!r}); os.rmdir({str(tmp_path / 'gone')!r})\n"
        f"sys.path[:] = [{str(ROOT)!r}, *filter(None, sys.path)]\n"
        "from pipeline.cli.main import main\n"
        f"sys.argv = ['renew', {command!r}, '../quick.toml']\n"
        "main()\n"
    )
    done = ended(*PYTHON, program)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "working directory" in done.stderr


def test_an_unforeseen_error_is_a_line_of_json(quick: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*arguments: object, **options: object) -> None:
        raise LookupError("no such\nthing", arguments, options)

    monkeypatch.setattr("pipeline.scenario.loading.load_scenario", fail)
    code, line = refusal("check", quick)
    assert code == 3
    found = json.loads(line)
    assert found["type"] == "LookupError"
    assert "no such" in found["message"]
    assert found["where"][-1].startswith("pipeline/cli/test_failures.py:")
    assert found["version"]
    assert "SECURITY.md" in found["report"]


def test_a_pipe_that_is_closed_is_no_error() -> None:
    with subprocess.Popen(
        renew("list"), stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT
    ) as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.stderr is not None
        assert b"error" not in process.stderr.read()


def test_a_refusal_says_from_when_the_files_are(quick: str, tmp_path: Path) -> None:
    output = tmp_path / "outputs" / "quick"
    output.mkdir(parents=True)
    (output / "manifest.json").touch()
    os.utime(output / "manifest.json", (0, 0))
    with open(quick, "a") as file:  # noqa: PTH123
        file.write("risk = 7\n")
    arguments = ["run", quick, "--output", str(tmp_path / "outputs")]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 2
    assert result.stderr.splitlines()[-1] == (
        f"note: nothing was written: the files in {output} are those of an earlier run, of "
        "1970-01-01 00:00 UTC"
    )


@pytest.mark.usefixtures("plain_report")
def test_clean_says_what_it_freed(
    quick: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = str(tmp_path / "outputs")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    land = tmp_path / "renew" / "osm-0.1-1.shoreline"
    land.parent.mkdir()
    land.write_bytes(bytes(2_000_000))
    assert CliRunner().invoke(app, ["run", quick, "--output", output]).exit_code == 0
    kept = CliRunner().invoke(app, ["clean", "--output", output])
    assert kept.stdout.startswith("Freed 0.0 MB (0 files); ")
    assert land.exists()
    cleaned = CliRunner().invoke(app, ["clean", "--output", output, "--all", "--yes"])
    assert "; 0.0 MB remain in" in cleaned.stdout
    assert "The world's land was removed from the user's cache, too (2.0 MB)" in cleaned.stdout
    assert not land.exists()
    assert not list((tmp_path / "outputs" / ".artefacts").rglob("*.artefact"))
    assert (tmp_path / "outputs" / "quick" / "report.html").exists()
    assert refusal("clean", "--output", output, "--older", "soon")[0] == 2
    assert refusal("clean", "--output", str(tmp_path / "none"))[0] == 2


@pytest.mark.parametrize(
    "words",
    [
        ["--no-such-option=" + "x" * 5000],
        ["x" * 5000],
        ["run", "quick", "--limit", "x" * 5000],
        ["run", "quick", "x" * 5000],
        ["run", "--" + "x" * 5000],
        ["plot", "quick", "--format", "x" * 5000],
        ["run", "x" * 5000],
        ["show", "x" * 200 + "/" + "x" * 200 + ".toml"],
        ["nightly", "check", "--only", "x" * 5000],
        ["clean", "--older", "9" * 5000],
        ["go", "x" * 5000, "y" * 5000],
        ["go", "1,1", "2,2", "--vessel", "x" * 5000],
        ["go", "1,1", "2,2", "--speed", "9" * 5000 + "kn"],
        ["go", "1,1", "2,2", "--depart", "x" * 5000],
    ],
    ids=lambda words: " ".join(word[:12] for word in words),
)
def test_long_words_are_not_repeated_whole(words: list[str]) -> None:
    refused = CliRunner().invoke(app, words)
    assert refused.exit_code == 2
    assert max(map(len, refused.stderr.splitlines())) <= 500


def _zip_of_1975() -> None:
    zipfile.ZipInfo("a", (1975, 1, 1, 0, 0, 0))


def _library_that_does_not_fit() -> None:
    reason = OSError("libx.so: failed to map segment from shared object")
    raise ImportError("x can't be imported") from reason


@pytest.mark.parametrize(
    ("fail", "said"),
    [
        (lambda: np.empty(1 << 60, np.int8), "the memory ran out"),
        (lambda: [0] * (1 << 60), "the memory ran out"),
        (lambda: Path("/dev/full").write_text("an answer that is piped into a file"), "no space"),
        (_library_that_does_not_fit, "the memory ran out"),
        (_zip_of_1975, "this machine's clock"),
        (lambda: time.sleep(1e300), "this machine's clock"),
    ],
)
def test_memory_clock_and_space_are_named(
    fail: Callable[[], object], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(typer.Exit) as caught, reported_errors():
        fail()
    assert caught.value.exit_code == 1
    assert said in capsys.readouterr().err
    cause = caught.value.__context__
    assert cause is not None
    assert exit_code_of(cause) == 1  # as the monitoring service is told


# --- Ctrl-C and SIGTERM end a run within seconds, whatever its threads do ---


STOPPED = "stopped; finished stages are kept, run again to continue"


@pytest.mark.gate_share(1)
@pytest.mark.parametrize(
    ("number", "code", "seasons"), [(signal.SIGTERM, 143, 2), (signal.SIGINT, 130, 1)]
)
def test_a_planning_run_stops_promptly_and_another_can_start(
    tmp_path: Path, number: int, code: int, seasons: int
) -> None:
    """Two seasons are planned in threads, one in the main thread."""
    second = SLOW[SLOW.rindex("[[seasons]]") : SLOW.index("[planner]")]
    text = SLOW if seasons == 2 else SLOW.replace(second, "")
    (tmp_path / "slow.toml").write_text(text)
    command = renew(
        "run", str(tmp_path / "slow.toml"), "--output", str(tmp_path / "outputs"), "--json"
    )
    for is_stopped in (True, False):
        with started(*command) as process:
            assert process.stderr is not None
            begun = ({"stage": "plan", "event": "begun"}.items() <= json.loads(line).items()
                     for line in process.stderr)  # fmt: skip
            assert any(begun)
            if is_stopped:
                time.sleep(0.5)  # among the classes by then
                assert process.poll() is None
                process.send_signal(number)
                # Three seconds at most by its own clock; other tests may have the processor.
                assert process.wait(20) == code
                assert process.stderr.read().splitlines()[-1] == STOPPED
                assert not list(tmp_path.glob("outputs/.artefacts/*/.*"))


def test_code_that_never_returns_is_ended_all_the_same() -> None:
    """The main thread waits in C for a lock that it holds itself, and sees no signal."""
    program = (
        "import ctypes\n"
        "from pipeline.cli import failures\n"
        "failures._GRACE_S = 0.5\n"
        "with failures.ending_promptly():\n"
        "    print('ready', flush=True)\n"
        "    mutex = ctypes.create_string_buffer(64)\n"
        "    lock = ctypes.CDLL(None).pthread_mutex_lock\n"
        "    lock(mutex), lock(mutex)\n"
    )
    with started(sys.executable, "-c", program) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.5)
        process.send_signal(signal.SIGTERM)
        assert process.wait(8) == 143
        assert process.stderr is not None
        assert process.stderr.read() == f"{STOPPED}\n"
