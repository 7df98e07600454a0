"""Opens NetCDF 4 files in a process of its own: on a damaged one HDF5 may hang, or crash.

Run as a module, it opens the files that its input names, one a line. It says on its error stream
which one it has begun, so that its end, or its deadline, tells which one is damaged.
"""

import contextlib
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from signal import Signals
from typing import Any

from pipeline.machine.interpreters import ProcessResult, run_python
from pipeline.sources.currents.cf.dataset import is_hdf5

# Time for the process to start, and for each file, s. Opening takes some ms; on slow disks, longer.
_START_S, _FILE_S = 60.0, 2.0
# CPU time of the process, and for each file, s, where the system can limit it.
_START_CPU_S, _FILE_CPU_S = 5.0, 0.2
# Number of values of a variable up to which all are read, as an axis's are.
_MAX_VALUES = 10_000


# What was found of files with some size and time of change: how each is fatal; empty if it isn't.
_found: dict[tuple[Path, int, int], str] = {}


def fatal_files(files: Sequence[Path]) -> dict[Path, str]:
    """Return the NetCDF 4 files on which the library hangs or crashes, with how it does.

    Those that were not looked at before are opened in one process, whose start takes most of it.
    """
    versions = {
        file: (file, file.stat().st_size, file.stat().st_mtime_ns)
        for file in files
        if is_hdf5(file)
    }
    unknown = tuple(file for file, version in versions.items() if version not in _found)
    fatal = dict(_fatal(unknown))
    _found.update({versions[file]: fatal.get(file, "") for file in unknown})
    return {file: _found[version] for file, version in versions.items() if _found[version]}


def _fatal(files: tuple[Path, ...]) -> tuple[tuple[Path, str], ...]:
    """Find the fatal ones of files."""
    found = []
    while files:
        result = _run(files)
        begun = [int(line) for line in result.stderr.split() if line.isdecimal()]
        # Where the process itself can't start, reading the files shows whether that matters.
        if not begun or (result.exit_code is not None and result.exit_code >= 0):
            break
        end = "hangs"
        if result.exit_code is not None and Signals(-result.exit_code).name != "SIGXCPU":
            end = f"ends by {Signals(-result.exit_code).name}"
        fault = f"it is damaged: the HDF5 library {end} on it; fetch it again"
        found.append((files[begun[-1]], fault))
        files = files[begun[-1] + 1 :]
    return tuple(found)


def _run(files: tuple[Path, ...]) -> ProcessResult:
    """Open files in a process."""
    cpu_s = _START_CPU_S + _FILE_CPU_S * len(files)
    return run_python(
        ["-m", __name__],
        "\n".join([str(math.ceil(cpu_s)), *map(str, files)]),
        _START_S + _FILE_S * len(files),
    )


def main() -> None:
    """Open the files that the input names."""
    cpu_s, *files = sys.stdin.read().splitlines()
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (int(cpu_s), int(cpu_s) + 1))
    import netCDF4

    for index, file in enumerate(files):
        print(index, file=sys.stderr, flush=True)  # noqa: T201 - this is how it answers
        # Whatever is raised is raised again where the file is read.
        with contextlib.suppress(Exception), netCDF4.Dataset(file) as dataset:
            dataset.set_auto_maskandscale(False)
            for variable in dataset.variables.values():
                with contextlib.suppress(Exception):
                    _touch(variable)


def _touch(variable: Any) -> None:  # noqa: ANN401 - netCDF4 has no types
    """Read what describes a variable, and all of its values or some."""
    for name in variable.ncattrs():
        variable.getncattr(name)
    variable.chunking()
    if variable.size <= _MAX_VALUES:
        variable[:]
    else:
        for corner in (0, -1):
            variable[(corner,) * variable.ndim]


if __name__ == "__main__":
    main()
