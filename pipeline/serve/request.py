"""What a page or a program may ask for: the options of `renew go`, but never a path.

Files that it gives are streamed to the disk, and only workers open them.
"""

import contextlib
import hashlib
import json
import re
import shlex
import uuid
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, create_model

from pipeline.errors import Faults, RequestError
from pipeline.machine.files import write_whole, writing
from pipeline.scenario import catalogue
from pipeline.voyage.request import VoyageRequest
from pipeline.voyage.table import Option, help_text, options, spelling

MAX_FILE_BYTES = 500_000_000
"""Largest file that is taken; larger ones are given to `renew go` by their path."""
# Largest size of all files that a server takes, bytes.
_MAX_ALL_BYTES = 4_000_000_000
# A name without any part of a path, and with nothing that a shell or a terminal would act on.
_NAME = re.compile(r"\w[\w()+,=@. -]{0,99}", re.ASCII)
# Length of a file's id: so many hexadecimal digits of the SHA-256 of its content and name.
_ID_DIGITS = 16
# Largest number of drawn areas: more are given to the command line as a file.
_MAX_AREAS = 50
# Largest number of corners of all of them.
_MAX_CORNERS = 5_000
ASKED = tuple(one for one in options(VoyageRequest) if not one.is_of_run)
"""The options that a page may ask for."""

_Text = Annotated[str, Field(max_length=200)]
# A name of the catalogue, or what the server called a file that it was given.
_Source = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
_Corner = tuple[Annotated[float, Field(ge=-360, le=360)], Annotated[float, Field(ge=-90, le=90)]]


class TooLargeError(RequestError):
    """A file is too large."""


class GivenFiles:
    """The files that a server was given, each in a folder below `folder` whose name is its id.

    The same content with the same name is the same file, today and tomorrow.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._files: dict[str, Path] = {}
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
        return self._files[name]

    def keep(self, content: bytes, name: str) -> Path:
        """Keep a file of our own making."""
        path = self._path_of(hashlib.sha256(content), name)
        with writing(self._folder):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, content.decode())
        return self._files.setdefault(path.parent.name, path)

    async def receive(self, name: str, chunks: AsyncIterator[bytes]) -> Path:
        """Write a file to the disk as it comes; return its path.

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
                path = await self._written(unfinished, name, chunks)
                path.parent.mkdir(parents=True, exist_ok=True)
                unfinished.replace(path)
        finally:
            with contextlib.suppress(OSError):
                unfinished.unlink(missing_ok=True)
        return self._files.setdefault(path.parent.name, path)

    async def _written(self, unfinished: Path, name: str, chunks: AsyncIterator[bytes]) -> Path:
        """Write an unfinished file; return the path that it gets when it is complete."""
        digest, size = hashlib.sha256(), 0
        unfinished.parent.mkdir(parents=True, exist_ok=True)
        with unfinished.open("xb") as file:
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
        path = self._path_of(digest, name)
        self._bytes += size if path.parent.name not in self._files else 0
        return path

    def _path_of(self, digest: "hashlib._Hash", name: str) -> Path:
        """Return the path of the file with a content; its id depends on its name as well."""
        digest.update(b"\0" + name.encode())
        return self._folder / digest.hexdigest()[:_ID_DIGITS] / name


def too_large(name: str) -> str:
    """Say that a file is too large."""
    return (
        f"{name} is larger than {MAX_FILE_BYTES:,} bytes; cut it to the region, or give its path "
        "to `renew go` on the command line"
    )


class _DrawnAreas(BaseModel):
    """A voyage: each key is an option of `renew go`, as text.

    Files are named by the `id` that the server gave them; a path is refused.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    areas: tuple[Annotated[tuple[_Corner, ...], Field(min_length=3)], ...] = Field(
        default=(), max_length=_MAX_AREAS, description="Shut areas: rings of lon, lat, degrees."
    )

    def options(self, files: GivenFiles) -> dict[str, Any]:
        """Return what was asked by the names of options, with paths, as text, in place of ids.

        Raises
        ------
        RequestError
            A line for each vessel, source or file that is not known.
        """
        faults = Faults()
        if sum(map(len, self.areas)) > _MAX_CORNERS:
            faults.lines.append(
                f"areas have more than {_MAX_CORNERS:,} corners; give them as a file, in avoid"
            )

        def named(one: Option, text: str) -> str:
            if text in known[one.key]:
                return text
            if one.key == "vessel":
                faults.lines.append(
                    f"vessel = {text!r} is not in the catalogue ({', '.join(known[one.key])}); "
                    "choose one, or give speed, length and turning_circle"
                )
                return ""
            return faults.collect(lambda: str(files.path(text, one.key))) or ""

        known = {one.key: catalogue.choices(one.section) if one.section else () for one in ASKED}
        given: dict[str, Any] = {}
        for one in ASKED:
            value = getattr(self, one.key)
            if value and (one.kind in {"source", "file"} or one.section):
                value = [named(one, text) for text in value] if one.most else named(one, value)
            given[one.key] = list(value) if one.most else value
        if faults.lines:
            raise RequestError(faults.lines)
        if self.areas:
            given["avoid"].append(str(files.keep(_geojson(self.areas), "areas.geojson")))
        return given


def _field(one: Option) -> tuple[Any, Any]:
    """Return the type and the field of an option in JSON."""
    kind: Any = _Source if one.kind in {"source", "file"} else _Text
    text = help_text(one, spelling(VoyageRequest, "page"))
    if one.kind == "flag":
        return bool, Field(default=False, description=text)
    if one.most:
        return tuple[kind, ...], Field(default=(), max_length=one.most, description=text)
    if one.is_required:
        return kind, Field(description=text, examples=[one.example])
    if one.kind == "file":
        return kind | None, Field(default=None, description=text)
    return kind, Field(default="", description=text)


if TYPE_CHECKING:
    PlanRequest = _DrawnAreas
else:
    PlanRequest = create_model(
        "PlanRequest",
        __base__=_DrawnAreas,
        __doc__=_DrawnAreas.__doc__,
        **{one.key: _field(one) for one in ASKED},
    )


def _geojson(areas: tuple[tuple[_Corner, ...], ...]) -> bytes:
    """Return drawn areas as a file that `renew go --avoid` reads."""
    features = [
        {
            "type": "Feature",
            "properties": {"name": f"drawn area {number}"},
            "geometry": {"type": "Polygon", "coordinates": [[*ring, ring[0]]]},
        }
        for number, ring in enumerate(areas, start=1)
    ]
    return json.dumps({"type": "FeatureCollection", "features": features}).encode()


def command_line(given: Mapping[str, Any], name: str, output: Path, *, offline: bool) -> str:
    """Return the command that plans the same, to be typed in a shell."""
    asked = {**given, "name": name, "output": output, "offline": offline}
    typed = [
        word
        for one in options(VoyageRequest)
        if one.group
        for word in one.words(asked.get(one.key))
    ]
    # After "--" nothing is an option: a longitude may begin with a minus.
    return shlex.join(["renew", "go", *typed, "--", given["start"], given["goal"]])
