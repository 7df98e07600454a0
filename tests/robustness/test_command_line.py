"""The command line ends with a known exit code and without a traceback, however it is used."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.robustness.campaign import draw, number
from tests.robustness.command_lines import CommandLine, odd_command_line, restore, typed_command
from tests.robustness.limits import MAX_CPU_S, MAX_MEMORY_BYTES
from tests.robustness.renew_processes import CODES, NIGHT_CODES, Renew

SAMPLE = range(2, 10)  # none of them waits for a network
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
