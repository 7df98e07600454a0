"""Nights whose processes are killed, and a reader that opens `latest` all the while."""

from __future__ import annotations

import contextlib
import json
import os
import random
import re
import shutil
import signal
import sqlite3
import subprocess
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import pyarrow.parquet as pq

from pipeline.nightly.cycles import rows_of_parts
from tests.pipeline.nightly.nights import contents
from tests.pipeline.processes import descendants, renew, started

Victim = Literal["main", "worker", "scheduler"]
# Time within which any night ends, s.
_LONG_S = 1800.0
# Time between two looks of the reader, s: twenty a second.
_READER_S = 0.05


@dataclass
class Reader:
    """Opens `latest` twenty times a second; `faults` lists the times at which it was not whole."""

    output: Path
    count: int = 0
    faults: list[str] = field(default_factory=list)
    cycles: set[str] = field(default_factory=set)
    _ended: threading.Event = field(default_factory=threading.Event)

    @contextlib.contextmanager
    def reading(self) -> Iterator[Reader]:
        """Read all the while."""
        thread = threading.Thread(target=self._read, daemon=True)
        thread.start()
        try:
            yield self
        finally:
            self._ended.set()
            thread.join()

    def _read(self) -> None:
        while not self._ended.wait(_READER_S):
            link = self.output / "latest"
            if not link.is_symlink():
                if self.count:
                    self.faults.append("latest is gone")
                continue
            try:
                self._look(link.resolve())
                self.count += 1
            except Exception as error:  # noqa: BLE001 - whatever it is, a reader has met it
                self.faults.append(repr(error))

    def _look(self, folder: Path) -> None:
        """Open everything, as one who has opened the folder does."""
        said = json.loads((folder / "night.json").read_text())
        assert pq.read_metadata(folder / "cases.parquet").num_rows == said["cases"]
        assert pq.read_metadata(folder / "routes.parquet").num_rows > 0
        assert pq.read_metadata(folder / "history.parquet").num_rows > 0
        assert (folder / "index.html").read_text().endswith("</html>")
        assert (folder / "changes.csv").read_text().startswith("case,")
        with contextlib.closing(
            sqlite3.connect(f"file:{folder}/routes.gpkg?mode=ro", uri=True)
        ) as db:
            assert db.execute("SELECT count(*) FROM routes").fetchone()[0] > 0
        self.cycles.add(folder.name)


def night(file: Path, output: Path, *options: str) -> tuple[str, ...]:
    """Return the command of a night."""
    return (*renew("nightly", "run"), "--config", str(file), "--output", str(output), *options)


def run_to_the_end(file: Path, output: Path, *options: str) -> str:
    """Run a night in a process of its own; return what it printed."""
    with started(*night(file, output, *options)) as process:
        out, err = process.communicate(timeout=_LONG_S)
        assert process.returncode in {0, 10}, err[-2000:]
        return out + err


def killed(
    file: Path,
    output: Path,
    victim: Victim,
    after_s: float,
    *options: str,
    scheduler: subprocess.Popen[str] | None = None,
) -> int:
    """Start a night and kill one of its processes some time later; return the night's exit code.

    A worker is one of the night's own, a process below it; a scheduler is a process beside it.
    """
    with started(*night(file, output, *options)) as process:
        threading.Thread(target=process.stdout.read, daemon=True).start()  # type: ignore[union-attr]
        threading.Thread(target=process.stderr.read, daemon=True).start()  # type: ignore[union-attr]
        deadline = time.monotonic() + after_s
        while time.monotonic() < deadline and process.poll() is None:
            time.sleep(0.02)
        if victim == "main":
            process.kill()
        elif scheduler is not None:
            scheduler.kill()
        elif pool := sorted(workers_of(process.pid)):
            with contextlib.suppress(ProcessLookupError):
                os.kill(random.choice(pool), signal.SIGKILL)  # noqa: S311 - a test's choice
        return process.wait(_LONG_S)


def workers_of(pid: int) -> set[int]:
    """Return the worker processes below a process: a night's own, or those of `dask worker`."""
    found = set()
    for child in descendants(pid):
        with contextlib.suppress(OSError):
            line = Path(f"/proc/{child}/cmdline").read_bytes()
            if b"spawn_main" in line or b"pipeline.machine.workers" in line:
                found.add(child)
    return found


def cases_done(output: Path) -> int:
    """Return the number of cases in the parts of a cycle under way."""
    parts = [part for folder in output.glob("*.partial") for part in rows_of_parts(folder)]
    return len({row["index"] for part in parts for row in part})


def leftovers(output: Path) -> list[str]:
    """Return what is in an output folder that an undisturbed night does not leave."""
    expected = re.compile(
        r"latest|\.nightly\.lock|\.artefacts(/.*)?"
        r"|(\d{4}-\d\d-\d\dT\d\dZ(-\w{8})?|undated-\w{8})(-r\d+)?(/[\w.]+)?"
    )
    found = [str(path.relative_to(output)) for path in output.rglob("*")]
    hidden = [name for name in found if "/." in name or name.endswith(".tmp")]
    return [name for name in found if not expected.fullmatch(name)] + hidden


@dataclass
class Undisturbed:
    """An undisturbed night: the folder it begins from, what it holds, how long it takes, s."""

    file: Path
    start: Path
    held: dict[str, Any]
    seconds: float

    @classmethod
    def made(cls, file: Path, start: Path) -> Undisturbed:
        """Run a night from a copy of a folder."""
        end = start.with_name("undisturbed")
        shutil.copytree(start, end, symlinks=True)
        begun = time.monotonic()
        run_to_the_end(file, end)
        return cls(file, start, contents(end), time.monotonic() - begun)

    def again(self) -> Path:
        """Return a fresh copy of the folder that it begins from."""
        output = self.start.with_name("killed")
        shutil.rmtree(output, ignore_errors=True)
        shutil.copytree(self.start, output, symlinks=True)
        return output
