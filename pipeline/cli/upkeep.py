"""Keep an installation in order: `renew doctor | warm | clean`, and `renew qgis install`.

The doctor checks what a run would report too late or not at all: versions, folders that can be
written, space on the disk, and the account for currents. A fault makes every run fail, or its
results wrong. A warning is about something that only some runs need, such as the account.
"""

import contextlib
import os
import platform
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path
from typing import Literal

import typer

from pipeline.cli import options
from pipeline.cli.terminal import progress_bar
from pipeline.errors import PipelineError, RequestError, StageError
from pipeline.machine.interpreters import begun
from pipeline.machine.paths import folder_to_write, shown
from pipeline.sources.copernicus.client import PASSWORD, USERNAME, has_account, login_fault
from pipeline.texts import clean

_MB = 1e6
# Days in the units of `renew clean --older`.
_DAYS = {"h": 1 / 24, "d": 1.0, "w": 7.0}
_DISTRIBUTION = "renew-planner"
# Time limit for an answer of the service for currents, s.
_LOGIN_S = 8.0
# Free disk below which no run can finish, bytes.
_MIN_DISK = 50e6
# Free disk below which the user is warned, bytes: the largest scenario's results are about 100 MB,
# and its figures another 100 MB.
_GOOD_DISK = 1e9


@dataclass(frozen=True, slots=True)
class Finding:
    """The checked item `what`, its state, details, and a remedy for a warning or a fault."""

    state: Literal["ok", "warning", "fault"]
    what: str
    detail: str
    remedy: str = ""

    def __str__(self) -> str:
        """Return the finding as one line."""
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{self.state:<8} {self.what}: {self.detail}{remedy}"


def examine(output: Path, *, offline: bool = False) -> Iterator[Finding]:
    """Check this machine, the output folder and the account.

    The folder need not exist, and is not created. The login is not checked if `offline`.
    """
    login = begun(partial(check_login, offline=offline))  # while the other checks are made
    checks: dict[str, Callable[[], Finding]] = {
        "libraries": check_libraries,
        "compiler's cache": check_compiler_cache,
        "output folder": partial(check_output, output),
        "login": login.result,
    }
    for what, check in checks.items():
        yield guarded(what, check)


def guarded(what: str, check: Callable[[], Finding]) -> Finding:
    """Run a check; if it raises an error, return the error as a finding."""
    try:
        return check()
    except PipelineError as error:  # its text ends with the remedy
        return Finding("fault", what, str(error))
    except Exception as error:  # noqa: BLE001 - a broken installation may raise anything
        reason = clean(f"{type(error).__name__}: {error}")[:200]
        return Finding("fault", what, f"the check failed ({reason})", "install the package again")


def check_libraries() -> Finding:
    """Check that the required libraries are installed in the required versions."""
    from packaging.requirements import Requirement

    what = "libraries"
    try:
        requirements = [Requirement(line) for line in distribution(_DISTRIBUTION).requires or ()]
    except PackageNotFoundError:
        return Finding("warning", what, f"{_DISTRIBUTION} is not installed", "run `pip install .`")
    system = f"{platform.system()} {platform.machine()}"
    there, wrong = [f"Python {platform.python_version()} on {system}"], []
    for requirement in requirements:
        if requirement.marker is not None and not requirement.marker.evaluate():
            continue
        try:
            installed = version(requirement.name)
        except PackageNotFoundError:
            wrong.append(f"{requirement.name} is missing")
            continue
        there.append(f"{requirement.name} {installed}")
        if not requirement.specifier.contains(installed, prereleases=True):
            wrong.append(f"{there[-1]} is not {requirement.specifier}")
    if wrong:
        return Finding("fault", what, "; ".join(wrong), "install the versions in requirements.lock")
    return Finding("ok", what, ", ".join(there))


