"""A night stopped by a signal always reports that to the service."""

import os
import random
import signal
import sys
import threading
import time
from pathlib import Path

import pytest

from tests.pipeline.nightly.killed_nights import night
from tests.pipeline.nightly.nights import plane_night
from tests.pipeline.nightly.ping_service import Service
from tests.pipeline.processes import started, wait_until

SEED = 20_261_123
STOPS = int(os.environ.get("RENEW_NIGHT_STOPS", "20"))


def _stop(folder: Path, service: Service, number: int, after_s: float) -> str:
    """Stop a night after some time; return what it did not report, or printed wrongly."""
    service.asked.clear()
    options = ("--ping", f"{service.url}/ID")
    output = folder / f"out-{random.getrandbits(32):x}"
    with started(*night(folder / "night.toml", output, *options)) as process:
        wait_until(lambda: service.asked)
        threading.Event().wait(after_s)
        process.send_signal(number)
        _, errors = process.communicate(timeout=60)
    if process.returncode in {0, 10}:  # it had ended before
        return (
            ""
            if service.asked == ["/ID/start", "/ID"]
            else f"a success reported as {service.asked}"
        )
    faults = []
    if process.returncode != 128 + number:
        faults.append(f"ended with {process.returncode}")
    if "Traceback" in errors or "Error" in errors:
        faults.append(errors[-1500:])
    if service.asked not in (["/ID/start", "/ID/fail"], ["/ID/start", "/ID"]):
        faults.append(f"reported {service.asked}")
    return "; ".join(faults)


@pytest.mark.slow
def test_every_stop_is_reported(tmp_path: Path, service: Service) -> None:
    plane_night(tmp_path, pairs=30)
    rng = random.Random(SEED)  # noqa: S311 - a test's seed
    faults = {}
    for i in range(STOPS):
        number = (signal.SIGTERM, signal.SIGINT)[i % 2]
        after_s = rng.uniform(0, 20)
        if fault := _stop(tmp_path, service, number, after_s):
            faults[f"stop {i + 1}, {number} after {after_s:.1f} s"] = fault
        print(f"stop {i + 1} of {STOPS}: {fault or 'reported'}", flush=True)  # noqa: T201 - it takes long
    assert faults == {}


_WATCHED = """
import sys, time
from pipeline.cli import failures
from pipeline.cli.night_watch import watched
failures._GRACE_S = 0.5
class Slow:  # what takes longer to close than a stopped process is given
    def __enter__(self): pass
    def __exit__(self, *_): time.sleep(60)
def night():
    with Slow():
        print("ready", flush=True)
        time.sleep(60)
with failures.ending_promptly():
    watched(night, url=sys.argv[1], on_event=lambda event: None)
"""


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_the_end_is_reported_before_anything_is_closed(service: Service, number: int) -> None:
    command = (sys.executable, "-c", _WATCHED, f"{service.url}/ID")
    with started(*command) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        begun = time.monotonic()
        process.send_signal(number)
        _, errors = process.communicate(timeout=30)
        assert process.returncode == 128 + number
        assert time.monotonic() - begun < 20
    assert service.asked == ["/ID/start", "/ID/fail"]
    assert errors.count("\n") == 1


_LOST = """
import os, signal, sys, time
from pipeline.cli.failures import ending_promptly
class Deaf:
    def __del__(self):
        os.kill(os.getpid(), {number})
        for _ in range(1000): pass
with ending_promptly():
    {what}
"""


@pytest.mark.slow
@pytest.mark.gate_share(1)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("what", ["Deaf(); time.sleep(30)", "import atexit; atexit.register(Deaf)"])
def test_a_signal_in_a_destructor_leaves_no_traceback(number: int, what: str) -> None:
    with started(sys.executable, "-c", _LOST.format(number=int(number), what=what)) as process:
        _, errors = process.communicate(timeout=30)
    assert process.returncode == 128 + number
    assert "Traceback" not in errors
    assert "ignored" not in errors
