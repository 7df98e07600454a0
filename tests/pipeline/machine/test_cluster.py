"""Real Dask schedulers and workers on loopback that are absent, silent, killed, or of no use."""

import csv
import os
import signal
import socket
import threading
import time
from pathlib import Path

import pytest

from pipeline.errors import StageError
from pipeline.machine import cluster
from pipeline.run import Event, Outcome, run
from pipeline.scenario.loading import load_scenario
from tests.pipeline.dask_processes import scheduler, worker
from tests.pipeline.processes import QUICK, SLOW, wait_until
from tests.pipeline.results import rows_of


@pytest.fixture(autouse=True)
def _short_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "_ANSWER_S", 6.0)
    monkeypatch.setattr(cluster, "_WORKERS_S", 12.0)
    monkeypatch.setattr(cluster, "_HEARTBEAT_S", 1.0)


def run_text(folder: Path, text: str, address: str, limit_s: float | None = None) -> Outcome:
    """Run a scenario's text on a scheduler."""
    file = folder / "scenario.toml"
    file.write_text(text)
    return run(load_scenario(str(file)), folder / "outputs", scheduler=address, limit_s=limit_s)


def refusal(folder: Path, text: str, address: str) -> str:
    """Return the one line with which a run on a scheduler is given up, within a minute."""
    begun = time.monotonic()
    with pytest.raises(StageError) as caught:
        run_text(folder, text, address)
    assert time.monotonic() - begun < 60
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.fixture
def _no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give up soon where nobody can answer at all."""
    monkeypatch.setattr(cluster, "_ANSWER_S", 1.0)


@pytest.mark.gate_share(2)
@pytest.mark.usefixtures("_no_answer")
@pytest.mark.parametrize(
    "address", ["tls://127.0.0.1:1", "nonsense", "tcp://127.0.0.1:1", "tcp://127.0.0.1:999999"]
)
def test_an_address_without_a_scheduler(tmp_path: Path, address: str) -> None:
    line = refusal(tmp_path, QUICK, address)
    assert address in line
    assert "leave --scheduler out" in line


@pytest.mark.usefixtures("_no_answer")
def test_a_port_that_accepts_and_says_nothing(tmp_path: Path) -> None:
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        line = refusal(tmp_path, QUICK, f"tcp://127.0.0.1:{silent.getsockname()[1]}")
    assert "no Dask scheduler answers" in line


@pytest.mark.slow
def test_a_scheduler_without_workers(tmp_path: Path) -> None:
    with scheduler(tmp_path) as (_, address):
        assert "has had no workers for 12 s; start some" in refusal(tmp_path, QUICK, address)


@pytest.mark.slow
def test_a_worker_plans_and_a_limit_ends_its_seasons(tmp_path: Path) -> None:
    with scheduler(tmp_path) as (_, address), worker(address):
        remote = run_text(tmp_path, QUICK, address)
        assert remote.exit_code == 0
        here = run(remote.scenario, tmp_path / "here")
        # Compared as texts, since NaN (not known) differs from itself.
        assert repr(rows_of(remote.result)) == repr(rows_of(here.result))
        with pytest.raises(StageError) as caught:
            run_text(tmp_path, SLOW, address, limit_s=5)
        line = str(caught.value)
        assert line == "seasons 'first', 'second': took longer than the limit of 5 s"
        # The worker is free again.
        again = QUICK.replace("classes = 1", "classes = 2")
        assert run_text(tmp_path, again, address).exit_code == 0


@pytest.mark.slow
@pytest.mark.parametrize("killed", ["scheduler", "worker", "stopped scheduler"])
def test_killed_in_the_middle_of_a_season(tmp_path: Path, killed: str) -> None:
    with scheduler(tmp_path) as (process, address), worker(address) as working:
        victim = working if killed == "worker" else process
        number = signal.SIGSTOP if killed == "stopped scheduler" else signal.SIGKILL

        def end_it() -> None:
            wait_until(lambda: list((tmp_path / "outputs").glob(".artefacts/project/*.artefact")))
            time.sleep(15)  # the worker is planning by then
            os.killpg(victim.pid, number)

        thread = threading.Thread(target=end_it)
        thread.start()
        line = refusal(tmp_path, SLOW, address)
        thread.join()
    expected = "has had no workers" if killed == "worker" else "no longer answers; all that"
    assert expected in line
    assert list((tmp_path / "outputs").glob(".artefacts/project/*.artefact"))


@pytest.mark.slow
def test_a_season_that_was_done_before_the_scheduler_died_is_written(tmp_path: Path) -> None:
    file = tmp_path / "scenario.toml"
    file.write_text(QUICK + '[[seasons]]\nname = "other"\nuniform = { v = 0.1 }\n')
    with scheduler(tmp_path) as (process, address), worker(address) as working:

        def end_all(event: Event) -> None:
            if event.season and event.status == "done":
                os.killpg(working.pid, signal.SIGKILL)
                os.killpg(process.pid, signal.SIGKILL)

        output = tmp_path / "outputs"
        outcome = run(load_scenario(str(file)), output, scheduler=address, on_event=end_all)
    assert outcome.exit_code == 1
    (failure,) = outcome.failures
    assert "no longer answers" in failure
    (done,) = (plan.name for plan in outcome.result.results if plan.plan)
    with (output / "quick" / "metrics.csv").open(newline="") as rows:
        assert {row["season"] for row in csv.DictReader(rows)} == {done}


@pytest.mark.slow
def test_workers_that_cannot_do_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with scheduler(tmp_path) as (_, address), worker(address):
        monkeypatch.setattr(cluster, "own_identity", lambda: "another")
        assert "runs another version of RENEW" in refusal(tmp_path, QUICK, address)


def test_a_worker_that_does_not_see_the_output_folder(tmp_path: Path) -> None:
    identity = cluster.own_identity()
    assert "the same output folder" in cluster.worker_fault(identity, str(tmp_path / "no"))
    (tmp_path / "scene").touch()
    assert cluster.worker_fault(identity, str(tmp_path / "scene")) == ""
