"""The command line ends with a known exit code and without a traceback, however it is used.

Commands are as they may be typed: any command and option, values and environments of any kind.
"""

import os
import random
import resource
import shutil
import subprocess
import sys
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.pipeline.nightly.nights import plane_night
from tests.pipeline.small_plane import small_plane
from tests.pipeline.small_region import small_region
from tests.reference import commands
from tests.robustness.limits import MAX_CPU_S, MAX_MEMORY_BYTES, draw, number
from tests.robustness.renew_processes import CODES, NIGHT_CODES, Renew

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
_ODD_WORDS = (
    *("", " ", "-", "--", "-1", "..", "/", "/dev/null", "/proc/self/mem", "~"),
    *("~nobody-of-this-name/x", "$HOME", "a" * 300, "a" * 5000, "船.toml", "caf\udce9.toml"),
    *("a\nb", "*", "{0}", "%s", "single-gyre", "single-gyre.toml", "plain.toml"),
    *("./plain.toml", "folder", "no-access.toml", "loop", "dangling", "pipe", "broken.nc"),
    *("tcp://127.0.0.1:1", "nan", "1e400"),
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


# Values that an option may well have, by its name; what is typed is one of these or anything.
_LIKELY: dict[str, tuple[str, ...]] = {
    "scenario": ("single-gyre", "plain.toml", "./plain.toml", "region.toml"),
    "file": ("single-gyre", "plain.toml", "boston-enc"),
    "name": ("single-gyre", "osm-land", "paper-asv"),
    "case": ("quick", "quick/still", "quick/still/p0001"),
    "--config": ("night.toml", "plain.toml"),
    "--output": ("outputs", "a/b/c", "file", "read-only", "dangling", "loop", "/dev/full"),
    "--charts": ("folder", "broken.nc", "plain.toml", "pipe", "/dev/zero", "/dev/null"),
    "--currents": ("embedded-palawan", "still", "broken.nc", "pipe", "*.nc", "/dev/zero", "folder"),
    "--depths": ("broken.nc", "folder", "pipe", "/dev/zero"),
    "--avoid": ("broken.nc", "folder", "pipe", "plain.toml"),
    "--limit": ("30", "1e9", "0.5", "1e400", "-1"),
    "--scheduler": ("tcp://127.0.0.1:1", "127.0.0.1:1", "http://127.0.0.1:1"),
    "--ping": ("http://127.0.0.1:1", "file:///etc/passwd", "http://127.0.0.1:1/" + "x" * 5000),
    "--only": ("quick", "quick/still/p0001", "single-gyre"),
    "--speed": ("10kn", "5m/s", "4kn..9kn", "9kn..4kn", "1e400kn", "0kn", "-1kn", "10"),
    "--length": ("20m", "300ft", "0m", "1e9km"),
    "--turning-circle": ("100m", "0m", "1e9m"),
    "--draught": ("4m", "400m", "-1m", "nan m"),
    "--month": ("2024-07", "2024-13", "0000-01", "9999-12", "July"),
    "--depart": (
        "2026-11-22T06:00Z",
        "2026-11-22",
        "9999-12-31T23:59Z",
        "now",
        "0001-01-01T00:00Z",
    ),
    "--until": ("2026-11-23T06:00Z", "2020-01-01T00:00Z"),
    "--arrive-by": ("2026-11-23T06:00Z", "2020-01-01T00:00Z"),
    "--via": ("119.1,9.05", "0,0", "91N 0E", "12\u00b048'N 120\u00b018'E"),
    "--clearance": ("100m", "0", "1e9m", "-1m"),
    "--vessel": ("paper-asv", "paper-avs", "20m"),
    "--season": ("still", "summer"),
    "--figure": ("routes", "along", "map"),
    "--format": ("png", "svg", "pdf", "exe"),
    "--older": ("30d", "12h", "0d", "-1d", "9" * 400 + "d", "1e400d"),
    "--name": ("a-name", "../x", "A"),
    "--workers": ("1", "0", "1e9", "-1"),
}
_POSITIONS = (
    *("119.0,9.0", "119.5,9.2", "9.0N 119.0E", "0,0", "180,0", "-180,0", "360,90", "0,-90"),
    *("1e308,0", "nan,nan", "12\u00b048'N 120\u00b018'E", "91N 181E", "119,0,9,0", ",", "N E"),
)


# Commands that end by themselves and soon, whatever the environment is.
_BY_ITSELF = ("run", "plot", "check", "show", "list", "doctor", "clean")
# Weights of commands in the draw, where others have 4: some take long even without a fault.
_WEIGHTS = {"experiments": 1, "warm": 1, "list": 1, "doctor": 1, "plot": 2, "go": 8, "check": 6}


@dataclass(frozen=True)
class CommandLine:
    """Arguments, environment and working folder; `closed` are the standard streams it lacks."""

    arguments: list[str]
    environment: dict[str, str]
    folder: Path
    closed: tuple[int, ...]


def odd_command_line(rng: random.Random, folder: Path) -> CommandLine:
    """Make a command line with an odd environment, in a new folder."""
    arguments = typed_command(rng, folder, _BY_ITSELF)
    environment = {"PATH": os.environ["PATH"], "HOME": str(folder)}
    for name in rng.sample(sorted(_ODD_VARIABLES), rng.choice((0, 1, 1, 2, 4))):
        value = rng.choice(_ODD_VARIABLES[name])
        environment.pop(name, None)
        environment |= {} if value is None else {name: value}
    return CommandLine(
        arguments, environment, folder, rng.choice(((), (), (), (0,), (1,), (2,), (0, 1, 2)))
    )


def typed_command(
    rng: random.Random, folder: Path, among: Collection[str] | None = None
) -> list[str]:
    """Make a command, in a new folder with files of all kinds; return its arguments.

    The command is one of those named, or any.
    """
    fill(folder)
    plane_night(folder / "night")
    for file in (folder / "night").iterdir():
        file.rename(folder / file.name)
    known = {tuple(name.split()[1:]): command for name, command in commands().items()}
    paths = [path for path in known if among is None or path[0] in among]
    (path,) = rng.choices(paths, [_WEIGHTS.get(path[-1], 4) for path in paths])
    words, command = [*path], known[path]
    for parameter in command.params:
        if parameter.param_type_name == "argument" and rng.random() < 0.95:
            words += _arguments(rng, parameter)
    options = [
        one
        for one in command.params
        if one.param_type_name == "option" and "completion" not in one.opts[0]
    ]
    for option in rng.sample(options, min(len(options), rng.choice((0, 1, 2, 3, 6)))):
        words += _option(rng, option) * rng.choice((1, 1, 1, 1, 2))
    if path == ("go",) and rng.random() < 0.5:
        words += ["--speed", "10kn", "--length", "20m", "--turning-circle", "100m"]
    if rng.random() < 0.2:
        at = rng.randrange(len(words) + 1)
        odd = (rng.choice(_ODD_WORDS), "--no-such-option", "--no-such=" + "x" * 5000, "--", "-h")
        words[at:at] = [rng.choice(odd)]
    return [word.replace("\0", "") for word in words]


def _arguments(rng: random.Random, parameter: Any) -> list[str]:  # noqa: ANN401 - as above
    """Return words for an argument."""
    if parameter.nargs == -1:
        likely = ["119.0,9.0", "119.5,9.2"]
        if rng.random() < 0.5:
            return likely
        return [rng.choice((*_POSITIONS, *_ODD_WORDS)) for _ in range(rng.choice((1, 2, 2, 2, 3)))]
    return [_value(rng, parameter.name)]


def _option(rng: random.Random, option: Any) -> list[str]:  # noqa: ANN401 - as above
    """Return the words of an option with its value."""
    name = rng.choice(option.opts)
    if option.is_flag:
        return [name]
    value = _value(rng, option.opts[0])
    return [f"{name}={value}"] if rng.random() < 0.2 else [name, value]


def _value(rng: random.Random, name: str) -> str:
    """Return a value that one may well have, or anything."""
    likely = _LIKELY.get(name, ("x",))
    return rng.choice(likely) if rng.random() < 0.65 else rng.choice(_ODD_WORDS)


def restore(folder: Path) -> None:
    """Let a folder be removed again: its own folders may not be writable."""
    for place in folder.rglob("*"):
        if place.is_dir() and not place.is_symlink():
            os.chmod(place, 0o700)  # noqa: PTH101 - a link's own mode is not meant


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


SAMPLE = range(2, 4)  # none of them waits for a network
EXIT_CODES = {0, 1, 2, 130, 143}
# Time after which a run counts as hung, s: it may wait for the processor, and for a scheduler.
_HUNG_S = 150


def failure_of(line: CommandLine, root: Path) -> str:
    """Run a command line; describe how it failed, or "" where it ended as it must."""

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (3 * MAX_CPU_S, 3 * MAX_CPU_S))
        resource.setrlimit(resource.RLIMIT_DATA, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
        for stream in line.closed:
            os.close(stream)

    code = (
        f"import sys; sys.path.insert(0, {str(root)!r}); from pipeline.cli.main import main; main()"
    )
    try:
        ended = subprocess.run(
            [sys.executable, "-c", code, *line.arguments],
            cwd=line.folder,
            env=line.environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            preexec_fn=limited,
            timeout=_HUNG_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return "hung"
    errors = ended.stderr.decode(errors="replace")
    if "Traceback" in errors or ended.returncode not in EXIT_CODES:
        return f"exit code {ended.returncode}: {errors[-1500:]}"
    return ""


def failures(folder: Path, root: Path, cases: range) -> list[str]:
    """Run odd command lines; describe those that failed."""
    found = []
    for case in cases:
        line = odd_command_line(draw("environments", case), folder / str(case))
        why = failure_of(line, root)
        if why:
            changed = {k: v for k, v in line.environment.items() if k != "PATH"}
            found.append(f"case {case}: {line.arguments} {changed} closed {line.closed}: {why}")
        shutil.rmtree(line.folder, ignore_errors=True)
    return found


def test_a_sample_of_odd_command_lines_ends_as_it_must(tmp_path: Path, root: Path) -> None:
    found = failures(tmp_path, root, SAMPLE)
    assert not found, "\n".join(found)


@pytest.mark.slow
def test_many_odd_environments(tmp_path: Path, root: Path) -> None:
    found = failures(tmp_path, root, range(number("environments", 100)))
    assert not found, "\n".join(found)


def typed_failures(folder: Path, cases: range, renew: Renew) -> list[str]:
    """Run commands as typed; describe those that failed."""
    found = []
    for case in cases:
        place = folder / str(case)
        arguments = typed_command(draw("command lines", case), place)
        # One cache for all: to unpack the world's land for each home takes half a minute.
        cache = str(folder / "cache")
        variables = {"HOME": str(place), "XDG_CACHE_HOME": cache, "RENEW_PING": ""}
        ended = renew(arguments, place, limit_s=5.0, variables=variables)
        if why := ended.fault(NIGHT_CODES if arguments[:1] == ["nightly"] else CODES):
            shown = [word if len(word) < 100 else f"{word[:40]}…{len(word)}" for word in arguments]
            found.append(f"command line {case}: {shown}: {why}")
        restore(place)
        shutil.rmtree(place)
    return found


@pytest.mark.slow
def test_many_commands_as_typed(tmp_path: Path) -> None:
    lines = number("command_lines", 200)
    with Renew() as renew:
        found = typed_failures(tmp_path, range(lines), renew)
        print(f"{lines} command lines: {dict(renew.met)}")  # noqa: T201
    assert not found, "\n".join(found)
    assert renew.met["exit 0"] > lines / 20
