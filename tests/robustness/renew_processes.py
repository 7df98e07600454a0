"""Runs of `renew` as a user starts them, and conditions that the end of each must meet."""

import collections
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from tests.conftest import ROOT
from tests.robustness.limits import MAX_MEMORY_BYTES
from tests.robustness.renew_server import MAX_SILENCE_S

# Largest number of lines that faults take, and of characters of each.
MAX_LINES, MAX_LINE = 60, 840
# Exit codes of a run that ended by itself; those of a night; and of one that was stopped.
CODES = frozenset({0, 1, 2})
NIGHT_CODES = frozenset({0, 1, 2, 4, 5, 10})
_STOPPED = 143


@dataclass(frozen=True)
class Ended:
    """How a run of `renew` ended; `exit_code` is None where it had to be killed."""

    how: str
    exit_code: int | None
    stdout: str
    stderr: str
    silence_s: float
    peak_mb: int

    def fault(self, codes: frozenset[int] = CODES) -> str:
        """Say what is wrong with it, or "" where nothing is."""
        if self.how not in {"ended", "stopped"}:
            return f"{self.how}, after {self.silence_s:.0f} s without a word: {self.stderr[-800:]}"
        if self.exit_code not in (codes if self.how == "ended" else codes | {_STOPPED}):
            return f"exit code {self.exit_code}: {self.stderr[-1500:]}"
        if "Traceback" in self.stderr + self.stdout:
            return f"a traceback: {self.stderr[-3000:]}"
        if self.silence_s > MAX_SILENCE_S or self.peak_mb > MAX_MEMORY_BYTES >> 20:
            return f"{self.silence_s:.0f} s without a word, {self.peak_mb} MB: {self.stderr[-800:]}"
        return self._fault_of_lines()

    def _fault_of_lines(self) -> str:
        """Say what is wrong with the lines that tell of faults."""
        lines = [line for line in self.stderr.splitlines() if not line.startswith("{")]
        if self.exit_code and not (self.stderr or self.stdout).strip():
            return f"exit code {self.exit_code} without a word"
        if len(lines) > MAX_LINES:
            return f"{len(lines)} lines: {lines[:3]}"
        if longest := max(lines, key=len, default=""):
            return f"a line of {len(longest)} characters: {longest}" * (len(longest) > MAX_LINE)
        return ""


@dataclass
class Renew:
    """A process that runs `renew`; commands share its loaded libraries and nothing else."""

    process: subprocess.Popen[str] | None = None
    met: collections.Counter[str] = field(default_factory=collections.Counter)

    def __enter__(self) -> Self:
        """Start it with the first command."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.communicate()

    def __call__(
        self,
        arguments: Sequence[str],
        folder: Path,
        *,
        limit_s: float = 45.0,
        variables: Mapping[str, str] | None = None,
    ) -> Ended:
        """Run a command in a folder."""
        if self.process is None:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "tests.robustness.renew_server"],
                cwd=ROOT,
                env={**os.environ, "PYTHONPATH": str(ROOT), "NO_COLOR": "1"},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        command = {
            "arguments": list(arguments),
            "folder": str(folder),
            "limit_s": limit_s,
            "variables": dict(variables or {}),
        }
        print(json.dumps(command), file=self.process.stdin, flush=True)
        answer: dict[str, Any] = json.loads(self.process.stdout.readline())
        ended = Ended(**answer)
        self.met[f"exit {ended.exit_code}" if ended.how == "ended" else ended.how] += 1
        return ended
