"""Files that the page is given: they are streamed to the disk, and only workers open them."""

import contextlib
import hashlib
import re
import uuid
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import RequestError
from pipeline.machine.files import write_whole, writing

MAX_FILE_BYTES = 500_000_000
"""Largest file that is taken; larger ones are given to `renew go` by their path."""
# Largest size of all files that a server takes, bytes.
_MAX_ALL_BYTES = 4_000_000_000
# A name without any part of a path, and with nothing that a shell or a terminal would act on.
_NAME = re.compile(r"\w[\w()+,=@. -]{0,99}", re.ASCII)
# Length of a file's id: so many hexadecimal digits of the SHA-256 of its content and name.
_ID_DIGITS = 16


class TooLargeError(RequestError):
    """A file is too large."""


@dataclass(frozen=True, slots=True)
class GivenFile:
    """A file on the disk: the `id` by which a request names it, its own name, and its bytes."""

    id: str
    name: str
    size: int
    path: Path


class GivenFiles:
    """The files that a server was given, each in a folder of its own below `folder`.

    The same content with the same name is the same file, today and tomorrow.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._files: dict[str, GivenFile] = {}
        self._bytes = 0  # of all files

    def path(self, name: str, key: str) -> Path:
        """Return the path of a file by its id; `key` says who names it.

        Raises
        ------
        RequestError
            The server was not given such a file.
        """
        if name not in self._files:
            raise RequestError(
                f"{key} = {name!r} is neither in the catalogue nor a file that this server was "
                "given; send the file to /api/files first, and name it by its id"
            )
        return self._files[name].path

    def keep(self, content: bytes, name: str) -> GivenFile:
        """Keep a file of our own making."""
        found = self._named(hashlib.sha256(content), name, len(content))
        with writing(self._folder):
            found.path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(found.path, content.decode())
        return self._files.setdefault(found.id, found)

    async def receive(self, name: str, chunks: AsyncIterator[bytes]) -> GivenFile:
        """Write a file to the disk as it comes.

        Raises
        ------
        RequestError
            The name has parts of a path, or the file is empty; TooLargeError if it, or all files
            together, are too large. Nothing is left of it.
        StageError
            The disk refuses.
        """
        if not _NAME.fullmatch(name):
            raise RequestError(
                f"name = {name[:100]!r} can't be the name of a file here: use up to 100 letters, "
                "digits, spaces and . _ - ( ) + , = @, no folder, and begin with a letter or digit"
            )
        unfinished = self._folder / f"{uuid.uuid4().hex}.part"
        try:
            with writing(self._folder):
                found = await self._written(unfinished, name, chunks)
                found.path.parent.mkdir(parents=True, exist_ok=True)
                unfinished.replace(found.path)
        finally:
            with contextlib.suppress(OSError):
                unfinished.unlink(missing_ok=True)
        return self._files.setdefault(found.id, found)

    async def _written(self, path: Path, name: str, chunks: AsyncIterator[bytes]) -> GivenFile:
        """Write a file to a path; return it as it is to be called."""
        digest, size = hashlib.sha256(), 0
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("xb") as file:
            async for chunk in chunks:
                size += len(chunk)
                if size > MAX_FILE_BYTES:
                    raise TooLargeError(too_large(name))
                if self._bytes + size > _MAX_ALL_BYTES:
                    raise TooLargeError(
                        f"{name}: no room is left; this server takes {_MAX_ALL_BYTES:,} bytes in "
                        "all; start it again"
                    )
                digest.update(chunk)
                file.write(chunk)
        if not size:
            raise RequestError(f"{name} is empty; give a file with content")
        found = self._named(digest, name, size)
        self._bytes += size if found.id not in self._files else 0
        return found

    def _named(self, digest: "hashlib._Hash", name: str, size: int) -> GivenFile:
        """Return the file with a content; its name is part of its id, as its ending says a lot."""
        digest.update(b"\0" + name.encode())
        identity = digest.hexdigest()[:_ID_DIGITS]
        return GivenFile(identity, name, size, self._folder / identity / name)


def too_large(name: str) -> str:
    """Say that a file is too large."""
    return (
        f"{name} is larger than {MAX_FILE_BYTES:,} bytes; cut it to the region, or give its path "
        "to `renew go` on the command line"
    )
