"""A child process with a deadline: what it runs may hang, and must not hang its parent."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

# Once everything in its session is killed, a child's pipes are at their end at once.
_LAST_WORDS_S = 5.0


@dataclass(frozen=True, slots=True)
class Ended:
    """How a child ended: its exit code, None when it was killed at its deadline; what it said."""

    code: int | None
    answer: str
    errors: str


def run_with_deadline(command: Sequence[str], asked: str, deadline_s: float) -> Ended:
    """Run a command with `asked` as its input; kill it with its children at the deadline."""
    with subprocess.Popen(  # noqa: S603 - the command is this package's own
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
    ) as child:
        try:
            answer, errors = child.communicate(asked, timeout=deadline_s)
        except subprocess.TimeoutExpired:
            _kill(child)
            errors = ""
            with contextlib.suppress(subprocess.TimeoutExpired):
                _, errors = child.communicate(timeout=_LAST_WORDS_S)
            return Ended(None, "", errors)
        except BaseException:
            _kill(child)
            raise
        return Ended(child.returncode, answer, errors)


def _kill(child: subprocess.Popen[str]) -> None:
    """Kill a child with everything that it started in its session."""
    try:
        os.killpg(child.pid, signal.SIGKILL)
    except ProcessLookupError:
        child.kill()
    child.wait()
