"""Downloads that are kept: each NetCDF file has a sidecar that says what it is, and its hash.

A file is fetched into a workshop of its own and moved in when it is whole and sound; a file
without its sidecar, or with another hash than that says, counts as absent.
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import shutil
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from pipeline import store as artefact

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_WORKSHOP = ".partial"
# A workshop that is older than this is nobody's, whatever process now has its maker's number.
_LEFTOVER_AGE_S = 24 * 3600.0


@dataclass(frozen=True, slots=True)
class Kept:
    """Where a download lies, or would."""

    file: Path

    @property
    def sidecar(self) -> Path:
        """What says what it is."""
        return self.file.with_suffix(".json")

    def facts(self, request: object) -> dict[str, Any] | None:
        """What the sidecar says; None unless it is of this request and fits the file."""
        try:
            facts = json.loads(self.sidecar.read_text(encoding="utf-8"))
            sound = facts["request"] == request and facts["sha256"] == artefact.file_hash(self.file)
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return facts if sound else None

    def keep(self, fresh: Path, facts: dict[str, Any]) -> dict[str, Any]:
        """Move a sound file in with its sidecar; return what that says."""
        facts = {
            **facts,
            "retrieved_utc": datetime.now(UTC).isoformat(timespec="seconds"),
            "bytes": fresh.stat().st_size,
            "sha256": artefact.file_hash(fresh),
        }
        written = fresh.with_suffix(".json")
        written.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
        # The old sidecar fits no new file: killed between the two moves, neither is used.
        fresh.replace(self.file)
        written.replace(self.sidecar)
        return facts

    @contextlib.contextmanager
    def workshop(self) -> Iterator[Path]:
        """Give an empty folder beside the file, gone with all that is in it when the block ends.

        What killed runs left behind is swept, the client's own leftovers included.
        """
        _sweep(self.file.parent)
        name = f"{self.file.stem}.{os.getpid()}.{secrets.token_hex(4)}{_WORKSHOP}"
        folder = self.file.parent / name
        folder.mkdir(parents=True)
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def _sweep(folder: Path) -> None:
    """Remove the workshops of processes that are no more."""
    for leftover in folder.glob(f"*{_WORKSHOP}"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            maker = int(leftover.name.split(".")[-3])
            if not _lives(maker) or time.time() - leftover.stat().st_mtime > _LEFTOVER_AGE_S:
                shutil.rmtree(leftover, ignore_errors=True)


def _lives(process: int) -> bool:
    """Whether a process of this number runs on this machine."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
