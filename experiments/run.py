"""Run the experiments: environments, all planners on them, tables, figures, one report."""

from __future__ import annotations

import functools
import importlib.util
import pickle
import platform
import tempfile
import time
from collections.abc import Callable, Sequence
from importlib import metadata
from pathlib import Path

import numpy as np

from experiments.environments.loading import Environment, load_environment, load_spec, names
from experiments.environments.model import EnvironmentSpec
from experiments.jobs import Job, Result, run_job
from experiments.plan_of_jobs import QUICK, Design
from experiments.tables.tables import Findings, Results, tables
from experiments.workers import begin_warming, processors, results_of
from pipeline.errors import RequestError, StageError
from pipeline.formats.records import versions
from pipeline.session import session

NAME = "experiments"
"""Folder of the results, in the folder of all results."""

OnResult = Callable[[Result, int, int], None]


def chosen_specs(*, quick: bool, only: Sequence[str] = ()) -> list[EnvironmentSpec]:
    """Environments that were asked for; all, if none is named.

    Raises
    ------
    RequestError
        An unknown environment, or OMPL is not installed.
    """
    if importlib.util.find_spec("ompl") is None:
        raise RequestError(
            [
                "the package 'ompl' is not installed, and the baselines need it: `make setup` "  # noqa: ISC004 - one line
                "installs it, or pip install --group experiments"
            ]
        )
    unknown = [name for name in only if name not in names()]
    if unknown:
        known = ", ".join(names())
        raise RequestError(
            [f"--only {name}: no such environment; there are: {known}" for name in unknown]
        )
    order = only or (QUICK if quick else names())
    return [load_spec(name) for name in dict.fromkeys(order)]


def run(
    specs: Sequence[EnvironmentSpec],
    output: Path,
    *,
    quick: bool = False,
    workers: int | None = None,
    on_result: OnResult | None = None,
) -> Path:
    """Run all planners on some environments, and write the report to `output/experiments/`.

    The same seeds give the same tables. A `quick` run takes one seed and a tenth of each anytime
    planner's budget; so many `workers` (all processors if None) are at work at once. `on_result` is
    called with each result, the number of those done, and of all.

    Raises
    ------
    StageError
        Nothing can be written, or a process was killed.
    """
    from experiments.report.page import write_report

    begin_warming()
    with session(NAME, output) as held:
        environments = tuple(load_environment(spec, held.store) for spec in specs)
        started, count = time.perf_counter(), workers or processors()
        done = _results(environments, Design(specs, quick), count, on_result)
        found = Results(sorted(done, key=lambda result: result.job.name))
        facts = _facts(quick, count, time.perf_counter() - started, done)
        findings = Findings(environments, found, tables(specs, found), facts)
        return write_report(findings, held.directory)


def _results(
    environments: Sequence[Environment],
    design: Design,
    workers: int,
    on_result: OnResult | None,
) -> list[Result]:
    """Run all planners on some environments: ours first, whose padding rivals have to keep."""
    stages = [list(design.ours()), list(design.theirs())]
    in_all = sum(len(stage) for stage in stages)
    done: list[Result] = []
    try:
        with tempfile.TemporaryDirectory(prefix="renew-experiments-") as name:
            folder = Path(name)
            for environment in environments:
                _file(folder, environment.spec.name).write_bytes(pickle.dumps(environment))
            for stage in stages:
                for result in results_of(stage, functools.partial(_work, folder), workers):
                    done.append(result)
                    if on_result is not None:
                        on_result(result, len(done), in_all)
                    if stage is stages[0]:
                        np.save(_padding_file(folder, result.job), result.padding)
    except OSError as error:
        raise StageError(f"experiments: {error.strerror or error}; free some space") from error
    return done


def _work(folder: Path, job: Job) -> Result:
    """Run a job in its process."""
    return run_job(job, _file(folder, job.environment), _padding_file(folder, job))


def _file(folder: Path, environment: str) -> Path:
    """File of an environment, for the processes."""
    return folder / f"{environment}.pickle"


def _padding_file(folder: Path, job: Job) -> Path:
    """File of the padding that rivals must keep in a case."""
    return folder / f"{job.environment}-{job.case}.npy"


def _facts(quick: bool, workers: int, seconds: float, done: Sequence[Result]) -> dict[str, str]:  # noqa: FBT001
    """How the run was made."""
    found = {"ompl": metadata.version("ompl"), **versions()}
    return {
        "kind of run": "quick: one seed, a tenth of the budgets" if quick else "full",
        "runs": f"{len(done)}, {workers} at once",
        "time": f"{seconds / 60:.1f} minutes; processors' time of all runs "
        f"{sum(result.cpu_seconds for result in done) / 60:.1f} minutes",
        "machine": f"{platform.processor() or platform.machine()}, {processors()} processors, "
        f"{platform.system()} {platform.release()}",
        "versions": ", ".join(f"{name} {version}" for name, version in found.items()),
        "seeds": "0, 1, 2, ... of each planner in each case; OMPL's is one more",
    }
