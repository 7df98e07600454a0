"""What every test has: no network, no screen, a hypothesis profile, and the shared folder."""

import gc
import ipaddress
import itertools
import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

# Before anything imports pyplot: no screen. Before anything imports numpy: no threads of its own,
# which on small arrays wait for each other and for the other process of the tests.
os.environ["MPLBACKEND"] = "Agg"
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import hypothesis
import pytest
from hypothesis.internal.conjecture import providers

from pipeline.findings import other_ways
from pipeline.machine.files import file_lock
from renew._compiled import has_all
from renew.bounds import fuel_lower_bound

ROOT = Path(__file__).resolve().parent.parent
# As the program does (`pipeline.machine.interpreters`): thousands of tests are in use all the time,
# and to look through them after each 700 new objects takes a tenth of the time.
gc.set_threshold(50_000, 20, 50)
# Longest time that a process of the tests waits for what another one makes for both, s.
WAIT_S = 600.0
_GOLDEN = (5**0.5 - 1) / 2
# Folders of such tests.
_SHARING = {"nightly", "serve"}
# Modules with the numbers of cells on which fuel is bounded, and these.
_CELLS = {module: module._CELLS for module in (fuel_lower_bound, other_ways)}
# Quick tests have a fraction of them: a bound holds on any grid, and takes a fifth of a run's time.
_SHARE_OF_CELLS = 1 / 16
# Folders and files of tests that need the planner's own: of the bound, and beside other processes.
_EXACT = {"bounds", "test_determinism.py", "test_other_ways.py", "test_plans.py"}

# The gate draws the same examples for everybody: a red run is the change's doing.
# `make test-new-examples` draws others. No deadline, and slow draws are allowed: the first call of
# a compiled kernel or a loaded machine is no bug.
hypothesis.settings.register_profile(
    "gate",
    derandomize=True,
    database=None,
    deadline=None,
    print_blob=True,
    suppress_health_check=[hypothesis.HealthCheck.too_slow],
)
hypothesis.settings.register_profile(
    "new-examples", parent=hypothesis.settings.get_profile("gate"), derandomize=False
)
hypothesis.settings.load_profile("gate")
# Some examples would be constants from the sources that happen to be imported by then: others in
# each worker, after each edit, and none in a clone below a folder named `test`.
providers.is_local_module_file = lambda _: False  # type: ignore[attr-defined, assignment]


@pytest.hookimpl(tryfirst=True)  # before pytest's own, which leaves out the slow ones
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave in the gate what `gate_share(count)` says of a test's parameters; the rest are slow.

    Steps by the golden ratio spread the choice evenly, also over several parameters. First come the
    tests that share a server or a cluster: a second process takes over from the end, and would
    start its own.
    """
    items.sort(key=lambda item: _SHARING.isdisjoint(item.path.parts))
    cases: dict[tuple[Path, str], list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("gate_share") is not None:
            cases.setdefault((item.path, item.nodeid.partition("[")[0]), []).append(item)
    for like in cases.values():
        (count,) = like[0].get_closest_marker("gate_share").args  # type: ignore[union-attr]
        steps = (int(step * _GOLDEN % 1 * len(like)) for step in itertools.count())
        chosen: set[int] = set()
        while len(chosen) < min(count, len(like)):
            chosen.add(next(steps))
        for number, item in enumerate(like):
            if number not in chosen:
                item.add_marker(pytest.mark.slow)


@pytest.hookimpl(tryfirst=True)  # before any fixture plans
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Bound fuel on grids of fewer cells in quick tests, but for those of the bound itself."""
    is_exact = item.get_closest_marker("slow") or not _EXACT.isdisjoint(item.path.parts)
    for module, cells in _CELLS.items():
        vars(module)["_CELLS"] = cells if is_exact else int(cells * _SHARE_OF_CELLS)


def _is_local(address: object) -> bool:
    """Whether a socket address stays on this machine: a Unix socket, loopback, or a name for it."""
    if not isinstance(address, tuple):
        return True
    host = str(address[0])
    try:
        return ipaddress.ip_address(host.partition("%")[0]).is_loopback
    except ValueError:
        return host in {"", "localhost", socket.gethostname()}


@pytest.fixture(autouse=True)
def _no_network(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Refuse connections that leave the machine, unless the test is marked `network`."""
    if request.node.get_closest_marker("network") is None:
        connect = socket.socket.connect

        def guarded(self: socket.socket, address: Any) -> None:  # noqa: ANN401  # as the socket module has it
            if not _is_local(address):
                pytest.fail(
                    f"a test reached for {address!r}; mark it `network` or serve it locally"
                )
            connect(self, address)

        monkeypatch.setattr(socket.socket, "connect", guarded)


def once(
    tmp_path_factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]
) -> Path:
    """Folder that the first process of a test run fills, and all of them use, none changes.

    Each process of pytest-xdist has a session of its own, and so its own session's fixtures.
    """
    is_one_of_several = "PYTEST_XDIST_WORKER" in os.environ
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if is_one_of_several else base) / name
    with file_lock(folder.with_suffix(".lock"), wait_s=WAIT_S) as held:
        assert held
        made = folder.with_suffix(".made")
        if not made.exists():
            folder.mkdir(exist_ok=True)
            make(folder)
            made.touch()
    return folder


@pytest.fixture(scope="session")
def rehearsed(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Have everything compiled that plans call: `renew warm`, once for all processes.

    `make pytest` has done so before, and says so; where sources have changed since, it is done
    again.
    """
    if os.environ.get("RENEW_IS_WARM") and has_all():
        return
    command = [sys.executable, "-m", "pipeline.cli.main", "warm"]
    once(
        tmp_path_factory,
        "rehearsed",
        lambda _: subprocess.run(command, cwd=ROOT, check=True, capture_output=True),
    )


@pytest.fixture(scope="session")
def root() -> Path:
    """Give the project's root."""
    return ROOT


@pytest.fixture(scope="session")
def shared() -> Path:
    """Give the folder `../shared` of published figures and charts; skip where it is absent."""
    folder = ROOT.parent / "shared"
    if not (folder / "facts").is_dir():
        pytest.skip(
            "needs ../shared (figures and charts kept beside the project), which is not here"
        )
    return folder
