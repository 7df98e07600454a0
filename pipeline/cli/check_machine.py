"""Checks of this machine and of its installation, for `renew doctor`."""

import os
import platform
import resource
import shutil
import sys
import tempfile
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, distribution, version
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

import psutil
from packaging.requirements import Requirement

from pipeline.machine.interpreters import run_python
from pipeline.machine.paths import folder_to_write
from pipeline.scenario import catalogue
from pipeline.sources.land.osm import cache_file

State = Literal["ok", "warning", "fault"]
_DISTRIBUTION = "renew-planner"
_PYTHON, _NEXT_PYTHON = (3, 11), (3, 14)
# Time limit for reading the land, s.
LAND_S = 15.0
# Free disk, bytes: the largest scenario's results are about 100 MB, and its figures another 100 MB.
_MIN_DISK, _GOOD_DISK = 50e6, 1e9
# Free memory, bytes: a run on a region of 1,000 km takes about 1 GB.
_GOOD_MEMORY = 1.5e9
# Tolerance for a clock that is behind the time of installation, s.
_CLOCK_S = 86_400.0
_LAST_YEAR = 2100

# Prints the size of the world's land (WKB) and its first bytes: a little-endian MultiPolygon.
_READ_LAND = (
    "from roaring_landmask import LandmaskProvider, Shapes\n"
    "wkb = Shapes.wkb(LandmaskProvider.Osm)\n"
    "print(len(wkb), wkb[:5].hex())\n"
)
_LAND_HEAD = "0106000000"


@dataclass(frozen=True, slots=True)
class Finding:
    """The checked item `what`, its state, details, and a remedy for a warning or a fault."""

    state: State
    what: str
    detail: str
    remedy: str = ""

    def __str__(self) -> str:
        """Return the finding as one line."""
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{self.state:<8} {self.what}: {self.detail}{remedy}"


def python() -> Finding:
    """Check the version of Python."""
    text = f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    if sys.version_info[:2] < _PYTHON:
        return Finding("fault", "Python", text, "use Python 3.11, 3.12 or 3.13")
    if sys.version_info[:2] >= _NEXT_PYTHON:
        return Finding("warning", "Python", f"{text}, not tested", "use Python 3.13")
    return Finding("ok", "Python", text)


def clock() -> Finding:
    """Check the clock: requests for currents and checks of certificates depend on it."""
    now, installed = time.time(), Path(__file__).stat().st_mtime
    text = f"{datetime.fromtimestamp(now, UTC):%Y-%m-%d %H:%M} UTC"
    remedy = "set the clock, or start the service after the time is synchronised"
    if now + _CLOCK_S < installed:
        made = f"{datetime.fromtimestamp(installed, UTC):%Y-%m-%d}"
        return Finding(
            "fault", "clock", f"{text}, before this program was installed ({made})", remedy
        )
    if datetime.fromtimestamp(now, UTC).year > _LAST_YEAR:
        return Finding("fault", "clock", f"{text}, which can't be right", remedy)
    return Finding("ok", "clock", text)


def memory() -> Finding:
    """Check the memory that a run can use: the least of free memory and limits."""
    free = float(psutil.virtual_memory().available)
    limits = {"free": free, "limit of the control group": _group_memory()}
    for name, kind in (("ulimit -v", resource.RLIMIT_AS), ("ulimit -d", resource.RLIMIT_DATA)):
        soft = resource.getrlimit(kind)[0]
        limits[name] = None if soft == resource.RLIM_INFINITY else float(soft)
    known = {name: least for name, least in limits.items() if least is not None}
    name = min(known, key=lambda key: known[key])
    text = f"{known[name] / 1e9:.1f} GB ({name})"
    if known[name] < _GOOD_MEMORY:
        return Finding("warning", "memory", text, "large regions need up to 2 GB")
    return Finding("ok", "memory", text)


def _group_memory() -> float | None:
    """Return the memory limit of this process's control group, bytes; None if it has none."""
    try:
        group = Path("/proc/self/cgroup").read_text().strip().rpartition("::")[2].strip("/")
        text = (Path("/sys/fs/cgroup") / group / "memory.max").read_text().strip()
    except OSError:
        return None
    return float(text) if text.isdigit() else None


def home() -> Finding:
    """Check the user's home folder."""
    try:
        home = Path.home()
    except RuntimeError:
        return Finding("warning", "home", "this user has none", _home_remedy())
    if not home.is_dir() or not _can_write(home):
        return Finding("warning", "home", f"{home} can't be written", _home_remedy())
    return Finding("ok", "home", str(home))


def _home_remedy() -> str:
    """Return the remedy for a missing home folder."""
    return (
        "set NUMBA_CACHE_DIR to a folder that lasts, and the two variables of the account "
        "(docs/how-to/operation.md)"
    )


