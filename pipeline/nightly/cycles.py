"""The folders of a night: finished cycles, the unfinished cycle, and the link `latest`.

A cycle's name is the reference time of its currents, `2026-11-21T00Z`. If the source has no
reference time, the name is the last time step and a hash, `2026-11-24T18Z-1f0c5a7e`. A cycle that
is planned again, because the request or the data have changed, is called `2026-11-21T00Z-r2`.

The folder `OUTPUT/<cycle>.partial/` keeps the rows of each batch of cases as it ends, so that a
night that was killed continues. When it is complete it is renamed to `OUTPUT/<cycle>/`; after that
it is not changed. A second rename then replaces the link. If a job is killed between the two
renames, the next job replaces the link. Anything else in the link's place is moved to
`OUTPUT/damaged/`, never removed.
"""

import contextlib
import errno
import json
import os
import pickle
import re
import secrets
import shutil
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any, Self

from pipeline.errors import MachineError, StageError
from pipeline.machine.files import file_lock, flush, flush_tree, needed, write_whole
from pipeline.machine.store import load_artefact, write_checked

Row = dict[str, Any]
"""A case's or a route's values by the names of their columns."""
LATEST = "latest"
PARTIAL = ".partial"
DAMAGED = "damaged"
RECORD = "night.json"
"""The file of a cycle that records when and from which inputs it was made."""
# File of an unfinished cycle that identifies all inputs of its results.
_REQUEST = "request.json"
# Folder of an unfinished cycle with the rows of finished batches.
_PARTS = "parts"
_LINK = ".latest.link"
_REMOVED = ".removed"
# Remedies for errors of the file system; the remedy for all others is to free some space.
_ALLOW = "allow it, or choose another folder with --output"
_MOVE = "move away what is in its place, and run again"
_REMEDIES = {
    **dict.fromkeys((errno.EROFS, errno.EACCES, errno.EPERM), _ALLOW),
    **dict.fromkeys((errno.EEXIST, errno.EISDIR, errno.ENOTDIR, errno.ENOTEMPTY), _MOVE),
    errno.EIO: "check the disk",
}
LOCK = ".nightly.lock"
# Time to wait for the lock, s: `renew nightly status` holds it for a moment, to test it.
_WAIT_S = 0.3
UNDATED = "undated"
"""Begins the name of a cycle whose currents have no time."""
# A cycle's name, the time in it, and the number of its revision.
_NAME = re.compile(
    r"((\d{4}-\d{2}-\d{2}T\d{2}(?:\d{2})?Z|undated)(?:-[0-9a-f]{8})?)(?:-r(\d{1,6}))?", re.ASCII
)
_HOUR = "%Y-%m-%dT%HZ"
_MINUTE = "%Y-%m-%dT%H%MZ"


class BusyError(StageError):
    """Another job is running in the same output folder; exit code 4."""

    exit_code = 4


def dated_name(time: datetime) -> str:
    """Return the name of the cycle on currents of a time."""
    return time.strftime(_MINUTE if time.minute else _HOUR)


def cycle_time(cycle: str) -> datetime | None:
    """Return the time in a cycle's name, or None if the name has none."""
    if (match := _NAME.fullmatch(cycle)) is not None:
        for form in (_HOUR, _MINUTE):
            with contextlib.suppress(ValueError):
                return datetime.strptime(match[2], form).replace(tzinfo=UTC)
    return None


def base_of(cycle: str) -> str:
    """Return a cycle's name without the number of its revision, `-r2`."""
    match = _NAME.fullmatch(cycle)
    return cycle if match is None else match[1]


def is_cycle(name: str) -> bool:
    """Whether a folder's name is a cycle's name."""
    return _NAME.fullmatch(name) is not None


