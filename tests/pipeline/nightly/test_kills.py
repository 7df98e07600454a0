"""A night is killed or loses power at any time: the next run ends as if nothing had happened."""

import collections
import os
import random
import shutil
from datetime import timedelta
from pathlib import Path

import pytest

from pipeline.nightly.config import load_config
from pipeline.nightly.night import run_night
from tests.pipeline import dask_processes
from tests.pipeline.nightly.killed_nights import (
    Reader,
    Undisturbed,
    Victim,
    killed,
    leftovers,
    night,
    run_to_the_end,
)
from tests.pipeline.nightly.nights import REFERENCE, contents, region_night, write_forecast
from tests.pipeline.processes import started, wait_until
from tests.robustness.power_cuts import Cuts, has_strace

SEED = 20_261_122
# Number of kills of the slow test: of ten, six meet the main process, three a worker, one the
# scheduler.
KILLS = int(os.environ.get("RENEW_NIGHT_KILLS", "10"))
_VICTIMS: tuple[Victim, ...] = (*("main",) * 6, *("worker",) * 3, "scheduler")


@pytest.fixture(scope="module")
def second_night(tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    """Give a night that follows another one, so that a reader has something to read throughout."""
    folder = tmp_path_factory.mktemp("killed")
    file = region_night(folder, departures=3, workers=1)
    write_forecast(folder / "currents" / "m1.nc")
    run_to_the_end(file, folder / "start")
    write_forecast(folder / "currents" / "m1.nc", REFERENCE + timedelta(days=1), seed=7)
    return Undisturbed.made(file, folder / "start")


def kill_and_continue(
    undisturbed: Undisturbed, victim: Victim, fraction: float, folder: Path
) -> str:
    """Kill a night's process and run it again; return what the killed one ended with."""
    output = undisturbed.again()
    with Reader(output).reading() as reader:
        after_s = fraction * undisturbed.seconds
        if victim == "scheduler":
            with dask_processes.cluster(folder, workers=2) as (process, address):
                options = ("--scheduler", address)
                code = killed(
                    undisturbed.file, output, victim, after_s, *options, scheduler=process
                )
        else:
            code = killed(undisturbed.file, output, victim, after_s)
        run_to_the_end(undisturbed.file, output)
    what = f"{victim} killed at {fraction:.2f}, ended with {code}"
    assert reader.faults == [], what
    assert reader.count > 0, what
    assert contents(output) == undisturbed.held, what
    assert leftovers(output) == [], what
    return f"{victim} {code}"


@pytest.mark.parametrize(("victim", "fraction"), [("main", 0.8), ("worker", 0.75)])
@pytest.mark.slow
def test_a_killed_night_continues(
    second_night: Undisturbed, victim: Victim, fraction: float, tmp_path: Path
) -> None:
    ended = kill_and_continue(second_night, victim, fraction, tmp_path)
    assert ended.split()[1] in {"-9", "0", "10"}


@pytest.mark.slow
def test_a_scheduler_that_dies_and_returns(second_night: Undisturbed, tmp_path: Path) -> None:
    """The night ends with a plain reason; started again at the same address, it goes on."""
    output = second_night.again()
    with Reader(output).reading() as reader:
        with dask_processes.cluster(tmp_path, workers=2) as (scheduler, address):
            command = night(second_night.file, output, "--scheduler", address)
            with started(*command) as process:
                wait_until(lambda: list(output.glob("*.partial/parts/*.part")))
                scheduler.kill()
                _, errors = process.communicate(timeout=300)
            assert process.returncode == 1
            assert "no longer answers; all that was done is kept" in errors
            assert list(output.glob("*.partial"))
        port = int(address.rpartition(":")[2])
        with dask_processes.cluster(tmp_path, workers=2, port=port) as (_, same_address):
            assert same_address == address
            run_to_the_end(second_night.file, output, "--scheduler", address)
    assert reader.faults == []
    assert len(reader.cycles) == 2
    assert contents(output) == second_night.held
    assert leftovers(output) == []


@pytest.mark.slow
def test_many_killed_nights_continue(second_night: Undisturbed, tmp_path: Path) -> None:
    rng = random.Random(SEED)  # noqa: S311 - a test's seed
    met: collections.Counter[str] = collections.Counter()
    faults = []
    for i in range(KILLS):
        try:
            ended = kill_and_continue(second_night, _VICTIMS[i % 10], rng.random(), tmp_path)
        except AssertionError as error:
            faults.append(f"kill {i + 1}: {error}")
            ended = "fault"
        met[ended] += 1
        print(f"kill {i + 1} of {KILLS}: {ended}", flush=True)  # noqa: T201 - hours go by
    assert faults == [], dict(met)


@pytest.mark.slow
@pytest.mark.skipif(not has_strace(), reason="needs strace, and the right to use it")
def test_a_power_cut_in_a_night(tmp_path: Path, cluster: str) -> None:
    file, output = region_night(tmp_path, departures=2, workers=1), tmp_path / "out"
    forecast = tmp_path / "currents" / "m1.nc"
    write_forecast(forecast, REFERENCE - timedelta(days=1))
    run_night(load_config(file, output), scheduler=cluster)
    write_forecast(forecast, seed=7)
    shutil.copytree(output, tmp_path / "undisturbed", symlinks=True)
    run_night(load_config(file, tmp_path / "undisturbed"), scheduler=cluster)
    expected = contents(tmp_path / "undisturbed")
    cuts = Cuts(tmp_path, output, "latest", [*night(file, output)])

    def again() -> None:
        run_night(load_config(file, output), scheduler=cluster)
        assert contents(output) == expected
        assert leftovers(output) == []

    count = cuts.start_again(again)
    print(f"night: {cuts.summary}, {count} starts")  # noqa: T201
