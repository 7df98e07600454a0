"""The command `doctor`, which checks that this machine can run RENEW.

A fault makes every run fail or its results wrong. A warning is for something that only some runs
need, such as an account. Checks that may hang run in parallel threads and have a time limit.
"""

import json
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

from pipeline.cli import check_machine, check_network
from pipeline.cli.finding import Finding
from pipeline.errors import PipelineError

_REINSTALL = "install the package again"


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
        Background(
            "login", partial(check_network.login, offline=offline), check_network.NETWORK_S + 1
        ),
        Background(
            "scheduler",
            partial(check_network.scheduler, scheduler, output),
            check_network.NETWORK_S,
        ),
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
        ("account", check_network.account),
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
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        return Finding("fault", what, f"the check failed ({reason})", _REINSTALL)


class Background:
    """A check that runs in a separate thread, with a time limit in seconds."""

    def __init__(self, what: str, check: Callable[[], Finding], seconds: float) -> None:
        self._what, self._seconds = what, seconds
        self._end = time.monotonic() + seconds
        self._found: list[Finding] = []
        self._thread = threading.Thread(
            target=lambda: self._found.append(guarded(what, check)), daemon=True
        )
        self._thread.start()

    def finding(self) -> Finding:
        """Return the check's finding, or a fault if it has not ended within its time limit."""
        self._thread.join(max(0.0, self._end - time.monotonic()))
        if self._found:
            return self._found[0]
        detail = f"no answer within {self._seconds:g} s"
        return Finding("fault", self._what, detail, "check the load of the machine and the network")