@dataclass(frozen=True)
class Cycles:
    """The cycles in an output folder."""

    output: Path

    @property
    def latest(self) -> str:
        """Name of the cycle behind the link `latest`, else of the newest finished cycle, or ""."""
        try:
            name = (self.output / LATEST).readlink().name
        except OSError:
            name = ""
        if is_cycle(name) and self.folder(name).is_dir():
            return name
        return next(reversed(self.finished()), "")

    def is_named(self, cycle: str) -> bool:
        """Whether the link `latest` points at this cycle."""
        link = self.output / LATEST
        return link.is_symlink() and link.resolve() == self.folder(cycle).resolve()

    def up_to_latest(self) -> list[str]:
        """Return the names of finished cycles up to the latest, oldest first."""
        finished, latest = self.finished(), self.latest
        return finished[: finished.index(latest) + 1] if latest else []

    def folder(self, cycle: str) -> Path:
        """Return a finished cycle's folder, whether it exists or not."""
        return self.output / cycle

    def partial(self, cycle: str) -> Path:
        """Return the folder of an unfinished cycle, whether it exists or not."""
        return self.output / f"{cycle}{PARTIAL}"

    def finished(self) -> list[str]:
        """Return the names of finished cycles, oldest first; see `_age`."""
        cycles = [path for path in self._folders() if is_cycle(path.name)]
        return [path.name for path in sorted(cycles, key=_age)]

    def free_name(self, cycle: str) -> str:
        """Return a cycle's name or, if its folder exists already, the name of the next revision."""
        name, number = base_of(cycle), 1
        while os.path.lexists(self.folder(name)):
            number += 1
            name = f"{base_of(cycle)}-r{number}"
        return name

    def partials(self) -> list[str]:
        """Return the names of unfinished cycles."""
        folders = sorted(path.name for path in self._folders())
        names = [name.removesuffix(PARTIAL) for name in folders if name.endswith(PARTIAL)]
        return [name for name in names if is_cycle(name)]

    def publish(self, cycle: str) -> None:
        """Rename a complete cycle's folder to its final name, and then point `latest` at it."""
        partial, folder = self.partial(cycle), self.folder(cycle)
        with writing(self.output):
            flush_tree(partial)
            partial.rename(folder)
            flush(self.output)
        self.point_at(cycle)

    def point_at(self, cycle: str) -> None:
        """Point the link `latest` at a cycle by one rename; move away what else is in its place."""
        with writing(self.output):
            link, latest = self.output / _LINK, self.output / LATEST
            if os.path.lexists(latest) and not latest.is_symlink():
                aside = self.output / DAMAGED
                with contextlib.suppress(OSError):
                    aside.mkdir(exist_ok=True)
                    latest.rename(aside / f"{LATEST}-{secrets.token_hex(4)}")
            link.unlink(missing_ok=True)
            link.symlink_to(cycle, target_is_directory=True)
            link.replace(latest)
            flush(self.output)

    def remove_leftovers(self) -> None:
        """Remove the leftovers of a killed job: its temporary link, and half-removed cycles."""
        with contextlib.suppress(OSError):
            (self.output / _LINK).unlink(missing_ok=True)
            for path in self._folders():
                if path.name.endswith(_REMOVED):
                    shutil.rmtree(path, ignore_errors=True)

    def prune(self, keep: int) -> None:
        """Remove the oldest cycles beyond `keep`, and all unfinished cycles.

        The cycle that `latest` points at stays. A folder is renamed before it is removed, so that
        no incomplete cycle is visible.
        """
        latest = self.latest
        finished = [cycle for cycle in self.finished() if cycle != latest]
        excess = len(finished) + bool(latest) - keep
        doomed = [self.folder(cycle) for cycle in finished[: max(0, excess)]]
        doomed += [self.partial(cycle) for cycle in self.partials()]
        for folder in doomed:
            aside = folder.with_name(f".{folder.name}{_REMOVED}")
            with contextlib.suppress(OSError):
                folder.rename(aside)
                shutil.rmtree(aside, ignore_errors=True)

    def _folders(self) -> Iterator[Path]:
        """Yield the folders in the output folder."""
        if self.output.is_dir():
            yield from (p for p in self.output.iterdir() if p.is_dir() and not p.is_symlink())


