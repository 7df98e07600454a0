"""The command `doctor`, which checks that this machine can run RENEW.

A fault makes every run fail or its results wrong. A warning is for something that only some runs
need, such as an account. Checks that may hang run in parallel threads and have a time limit.
"""

import json
import platform
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from importlib.metadata import version
from pathlib import Path

from pipeline.cli import check_machine
from pipeline.cli.check_machine import Finding
from pipeline.errors import PipelineError
from pipeline.machine.interpreters import begun
from pipeline.machine.paths import folder_to_write
from pipeline.sources.copernicus.client import PASSWORD, USERNAME, has_account, login_fault
from pipeline.texts import clean

_REINSTALL = "install the package again"
# Time limit for answers of the service and the scheduler, s.
NETWORK_S = 8.0
# Libraries whose versions must agree between a run and its workers: results are pickled.
_SAME_ON_WORKERS = ("distributed", "numba", "numpy", "scipy", "shapely")


def examine(
    output: Path, *, offline: bool = False, scheduler: str | None = None
) -> Iterator[Finding]:
    """Check this machine, the output folder, the account and the scheduler.

    Parameters
    ----------
    output
        Folder of results; it need not exist, and is not created.
    offline
        Don't check the login at the service for currents; a named scheduler is still checked.
    scheduler
        Address of a Dask scheduler; default: DASK_SCHEDULER_ADDRESS, if it is set.
    """
    slow = [
        Background("land data", check_machine.land, check_machine.LAND_S + 1),
        Background("login", partial(check_login, offline=offline), NETWORK_S + 1),
        Background("scheduler", partial(check_scheduler, scheduler, output), NETWORK_S),
    ]
    quick: list[tuple[str, Callable[[], Finding]]] = [
        ("Python", check_machine.python),
        ("clock", check_machine.clock),
        ("memory", check_machine.memory),
        ("home", check_machine.home),
        ("output folder", partial(check_machine.output, output)),
        ("compiler's cache", check_machine.compiler_cache),
        ("land's cache", check_machine.land_cache),
        ("libraries", check_machine.libraries),
        ("projections", check_machine.projections),
        ("triangulator", check_machine.triangulator),
        ("tides", check_machine.tides),
        ("account", check_account),
    ]
    for what, check in quick:
        yield guarded(what, check)
    for waiting in slow:
        yield waiting.finding()


def spelled_as_json(findings: Sequence[Finding]) -> str:
    """Return the findings as one JSON object."""
    return json.dumps(
        {"exit_code": exit_code(findings), "findings": [asdict(one) for one in findings]}
    )


def exit_code(findings: Sequence[Finding]) -> int:
    """Return 1 if there is a fault, else 0."""
    return int(any(one.state == "fault" for one in findings))


def guarded(what: str, check: Callable[[], Finding]) -> Finding:
    """Run a check; if it raises an error, return the error as a finding."""
    try:
        return check()
    except PipelineError as error:  # its text ends with the remedy
        return Finding("fault", what, str(error))
    except Exception as error:  # noqa: BLE001 - a broken installation may raise anything
        reason = clean(f"{type(error).__name__}: {error}")[:200]
        return Finding("fault", what, f"the check failed ({reason})", _REINSTALL)


class Background:
    """A check that runs in a separate thread, with a time limit in seconds."""

    def __init__(self, what: str, check: Callable[[], Finding], seconds: float) -> None:
        self._what, self._seconds, self._end = what, seconds, time.monotonic() + seconds
        self._found = begun(partial(guarded, what, check))

    def finding(self) -> Finding:
        """Return the check's finding, or a fault if it has not ended within its time limit."""
        try:
            return self._found.result(max(0.0, self._end - time.monotonic()))
        except TimeoutError:
            detail = f"no answer within {self._seconds:g} s"
            remedy = "check the load of the machine and the network"
            return Finding("fault", self._what, detail, remedy)


def check_account() -> Finding:
    """Check that an account is set up, without printing it."""
    remedy = f"set {USERNAME} and {PASSWORD}, or run `copernicusmarine login`, to fetch currents"
    try:
        if has_account():
            return Finding("ok", "account", "user name and password of Copernicus Marine found")
    except (OSError, RuntimeError) as error:
        return Finding("warning", "account", f"its file can't be read ({error})", remedy)
    return Finding("warning", "account", "none at the Copernicus Marine Service", remedy)


def check_login(*, offline: bool) -> Finding:
    """Check that the service accepts the account."""
    if offline:
        return Finding("ok", "login", "not checked (--offline)")
    if check_account().state != "ok":
        return Finding("warning", "login", "not checked, as there is no account", "see account")
    fault, remedy = login_fault(NETWORK_S)
    if fault:
        return Finding("warning", "login", fault, remedy)
    return Finding("ok", "login", "accepted by the Copernicus Marine Service")


def check_scheduler(address: str | None, output: Path) -> Finding:
    """Check that a Dask scheduler answers and that its workers have this version."""
    import dask

    what, address = "scheduler", address or dask.config.get("scheduler-address", None)
    if address is None:
        return Finding("ok", what, "none named; runs use the cores of this machine")
    folder = str(folder_to_write(output, "--output"))
    try:
        answers = _worker_states(address, folder)
    except Exception as error:  # noqa: BLE001 - libraries raise many kinds
        reason = clean(str(error))[:120] or "no answer in time"
        detail = f"{address} does not answer ({reason})"
        return Finding("fault", what, detail, "check the address, and that the scheduler runs")
    if not answers:
        remedy = f"start workers with `dask worker {address}`"
        return Finding("fault", what, f"{address} has no workers", remedy)
    wrong = differences(worker_state(folder), answers)
    if wrong:
        remedy = "install the same versions on all workers, and give them the output folder"
        return Finding("fault", what, f"{address}: {'; '.join(wrong)}"[:600], remedy)
    count = len(answers)
    text = f"{address} has {count} worker{'s' * (count > 1)} of this version"
    return Finding("ok", what, text)


def _worker_states(address: str, folder: str) -> dict[str, object]:
    """Return the state of each of a scheduler's workers; raise if they do not answer in time."""
    from distributed import Client

    from pipeline.stages.seasons.cluster import quiet, scheduler_workers

    def ask() -> dict[str, object]:
        with Client(address, timeout=NETWORK_S, set_as_default=False) as client:
            answers: dict[str, object] = client.run(worker_state, folder, on_error="return")
            return answers

    with quiet():
        # Check for workers first: a client that can't connect prints a traceback when deleted.
        return begun(ask).result(NETWORK_S) if scheduler_workers(address, NETWORK_S - 2) else {}


def worker_state(folder: str) -> dict[str, str]:
    """Return the versions and settings that must be the same here and on a worker."""
    from pipeline.machine.store import code_hash

    return {
        "Python": platform.python_version(),
        "code": code_hash()[:12],
        **{name: version(name) for name in _SAME_ON_WORKERS},
        f"the folder {folder}": "found" if Path(folder).is_dir() else "missing",
    }


def differences(here: dict[str, str], answers: Mapping[str, object]) -> list[str]:
    """List how workers differ from this process."""
    wrong = []
    for worker, there in answers.items():
        if not isinstance(there, dict):
            wrong.append(f"{worker} can't run this program ({clean(str(there))[:120]})")
            continue
        wrong += [
            f"{worker} has {key} {there.get(key)}, here it is {value}"
            for key, value in here.items()
            if there.get(key) != value
        ]
    return wrong
