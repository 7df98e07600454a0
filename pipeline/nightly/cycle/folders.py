"""The folders of a night: finished cycles, the one under way, and the link `latest`.

`OUTPUT/<cycle>.partial/` is renamed to `OUTPUT/<cycle>/` once it is whole, and never touched again;
then one rename moves the link. A job that is killed between the two leaves a finished cycle that
`latest` does not name: the next one moves the link.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pipeline.errors import StageError
from pipeline.nightly.request.newest_currents import cycle_time, is_cycle

if TYPE_CHECKING:
    from collections.abc import Iterator
    from datetime import datetime
    from pathlib import Path

LATEST = "latest"
PARTIAL = ".partial"
_LINK = ".latest.link"
_REMOVED = ".removed"
# Errors that say that nothing can be written, whatever is freed.
_READ_ONLY = {errno.EROFS, errno.EACCES, errno.EPERM}


@dataclass(frozen=True)
class Cycles:
    """The cycles in an output folder."""

    output: Path

    @property
    def latest(self) -> str:
        """Name of the cycle that `latest` leads to; "" where there is none."""
        link = self.output / LATEST
        try:
            name = link.readlink().name
        except OSError:
            return ""
        return name if is_cycle(name) and (self.output / name).is_dir() else ""

    def folder(self, cycle: str) -> Path:
        """Return a finished cycle's folder, whether it exists or not."""
        return self.output / cycle

    def partial(self, cycle: str) -> Path:
        """Return the folder of a cycle that is under way, whether it exists or not."""
        return self.output / f"{cycle}{PARTIAL}"

    def finished(self) -> list[str]:
        """Return the names of finished cycles, oldest first; those without a time by their age."""
        found = [path for path in self._folders() if is_cycle(path.name)]
        return [path.name for path in sorted(found, key=_age)]

    def partials(self) -> list[str]:
        """Return the names of cycles that are under way."""
        return sorted(
            path.name.removesuffix(PARTIAL)
            for path in self._folders()
            if path.name.endswith(PARTIAL) and is_cycle(path.name.removesuffix(PARTIAL))
        )

    def is_older(self, cycle: str, time: datetime | None) -> bool:
        """Whether a time is before that of a cycle."""
        that = cycle_time(cycle)
        return that is not None and time is not None and time < that

    def publish(self, cycle: str) -> None:
        """Rename a whole cycle into its place, then point `latest` at it."""
        partial, folder = self.partial(cycle), self.folder(cycle)
        with writing(self.output):
            flush(partial)
            partial.rename(folder)
            flush_folder(self.output)
        self.point_at(cycle)

    def point_at(self, cycle: str) -> None:
        """Replace the link `latest` by one rename."""
        with writing(self.output):
            link = self.output / _LINK
            link.unlink(missing_ok=True)
            link.symlink_to(cycle, target_is_directory=True)
            link.replace(self.output / LATEST)
            flush_folder(self.output)

    def remove_leftovers(self) -> None:
        """Remove what a killed job left: its link, and cycles that were being removed."""
        with contextlib.suppress(OSError):
            (self.output / _LINK).unlink(missing_ok=True)
            for path in self._folders():
                if path.name.endswith(_REMOVED):
                    shutil.rmtree(path, ignore_errors=True)

    def prune(self, keep: int) -> None:
        """Remove the oldest cycles beyond `keep`, and those that were never finished.

        Never what `latest` names. A cycle is moved aside first, so that none is seen in part.
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
        """Give the folders in the output folder."""
        if self.output.is_dir():
            yield from (p for p in self.output.iterdir() if p.is_dir() and not p.is_symlink())


@contextlib.contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Turn errors of the file system into a StageError with a remedy."""
    try:
        yield
    except OSError as error:
        remedy = "free some space, and run again to continue"
        if error.errno in _READ_ONLY:
            remedy = "allow it, or choose another folder with --output"
        raise StageError(f"can't write in {folder}: {error.strerror or error}; {remedy}") from error


def flush(folder: Path) -> None:
    """Wait until a folder's files are on the disk."""
    for path in folder.iterdir():
        if path.is_file():
            _fsync(path)
    flush_folder(folder)


def flush_folder(folder: Path) -> None:
    """Wait until a folder's own entries are on the disk."""
    _fsync(folder)


def _fsync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _age(path: Path) -> tuple[float, str]:
    """Return what cycles are sorted by: their time or, where they have none, their folder's."""
    time = cycle_time(path.name)
    return (path.stat().st_mtime if time is None else time.timestamp()), path.name
