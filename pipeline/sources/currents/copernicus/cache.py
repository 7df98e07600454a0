"""Cache of downloads: each NetCDF file has a sidecar with its request, provenance and hash.

A file is downloaded into a staging folder of its own and moved into the cache once it is complete
and has passed the acceptance check. A file without its sidecar, or with another hash than that
gives, counts as absent.
"""

import contextlib
import json
import os
import secrets
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pipeline.machine.storage.store import file_hash

_STAGING_SUFFIX = ".partial"
# Age from which a staging folder is abandoned, s, even if a process has its creator's id: ids are
# used again.
_ABANDONED_AGE_S = 24 * 3600.0


@dataclass(frozen=True, slots=True)
class CachedDownload:
    """A download's place in the cache, whether the file is there or not."""

    file: Path

    @property
    def sidecar(self) -> Path:
        """The JSON file that describes it."""
        return self.file.with_suffix(".json")

    def metadata(self, request: object) -> dict[str, Any] | None:
        """Read the sidecar; None unless it is for this request and matches the file."""
        try:
            metadata = json.loads(self.sidecar.read_text(encoding="utf-8"))
            is_valid = metadata["request"] == request and metadata["sha256"] == file_hash(self.file)
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return metadata if is_valid else None

    def save(self, staged: Path, metadata: dict[str, Any]) -> dict[str, Any]:
        """Move an accepted file into the cache and write its sidecar; return the sidecar."""
        metadata = {
            **metadata,
            "retrieved_utc": datetime.now(UTC).isoformat(timespec="seconds"),
            "bytes": staged.stat().st_size,
            "sha256": file_hash(staged),
        }
        staged_sidecar = staged.with_suffix(".json")
        staged_sidecar.write_text(json.dumps(metadata, indent=2) + "\n", encoding="utf-8")
        # Killed between the two moves, neither is used: the old sidecar does not match the file.
        staged.replace(self.file)
        staged_sidecar.replace(self.sidecar)
        return metadata

    @contextlib.contextmanager
    def staging_folder(self) -> Iterator[Path]:
        """Make an empty folder beside the file, and remove it when the block ends.

        Folders that killed runs left behind are removed too, with the client's own leftovers.
        """
        remove_abandoned(self.file.parent)
        name = f"{self.file.stem}.{os.getpid()}.{secrets.token_hex(4)}{_STAGING_SUFFIX}"
        folder = self.file.parent / name
        folder.mkdir(parents=True)
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def remove_abandoned(folder: Path) -> None:
    """Remove the staging folders of processes that have ended."""
    for staging in folder.glob(f"*{_STAGING_SUFFIX}"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            creator = int(staging.name.split(".")[-3])
            if not _is_running(creator) or time.time() - staging.stat().st_mtime > _ABANDONED_AGE_S:
                shutil.rmtree(staging, ignore_errors=True)


def _is_running(process_id: int) -> bool:
    """Whether a process of this id runs on this machine."""
    try:
        os.kill(process_id, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
