"""Checks of the account, the service's login and the scheduler, for `renew doctor`."""

import platform
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

from pipeline.cli.finding import Finding
from pipeline.machine.paths import folder_to_write
from pipeline.sources.copernicus.account import PASSWORD, USERNAME, has_account, login_fault

# Time limit for answers of the service and the scheduler, s.
NETWORK_S = 8.0
# Libraries whose versions must agree between a run and its workers: results are pickled.
_SAME_ON_WORKERS = ("distributed", "numba", "numpy", "scipy", "shapely")


def account() -> Finding:
    """Check that an account is set up, without printing it."""
    remedy = f"set {USERNAME} and {PASSWORD}, or run `copernicusmarine login`, to fetch currents"
    try:
        if has_account():
            return Finding("ok", "account", "user name and password of Copernicus Marine found")
    except (OSError, RuntimeError) as error:
        return Finding("warning", "account", f"its file can't be read ({error})", remedy)
    return Finding("warning", "account", "none at the Copernicus Marine Service", remedy)


def login(*, offline: bool) -> Finding:
    """Check that the service accepts the account."""
    if offline:
        return Finding("ok", "login", "not checked (--offline)")
    if account().state != "ok":
        return Finding("warning", "login", "not checked, as there is no account", "see account")
    fault, remedy = login_fault(NETWORK_S)
    if fault:
        return Finding("warning", "login", fault, remedy)
    return Finding("ok", "login", "accepted by the Copernicus Marine Service")


def scheduler(address: str | None, output: Path) -> Finding:
    """Check that a Dask scheduler answers and that its workers have this version."""
    import dask

    what, address = "scheduler", address or dask.config.get("scheduler-address", None)
    if address is None:
        return Finding("ok", what, "none named; runs use the cores of this machine")
    folder = str(folder_to_write(output, "--output"))
    try:
        answers = _worker_states(address, folder)
    except Exception as error:  # noqa: BLE001 - libraries raise many kinds
        reason = " ".join(str(error).split())[:120] or "no answer in time"
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

    from pipeline.stages.workers.connection import quiet, scheduler_workers, within

    def ask() -> dict[str, object]:
        with Client(address, timeout=NETWORK_S, set_as_default=False) as client:
            answers: dict[str, object] = client.run(worker_state, folder, on_error="return")
            return answers

    with quiet():
        # Check for workers first: a client that can't connect prints a traceback when deleted.
        return within(NETWORK_S, ask) if scheduler_workers(address, NETWORK_S - 2) else {}


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
            wrong.append(f"{worker} can't run this program ({' '.join(str(there).split())[:120]})")
            continue
        wrong += [
            f"{worker} has {key} {there.get(key)}, here it is {value}"
            for key, value in here.items()
            if there.get(key) != value
        ]
    return wrong
