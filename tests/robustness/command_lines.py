"""Odd uses of the command line: arguments, environment, working folder, output folder."""

from __future__ import annotations

import os
import random
from dataclasses import dataclass
from pathlib import Path

from tests.pipeline.small_plane import small_plane
from tests.pipeline.small_region import small_region

_PLANE = small_plane("plain")
_REGION = (
    small_region("region")
    + """[[seasons]]
name = "summer"
valid = "2024-07"
currents = ["embedded-palawan"]
[planner]
classes = 1
"""
)
_COMMANDS = ("run", "plot", "check", "show", "list", "doctor", "clean")
ODD_WORDS = (
    "",
    " ",
    "-",
    "--",
    "-1",
    "..",
    "/",
    "/dev/null",
    "/proc/self/mem",
    "~",
    "~nobody-of-this-name/x",
    "$HOME",
    "a" * 300,
    "a" * 5000,
    "船.toml",
    "caf\udce9.toml",
    "a\nb",
    "*",
    "{0}",
    "%s",
    "single-gyre",
    "single-gyre.toml",
    "plain.toml",
    "./plain.toml",
    "folder",
    "no-access.toml",
    "loop",
    "dangling",
    "pipe",
    "broken.nc",
    "tcp://127.0.0.1:1",
    "nan",
    "1e400",
)
_OPTIONS = (
    "--output",
    "--charts",
    "--currents",
    "--offline",
    "--scheduler",
    "--season",
    "--figure",
    "--format",
    "--json",
    "--limit",
    "--strict",
    "--version",
    "--help",
    "--no-such-option",
)
_ODD_VARIABLES: dict[str, tuple[str | None, ...]] = {
    "HOME": (None, "", "/nonexistent", "/dev/null", "relative"),
    "TMPDIR": ("/nonexistent", "/dev/null"),
    "XDG_CACHE_HOME": ("/dev/null", "/proc", ""),
    "NUMBA_CACHE_DIR": ("/dev/null/x", "/proc/x"),
    "NUMBA_DISABLE_JIT": ("0",),
    "LANG": ("C", "xx_YY.nonsense"),
    "LC_ALL": ("C", "POSIX"),
    "PYTHONIOENCODING": ("ascii", "latin-1"),
    "PYTHONUTF8": ("0", "1"),
    "TERM": ("dumb", "", None),
    "COLUMNS": ("1", "0", "-5", "x", "100000"),
    "NO_COLOR": ("1",),
    "FORCE_COLOR": ("1",),
    "TZ": ("Pacific/Kiritimati", "nonsense"),
    "MPLBACKEND": ("tkagg", "nonsense"),
    "MPLCONFIGDIR": ("/dev/null",),
    "PROJ_DATA": ("/nonexistent",),
    "DASK_SCHEDULER_ADDRESS": ("tcp://127.0.0.1:1",),
    "HTTPS_PROXY": ("http://127.0.0.1:1", "nonsense"),
    "PATH": ("", "/nonexistent"),
}


@dataclass(frozen=True)
class CommandLine:
    """Arguments, environment and working folder; `closed` are the standard streams it lacks."""

    arguments: list[str]
    environment: dict[str, str]
    folder: Path
    closed: tuple[int, ...]


def odd_command_line(rng: random.Random, folder: Path) -> CommandLine:
    """Make one, in a new folder."""
    fill(folder)
    arguments = [rng.choice(_COMMANDS)]
    if arguments[0] in {"run", "plot", "check", "show"} and rng.random() < 0.95:
        likely = ("single-gyre", "plain.toml", "./plain.toml")
        arguments.append(rng.choice(likely) if rng.random() < 0.5 else rng.choice(ODD_WORDS))
    if arguments[0] in {"run", "plot", "doctor"} and rng.random() < 0.7:
        outputs = (
            "outputs",
            "a/b/c",
            "file",
            "read-only",
            "dangling",
            "loop",
            "/proc/x",
            "/dev/full",
        )
        arguments += ["--output", rng.choice(outputs)]
    if arguments[0] in {"run", "plot", "doctor"} and rng.random() < 0.6:
        arguments.append("--offline")
    if arguments[0] == "plot":
        arguments += ["--figure", rng.choice(("routes", "along", "x"))]
        arguments += ["--format", rng.choice(("png", "svg", "pdf", "x"))]
    while rng.random() < 0.3:
        arguments.append(rng.choice(_OPTIONS))
        if rng.random() < 0.7:
            arguments.append(rng.choice(ODD_WORDS))
    environment = {"PATH": os.environ["PATH"], "HOME": str(folder)}
    for name in rng.sample(sorted(_ODD_VARIABLES), rng.choice((0, 1, 1, 2, 4))):
        value = rng.choice(_ODD_VARIABLES[name])
        environment.pop(name, None)
        environment |= {} if value is None else {name: value}
    return CommandLine(
        [argument.replace("\0", "") for argument in arguments],
        environment,
        folder,
        rng.choice(((), (), (), (0,), (1,), (2,), (0, 1, 2))),
    )


def fill(folder: Path) -> None:
    """Put files and folders of all kinds into a folder."""
    folder.mkdir(parents=True)
    (folder / "plain.toml").write_text(_PLANE, encoding="utf-8")
    (folder / "file").write_text("no folder", encoding="utf-8")
    (folder / "broken.nc").write_bytes(b"CDF\x01\x00\x00")
    (folder / "folder").mkdir()
    (folder / "no-access.toml").write_text(_PLANE, encoding="utf-8")
    (folder / "no-access.toml").chmod(0)
    (folder / "read-only").mkdir(mode=0o500)
    (folder / "loop").symlink_to("loop")
    (folder / "dangling").symlink_to("nowhere/at/all")
    (folder / "region.toml").write_text(_REGION, encoding="utf-8")
    os.mkfifo(folder / "pipe")
