"""Runs `renew` again and again without loading its libraries anew: each run is a forked process.

Each line of its input is a command; it answers with one line of JSON on how that ended.
"""

import atexit
import contextlib
import importlib
import json
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
from pathlib import Path
from typing import Any

import shapely

from tests.robustness.limits import limit_memory

# What commands import when they need it.
_LOADED = (
    *("dask.array", "distributed", "matplotlib.pyplot", "netCDF4", "pyogrio", "xarray", "zarr"),
    *(
        "pipeline.cli.main",
        "pipeline.formats.figures.kinds",
        "pipeline.nightly.night",
        "pipeline.run",
    ),
    *("pipeline.nightly.cases", "pipeline.voyage.one_line"),
)
# Without a word for longer than this, a run counts as hung, s.
MAX_SILENCE_S = 60.0
# Time in which a run must end after SIGTERM, s.
_END_S = 15.0


def load() -> None:
    """Load what commands load, so that each process forked from here has it."""
    for name in _LOADED:
        importlib.import_module(name)
    from pipeline.sources.current_field import LandMask
    from pipeline.sources.land import osm
    from tests.pipeline.kept import keep

    keep()
    LandMask.world()
    osm.OsmLand().land(shapely.box(118.0, 9.0, 119.0, 10.0))


def outcome(command: dict[str, Any]) -> dict[str, object]:
    """Run a command; say how it ended, what it said, and its longest silence and its memory.

    At its first output after `limit_s` it is sent SIGTERM, as by a user who has seen enough.
    """
    # No TemporaryDirectory: each child that ends would remove it.
    streams = [Path(tempfile.mkstemp(prefix="renew-test-")[1]) for _ in range(2)]
    child = os.fork()
    if child == 0:
        _become(command, streams)
    is_quiet = bool({"--quiet", "-q"} & set(command["arguments"]))
    code, silence_s, how, usage = _watched(
        child, streams, float(command["limit_s"]), is_quiet=is_quiet
    )
    stdout, stderr = (stream.read_text("utf-8", errors="replace") for stream in streams)
    for stream in streams:
        stream.unlink()
    return {
        "how": how,
        "exit_code": code,
        "stdout": stdout[-20_000:],
        "stderr": stderr if len(stderr) < 200_000 else stderr[:100_000] + stderr[-100_000:],
        "silence_s": silence_s,
        "peak_mb": usage.ru_maxrss >> 10,
    }


def _become(command: dict[str, Any], streams: list[Path]) -> None:
    """Be the command, and end."""
    code = 70
    try:
        os.setsid()
        os.chdir(command["folder"])
        for number, stream in enumerate((Path(os.devnull), *streams)):
            file = os.open(stream, os.O_RDWR | os.O_APPEND)
            os.dup2(file, number)
        os.environ.update(command.get("variables", {}))
        sys.argv = ["renew", *command["arguments"]]
        limit_memory()
        code = _main()
        with contextlib.suppress(Exception):
            atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


def _main() -> int:
    """Run the command line; return its exit code."""
    from pipeline.cli.main import main

    try:
        main()
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except BaseException:  # noqa: BLE001 - as the interpreter does
        traceback.print_exc()
        return 1
    return 0


def _watched(
    child: int, streams: list[Path], limit_s: float, *, is_quiet: bool
) -> tuple[int | None, float, str, resource.struct_rusage]:
    """Wait for a process: its exit code, longest silence (s), how it ended, what it used.

    A quiet one is expected to say nothing.
    """
    begun = spoke = time.monotonic()
    said, silence_s, pause_s, how = 0, 0.0, 0.002, "ended"
    deadline = begun + limit_s
    while True:
        ended, status, usage = os.wait4(child, os.WNOHANG)
        now = time.monotonic()
        size = sum(stream.stat().st_size for stream in streams)
        if size != said:
            said, spoke = size, now
        silence_s = max(silence_s, now - spoke)
        if ended:
            # What it started must not outlive it.
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child, signal.SIGKILL)
            return os.waitstatus_to_exitcode(status), silence_s, how, usage
        is_silent = silence_s > MAX_SILENCE_S
        spoke_lately = is_quiet or now - spoke < limit_s
        if is_silent or (now > deadline and (how == "stopped" or spoke_lately)):
            if how == "ended" and not is_silent:
                how, deadline = "stopped", now + _END_S
                os.kill(child, signal.SIGTERM)
                continue
            os.killpg(child, signal.SIGKILL)
            _, _, usage = os.wait4(child, 0)
            how = "silent" if is_silent else "does not stop"
            return None, silence_s, how, usage
        time.sleep(pause_s)
        pause_s = min(pause_s * 1.5, 0.1)


def main() -> None:
    """Answer line by line."""
    load()
    for line in sys.stdin:
        print(json.dumps(outcome(json.loads(line))), flush=True)  # noqa: T201 - this is how it answers


if __name__ == "__main__":
    main()
