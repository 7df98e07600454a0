"""The command `doctor`: checks that this machine can run RENEW.

A fault makes every run fail or its results wrong. If something is missing that only some runs need,
such as an account, that is a warning. Checks that may hang run in threads, all at once, and are
given up after some seconds.
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
        Don't ask the service for currents; a named scheduler is still asked.
    scheduler
        Address of a Dask scheduler; else the one in DASK_SCHEDULER_ADDRESS, if any.
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
    """Spell the findings as one JSON object."""
    return json.dumps(
        {"exit_code": exit_code(findings), "findings": [asdict(one) for one in findings]}
    )


def exit_code(findings: Sequence[Finding]) -> int:
    """1 if there is a fault, else 0."""
    return int(any(one.state == "fault" for one in findings))


def guarded(what: str, check: Callable[[], Finding]) -> Finding:
    """Run a check; if it raises an error, return that as a finding."""
    try:
        return check()
    except PipelineError as error:  # its text ends in the remedy
        return Finding("fault", what, str(error))
    except Exception as error:  # noqa: BLE001 - what is broken may break its check in any way
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        return Finding("fault", what, f"the check failed ({reason})", _REINSTALL)


class Background:
    """A check in a thread of its own, given up after some time."""

    def __init__(self, what: str, check: Callable[[], Finding], seconds: float) -> None:
        self._what, self._seconds = what, seconds
        self._end = time.monotonic() + seconds
        self._found: list[Finding] = []
        self._thread = threading.Thread(
            target=lambda: self._found.append(guarded(what, check)), daemon=True
        )
        self._thread.start()

    def finding(self) -> Finding:
        """Wait for the check, but no longer than its time."""
        self._thread.join(max(0.0, self._end - time.monotonic()))
        if self._found:
            return self._found[0]
        detail = f"no answer within {self._seconds:g} s"
        return Finding("fault", self._what, detail, "check the load of the machine and the network")