def check_compiler_cache() -> Finding:
    """Check the folder where the kernels' machine code is cached."""
    from renew._compiled import cache_folder, cache_is_temporary

    what, folder = "compiler's cache", cache_folder()
    if cache_is_temporary():
        remedy = (
            "set NUMBA_CACHE_DIR to a folder that lasts, or each start may compile for a minute"
        )
        return Finding("warning", what, f"{folder} is temporary", remedy)
    return Finding("ok", what, str(folder))


def check_output(output: Path) -> Finding:
    """Check that the folder of results can be written, and the free space of its disk."""
    what, there = "output folder", folder_to_write(output, "--output")
    while not os.path.lexists(there) and there != there.parent:
        there = there.parent
    try:
        tempfile.TemporaryFile(dir=there).close()
    except OSError:
        remedy = "let this user write it, or name another folder with --output"
        return Finding("fault", what, f"{there} can't be written", remedy)
    free = shutil.disk_usage(there).free
    text = f"{output} ({free / 1e9:.1f} GB free)"
    if free < _MIN_DISK:
        return Finding("fault", what, text, "free some disk, or name another with --output")
    if free < _GOOD_DISK:
        return Finding("warning", what, text, "free some disk: a run writes up to 0.2 GB")
    return Finding("ok", what, text)


def check_login(*, offline: bool) -> Finding:
    """Check that an account is set up and that the service accepts it, without printing it."""
    remedy = f"set {USERNAME} and {PASSWORD}, or run `copernicusmarine login`, to fetch currents"
    try:
        if not has_account():
            return Finding(
                "warning", "login", "no account at the Copernicus Marine Service", remedy
            )
    except (OSError, RuntimeError) as error:
        return Finding("warning", "login", f"the account's file can't be read ({error})", remedy)
    if offline:
        return Finding("ok", "login", "an account is set up, and not tried (--offline)")
    fault, remedy = login_fault(_LOGIN_S)
    if fault:
        return Finding("warning", "login", fault, remedy)
    return Finding("ok", "login", "accepted by the Copernicus Marine Service")


# --- renew warm ---


def warm() -> str:
    """Compile all functions that are not compiled yet, with a bar on a terminal; return a summary.

    Raises RequestError if the compiler is switched off, or NUMBA_CACHE_DIR can't be written;
    StageError if the machine code can't be saved.
    """
    from renew import _compiled

    if not _compiled.is_switched_on():
        raise RequestError("NUMBA_DISABLE_JIT is set, and so nothing would be compiled: unset it")
    folder = _compiled.cache_folder()
    asked = os.environ.get("NUMBA_CACHE_DIR")
    if asked and folder.parent.resolve() != Path(asked).resolve():
        raise StageError(
            f"NUMBA_CACHE_DIR = {asked!r} can't be written; choose another folder, or unset it"
        )
    started = time.perf_counter()
    number = 0
    if not _compiled.has_all():
        from pipeline.machine.workers import first_compilation

        # Before the import below, which compiles a little itself.
        with first_compilation() as finish:
            finish()
        from renew.warming import REHEARSALS, rehearse

        with _counted_compilations() as compiled, progress_bar("Compiling") as bar:
            task = bar.add_task("starting", total=len(REHEARSALS), completed=-1)
            for what in rehearse():
                bar.update(task, advance=1, description=f"{what} ({compiled()} so far)")
            number = compiled()
        _compiled.note_all()
    size = sum(file.stat().st_size for file in folder.iterdir()) / _MB
    seconds = time.perf_counter() - started
    done = "Compiled everything" if number else "Nothing had to be compiled"
    text = f"{done} ({seconds:.1f} s); machine code for "
    text += f"{_compiled.processor()} in {folder} ({size:.1f} MB)"
    if _compiled.cache_is_temporary():
        text += ". That is a temporary folder: set NUMBA_CACHE_DIR to one that lasts"
    return text


@contextlib.contextmanager
def _counted_compilations() -> Iterator[Callable[[], int]]:
    """Yield a function that counts the compiled functions, without those from the cache."""
    from numba.core import event

    with event.install_recorder("numba:compile") as recorder:
        yield lambda: sum(compilation.is_start for _, compilation in recorder.buffer)


