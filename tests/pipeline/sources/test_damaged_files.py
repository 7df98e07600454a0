"""Damaged charts and currents are read or refused with one line: no traceback, hang or crash."""

from __future__ import annotations

import json
import random
import selectors
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from pipeline.sources.current_field import LandMask
from tests.pipeline.sources import mutations

ROOT = Path(__file__).parents[3]
# Limits for each case: CPU time and time until an answer, s, and memory of the process, MB.
MAX_CPU_S, MAX_WAIT_S, MAX_MEMORY_MB = 20.0, 120.0, 2048
# Number of cases, and the seed of the first one.
CASES, SEED = 200, 20261122


@dataclass
class Reader:
    """A process that reads files; it is started again where a file ends it."""

    process: subprocess.Popen[str] | None = None

    def outcome(self, kind: str, path: Path) -> dict[str, Any]:
        """How reading a file ends."""
        if self.process is None:
            command = [sys.executable, "-m", "tests.pipeline.sources.damage_worker"]
            self.process = subprocess.Popen(
                command,
                cwd=ROOT,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        print(json.dumps([kind, str(path)]), file=self.process.stdin, flush=True)
        with selectors.DefaultSelector() as selector:
            selector.register(self.process.stdout, selectors.EVENT_READ)
            answer = self.process.stdout.readline() if selector.select(MAX_WAIT_S) else None
        if answer:
            return dict(json.loads(answer))
        how = "hang" if answer is None else "crash"
        self.close()
        return {"how": how, "said": "", "cpu_s": 0.0, "peak_mb": 0}

    def close(self) -> None:
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.communicate()
            self.process = None


@pytest.fixture(scope="module")
def reader() -> Iterator[Reader]:
    """Give a process that reads files."""
    reader = Reader()
    yield reader
    reader.close()


def fault(outcome: dict[str, Any]) -> str:
    """Say what is wrong with how a case ended, or ""."""
    if outcome["how"] not in {"read", "refused"}:
        return f"{outcome['how']}: {outcome['said']}"
    if outcome["how"] == "refused" and not 20 < len(outcome["said"]) < 4000:
        return f"a refusal of {len(outcome['said'])} characters: {outcome['said'][:200]}"
    if outcome["cpu_s"] > MAX_CPU_S or outcome["peak_mb"] > MAX_MEMORY_MB:
        return f"{outcome['cpu_s']:.1f} s of CPU, {outcome['peak_mb']} MB: {outcome['said']}"
    return ""


@pytest.mark.slow
def test_mutated_files_are_read_or_refused(
    tmp_path: Path, shared: Path, world_mask: LandMask, reader: Reader
) -> None:
    cells = shared / "data" / "charts"
    charts = mutations.make_charts(tmp_path, cells if cells.is_dir() else None)
    originals = charts | mutations.make_currents(tmp_path, world_mask)
    how, faults, slowest = Counter[str](), [], 0.0
    for case in range(CASES):
        rng = random.Random(SEED + case)  # noqa: S311 - damage, not secrets
        kind = list(originals)[case % len(originals)]
        source = "chart" if kind in charts else "current"
        place = tmp_path / f"case-{case}"
        file = mutations.copied(originals[kind], place)
        mutation = rng.choice(mutations.MUTATIONS[kind])
        mutation(file, rng)
        outcome = reader.outcome(source, file)
        how[outcome["how"]] += 1
        slowest = max(slowest, outcome["cpu_s"])
        if said := fault(outcome):
            faults.append(f"case {case}, {kind}, {mutation.__name__}: {said}")
    print(f"{CASES} cases: {dict(how)}; slowest {slowest:.1f} s")  # noqa: T201
    assert not faults, "\n".join(faults)
    assert how["read"] > CASES / 10
    assert how["refused"] > CASES / 4