@dataclass(frozen=True)
class Partial:
    """The folder of an unfinished cycle, and the rows that earlier runs have left in it.

    `started` is the start of its first run (UTC). `rows` has those of each planned case by its
    index: one for each route, the best first, and then that of the case.
    """

    folder: Path
    started: datetime
    rows: dict[int, list[Row]]

    @classmethod
    def opened(cls, folder: Path, request: str) -> Self:
        """Create the folder, or open the one of an earlier run.

        `request` identifies all inputs of the results: what another request has left is removed.
        Raises StageError if nothing can be written.
        """
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            known = _request(folder / _REQUEST)
            if known.get("request") != request:
                shutil.rmtree(folder)
                folder.mkdir()
                now = datetime.now(UTC).isoformat(timespec="seconds")
                known = {"request": request, "started": now}
                write_whole(folder / _REQUEST, json.dumps(known) + "\n")
            (folder / _PARTS).mkdir(exist_ok=True)
        partial = cls(folder, datetime.fromisoformat(known["started"]), {})
        for rows in rows_of_parts(folder):
            partial._take(rows)
        return partial

    @property
    def request_file(self) -> Path:
        """A file that all workers must be able to read."""
        return self.folder / _REQUEST

    def add(self, rows: list[Row]) -> None:
        """Keep the rows of a batch of cases, in a part named by the first case.

        Raises StageError if the part can't be written.
        """
        with needed(f"can't write in {self.folder}", "free some space and run again"):
            part = self.folder / _PARTS / f"{rows[0]['index']:06}.part"
            write_checked(part, pickle.dumps(rows))
        self._take(rows)

    def clear(self) -> None:
        """Remove the request and all parts: what stays is a cycle's results, if it has any."""
        with writing(self.folder):
            shutil.rmtree(self.folder / _PARTS, ignore_errors=True)
            (self.folder / _REQUEST).unlink(missing_ok=True)

    def _take(self, rows: list[Row]) -> None:
        """Sort rows by their case."""
        for index, of_case in groupby(rows, itemgetter("index")):
            self.rows[index] = list(of_case)


def rows_of_parts(folder: Path) -> Iterator[list[Row]]:
    """Yield the rows of each undamaged part; the cases of a damaged one are planned again."""
    for path in sorted((folder / _PARTS).glob("*.part")):
        rows = load_artefact(path, list)
        if rows is not None:
            yield rows


def _request(path: Path) -> dict[str, str]:
    """Read the file of the request; return {} if it is missing or damaged."""
    try:
        known = json.loads(path.read_text(encoding="utf-8"))
        datetime.fromisoformat(known["started"])
        return {key: str(known[key]) for key in ("request", "started")}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


@contextlib.contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Turn an OSError in the `with` block into a MachineError with a remedy."""
    try:
        yield
    except OSError as error:
        remedy = _REMEDIES.get(error.errno or 0, "free some space, and run again to continue")
        place = error.filename if remedy == _MOVE and error.filename else folder
        what = f"can't write in {place}"
        raise MachineError(f"{what}: {error.strerror or error}; {remedy}") from error


def _age(path: Path) -> tuple[float, int, str]:
    """Return a cycle's sort key: the time in its name or, without one, the time in its record."""
    time, match = cycle_time(path.name), _NAME.fullmatch(path.name)
    if time is not None and match is not None:
        return time.timestamp(), int(match[3] or 1), path.name
    record = path / RECORD
    return (record if record.exists() else path).stat().st_mtime, 1, path.name


@contextlib.contextmanager
def night_lock(output: Path) -> Iterator[None]:
    """Hold the lock of an output folder.

    Raises BusyError if another job holds the lock; StageError if nothing can be written in the
    folder.
    """
    path = output / LOCK
    with contextlib.ExitStack() as held:
        with writing(output):
            is_held = held.enter_context(file_lock(path, wait_s=_WAIT_S))
            if is_held:
                now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
                holder = {"pid": os.getpid(), "host": socket.gethostname(), "since": now}
                path.write_text(json.dumps(holder) + "\n", encoding="utf-8")
        if not is_held:
            raise BusyError(f"another job is at work in {output}: {holder_of(output)}")
        yield


def holder_of(output: Path) -> str:
    """Return the holder that the lock's file names, as text."""
    try:
        holder = json.loads((output / LOCK).read_text(encoding="utf-8"))
        return f"process {int(holder['pid'])} on {holder['host']}, since {holder['since']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "a process that is just beginning"


def is_busy(output: Path) -> bool:
    """Whether a job holds the lock; writes nothing."""
    path = output / LOCK
    if not path.is_file():
        return False
    with contextlib.suppress(OSError), file_lock(path) as is_free:
        return not is_free
    return True