# --- renew clean ---


def require_consent() -> None:
    """Ask before the user's land cache is removed; RequestError if there is no terminal.

    Raises typer.Abort if the answer is no.
    """
    from renew._compiled import user_cache

    folder = user_cache()
    if folder is None or not any(folder.glob("*.shoreline*")):
        return
    what = (
        f"--all also removes the world's land in {folder}, which all projects of this "
        "user share; the next plan makes it again in some seconds"
    )
    if not sys.stdin.isatty():
        raise RequestError(f"{what}: add --yes, or leave out --all")
    typer.confirm(f"{what}. Remove it?", abort=True)


def freed(output: Path, *, older: str, everything: bool) -> str:
    """Prune the store of an output folder; return one line on the space that was freed.

    Raises RequestError if `older` is not an age, or there is no store; StageError if a run is using
    the folder.
    """
    from pipeline import session
    from pipeline.machine.store import MAX_STORE_BYTES
    from pipeline.sources.land.osm import remove_cached

    age = re.fullmatch(r"(\d{1,6})([hdw])", older)
    if age is None:
        raise RequestError(
            [f"--older = {older!r} is not an age: give hours, days or weeks, as in 12h, 30d, 2w"]
        )
    days = int(age[1]) * _DAYS[age[2]]
    freed = session.clean(
        output,
        max_bytes=0 if everything else MAX_STORE_BYTES,
        used_before=time.time() - 86_400 * days,
    )
    text = (
        f"Freed {freed.size / _MB:,.1f} MB ({freed.files:,} files); {freed.remaining / _MB:,.1f} "
        f"MB remain in {output / '.artefacts'}"
    )
    if everything and (land := remove_cached()):
        text += f". The world's land was removed from the user's cache, too ({land / _MB:,.1f} MB)"
    return text


# --- renew qgis: the plugin is in `qgis/`, and in the wheel ---

# QGIS runs the plugin in a Python of its own, so it is given the path of this program, which it
# calls.

qgis_app = options.group(help="The plugin for QGIS: tools of its Processing toolbox.")
# Name of the plugin's folder.
_PLUGIN = "renew_routes"


@qgis_app.callback()
def _group() -> None:
    """Keep the name `install`: without this, Typer makes a group of one command that command."""


@options.command(qgis_app, "qgis install")
def install(*, profile: str = "default", plugins: Path | None = None) -> None:
    """Put the plugin into the user's profile of QGIS, in place of an earlier version."""
    if Path(profile).name != profile or profile == "..":
        raise RequestError(f"--profile = {shown(profile)!r} is no name; give one without '/'")
    parent = plugins or _profiles() / profile / "python" / "plugins"
    target = folder_to_write(parent, "--plugins") / _PLUGIN
    if target.exists() and not (target / "metadata.txt").is_file():
        raise RequestError(f"{shown(target)} is something else; move it away")
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(_source(), target, ignore=shutil.ignore_patterns("__pycache__"))
    program = Path(sys.executable).with_name("renew")
    (target / "program.txt").write_text(f"{program}\n", encoding="utf-8")
    typer.echo(
        f"Written to {target}\nStart QGIS anew and tick 'RENEW routes' in Plugins > Manage and "
        f"Install Plugins > Installed, or run `qgis_process plugins enable {_PLUGIN}`"
    )


def _source() -> Path:
    """Return the plugin's folder: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    for place in (package / "qgis" / _PLUGIN, package.parent / "qgis" / _PLUGIN):
        if place.is_dir():
            return place
    raise RequestError(f"no plugin in {package}: the installation is incomplete; install again")


def _profiles() -> Path:
    """Return the folder of QGIS's profiles on Linux."""
    if custom := os.environ.get("QGIS_CUSTOM_CONFIG_PATH"):
        return Path(custom) / "profiles"
    data = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(data) / "QGIS" / "QGIS3" / "profiles"
