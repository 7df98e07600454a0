"""Commands that are run to their end, with what they print."""

import subprocess
import sys
from collections.abc import Mapping
from os import PathLike

Word = str | PathLike[str]
PYTHON = (sys.executable, "-c")
"""The first words of a command that runs a script, which is the next word."""


def ended(
    *command: Word,
    cwd: Word | None = None,
    env: Mapping[str, str] | None = None,
    timeout: float | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run a command, however it ends; `timeout` is in seconds."""
    given = list(map(str, command))
    return subprocess.run(
        given, cwd=cwd, env=env, timeout=timeout, capture_output=True, text=True, check=False
    )


def ran(
    *command: Word,
    cwd: Word | None = None,
    env: Mapping[str, str] | None = None,
    timeout: float | None = None,
) -> str:
    """Run a command that must end well; return what it prints."""
    done = ended(*command, cwd=cwd, env=env, timeout=timeout)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    return done.stdout
