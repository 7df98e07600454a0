"""The folder of an unfinished cycle, with its request and its part files."""

from __future__ import annotations

import contextlib
import json
import shutil
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from pipeline.errors import StageError
from pipeline.machine.files import file_lock, write_whole
from pipeline.nightly.cycle.folders import writing
from pipeline.nightly.cycle.part import Part, parts_in, remove_unfinished

_REQUEST, _PARTS, _MARKS, _LOCK = "request.json", "parts", "marks", "setup.lock"
# Time to wait while another job of the night prepares the folder, s.
_SETUP_S = 60.0


@dataclass(frozen=True)
class Partial:
    """The folder of an unfinished cycle; `started` is the start of its first run (UTC)."""

    folder: Path
    started: datetime

    @classmethod
    def opened(cls, folder: Path, request: str, *, is_alone: bool) -> Partial:
        """Create the folder, or open the one of an earlier run.

        Parameters
        ----------
        request
            Identifies all inputs of the results; part files of another request are removed.
        is_alone
            Whether no other job uses the folder.

        Raises
        ------
        StageError
            Nothing can be written, or the folder has another request and may be in use.
        """
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            with file_lock(folder / _LOCK, wait_s=_SETUP_S):
                found = _request(folder / _REQUEST)
                if found.get("request") != request:
                    if found and not is_alone:
                        raise StageError(
                            f"{folder.name} was begun by another request; run once without --part, "
                            "or remove it"
                        )
                    _empty(folder)
                    now = datetime.now(UTC).isoformat(timespec="seconds")
                    found = {"request": request, "started": now}
                    write_whole(folder / _REQUEST, json.dumps(found) + "\n")
                for name in (_PARTS, _MARKS):
                    (folder / name).mkdir(exist_ok=True)
                if is_alone:
                    remove_unfinished(folder / _PARTS)
                    for path in (folder / _MARKS).iterdir():
                        path.unlink(missing_ok=True)
        return cls(folder, datetime.fromisoformat(found["started"]))

    @property
    def request_file(self) -> Path:
        """A file that all workers must be able to read."""
        return self.folder / _REQUEST

    @property
    def parts_folder(self) -> Path:
        """Folder of the part files."""
        return self.folder / _PARTS

    @property
    def marks_folder(self) -> Path:
        """Folder of the marker files of batches that are being planned."""
        return self.folder / _MARKS

    def parts(self) -> list[Part]:
        """Return the undamaged parts, sorted by first case."""
        return parts_in(self.parts_folder)

    def forget_parts(self) -> None:
        """Remove all parts, so that the next run plans all cases again."""
        with contextlib.suppress(OSError):
            shutil.rmtree(self.parts_folder)

    def clear(self) -> None:
        """Remove everything except the results."""
        with writing(self.folder):
            for name in (_PARTS, _MARKS):
                shutil.rmtree(self.folder / name, ignore_errors=True)
            for name in (_REQUEST, _LOCK):
                (self.folder / name).unlink(missing_ok=True)


def _request(path: Path) -> dict[str, str]:
    """Read the file of the request; return {} if it is missing or damaged."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        datetime.fromisoformat(found["started"])
        return {key: str(found[key]) for key in ("request", "started")}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _empty(folder: Path) -> None:
    """Remove everything in the folder except the lock's file."""
    for path in folder.iterdir():
        if path.name == _LOCK:
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()