def output(output: Path) -> Finding:
    """Check that the folder of results can be written, and the free space of its disk."""
    what, there = "output folder", _existing(folder_to_write(output, "--output"))
    if not _can_write(there):
        remedy = "let this user write it, or name another folder with --output"
        return Finding("fault", what, f"{there} can't be written", remedy)
    free = shutil.disk_usage(there).free
    text = f"{output} ({free / 1e9:.1f} GB free)"
    if free < _MIN_DISK:
        return Finding("fault", what, text, "free some disk, or name another with --output")
    if free < _GOOD_DISK:
        return Finding("warning", what, text, "free some disk: a run writes up to 0.2 GB")
    return Finding("ok", what, text)


def _existing(folder: Path) -> Path:
    """Return the folder or, if it does not exist, its nearest existing parent."""
    while not os.path.lexists(folder) and folder != folder.parent:
        folder = folder.parent
    return folder


def _can_write(folder: Path) -> bool:
    """Whether a file can be created in a folder."""
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def compiler_cache() -> Finding:
    """Check the folder where the kernels' machine code is cached."""
    from renew._compiled import cache_folder, cache_is_temporary

    what, folder = "compiler's cache", cache_folder()
    if cache_is_temporary():
        remedy = (
            "set NUMBA_CACHE_DIR to a folder that lasts, or each start may compile for a minute"
        )
        return Finding("warning", what, f"{folder} is temporary", remedy)
    return Finding("ok", what, str(folder))


def land_cache() -> Finding:
    """Check the cache of the world's land; without it, each region unpacks the land again."""
    what, path = "land's cache", cache_file("Osm")
    if path is not None and path.is_file():
        return Finding("ok", what, f"{path} ({path.stat().st_size / 1e6:.0f} MB)")
    if path is not None and _can_write(_existing(path.parent)):
        return Finding("ok", what, f"{path}, made by the first run")
    where = "this user has no home" if path is None else f"{path.parent} can't be written"
    remedy = (
        "set XDG_CACHE_HOME to a folder that lasts, or land takes some seconds more for each region"
    )
    return Finding("warning", what, where, remedy)


# --- the installation -------------------------------------------------------------------------


def libraries() -> Finding:
    """Check that the required libraries are installed in the required versions."""
    what = "libraries"
    try:
        requirements = [Requirement(one) for one in distribution(_DISTRIBUTION).requires or ()]
    except PackageNotFoundError:
        return Finding("warning", what, f"{_DISTRIBUTION} is not installed", "run `pip install .`")
    found, wrong = [], []
    for requirement in requirements:
        if requirement.marker is not None and not requirement.marker.evaluate():
            continue
        try:
            installed = version(requirement.name)
        except PackageNotFoundError:
            wrong.append(f"{requirement.name} is missing")
            continue
        found.append(f"{requirement.name} {installed}")
        if not requirement.specifier.contains(installed, prereleases=True):
            wrong.append(f"{found[-1]} is not {requirement.specifier}")
    if wrong:
        return Finding("fault", what, "; ".join(wrong), "install the versions in requirements.lock")
    return Finding("ok", what, ", ".join(found))


def projections() -> Finding:
    """Check that PROJ finds its database; PROJ_DATA may point at another release's."""
    import pyproj

    what, text = "projections", f"PROJ {pyproj.proj_version_str}"
    try:
        pyproj.CRS.from_epsg(32651)
    except pyproj.exceptions.CRSError:
        return Finding("fault", what, f"{text} finds no database", "unset PROJ_DATA and PROJ_LIB")
    return Finding("ok", what, text)


def triangulator() -> Finding:
    """Report which library triangulates: Triangle if it is installed, else GEOS."""
    import shapely

    if find_spec("triangle") is None:
        return Finding("ok", "triangulator", f"GEOS {shapely.geos_version_string}")
    import triangle  # noqa: F401 - only to check that it can be loaded

    return Finding("ok", "triangulator", f"Triangle, package {version('triangle')}")


def tides() -> Finding:
    """Report whether the library that predicts the tide is installed, and for which stations."""
    if find_spec("pyfes") is None:
        remedy = "run `pip install 'pyfes<2026.10'`, to count on the tide"
        return Finding("warning", "tides", "pyfes is not installed", remedy)
    stations = ", ".join(catalogue.stations()) or "none"
    return Finding(
        "ok", "tides", f"pyfes {version('pyfes')}; stations of the catalogue: {stations}"
    )


def land() -> Finding:
    """Check the world's land in a separate process, because reading it blocks all other threads."""
    what = "land data"
    result = run_python(["-c", _READ_LAND], "", LAND_S)
    if result.exit_code is None:
        detail = f"not read within {LAND_S:g} s"
        return Finding("warning", what, detail, "check the load of the machine")
    size, _, head = result.stdout.partition(" ")
    if result.exit_code or head.strip() != _LAND_HEAD:
        last = result.stderr.strip().rpartition("\n")[2][:200]
        detail = f"can't be read ({last or 'damaged'})"
        return Finding("fault", what, detail, "install roaring-landmask again")
    release = version("roaring-landmask")
    return Finding("ok", what, f"{int(size) / 1e6:.0f} MB, roaring-landmask {release}")
