"""CPU time of writing a run's files in a process of its own: `python -m tests.bench.writing FILE`.

FILE is a pickled result; all that writing imports counts, but for reading the result itself.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from pipeline.run import planned_scenario
from pipeline.scenario.loading import load_scenario
from pipeline.write import write
from tests.bench.figure import Figure, at_most

_LIMITS_S = {"palawan-season": 4.0, "palawan-usv": 8.0, "boston-enc": 8.0}
_DATA = Path(__file__).parents[2].parent / "shared" / "data"
_OSCAR = _DATA / "currents" / "oscar_climatology_1992-2012_monthly_third_deg.nc"
# Runs whose least counts; one more before them leaves the bytecode for them.
_RUNS = 3


def figures() -> Iterator[Figure]:
    """Yield the CPU time of writing each scenario's files."""
    for name, limit in _LIMITS_S.items():
        label = f"{name}: CPU of writing"
        needs_data = name == "boston-enc"
        if needs_data and not _DATA.exists():
            yield Figure(label, f"<= {limit:g} s", "not measured: ../shared is not here")
            continue
        with tempfile.TemporaryDirectory() as folder:
            pickled = Path(folder) / "result"
            charts, currents = (_DATA / "charts", (_OSCAR,)) if needs_data else (None, ())
            scenario = load_scenario(name, charts=charts, currents=currents)
            with planned_scenario(scenario, Path(folder), offline=True) as result:
                pickled.write_bytes(pickle.dumps(result))
            yield at_most(label, writing_s(pickled), limit, " s")


def writing_s(pickled: Path) -> float:
    """Least CPU time, s, in which a pickled result was written by fresh processes."""
    environment = {key: os.environ[key] for key in os.environ if key != "PYTHONDONTWRITEBYTECODE"}
    environment["PYTHONPYCACHEPREFIX"] = str(pickled.parent / "bytecode")
    command = [sys.executable, "-m", "tests.bench.writing", str(pickled)]
    times = [
        subprocess.run(command, capture_output=True, check=True, text=True, env=environment).stdout
        for _ in range(1 + _RUNS)
    ]
    return min(map(float, times[1:]))


def _write(pickled: Path) -> None:
    """Write a result, and print the CPU time that it took."""
    result = pickle.loads(pickled.read_bytes())  # noqa: S301 - written by this module
    begin = time.process_time()
    write(result, pickled.parent / "files")
    print(time.process_time() - begin)


if __name__ == "__main__":
    _write(Path(sys.argv[1]))
