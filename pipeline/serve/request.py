"""What a page or a program may ask for: the options of `renew go`, but never a path."""

import json
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, create_model

from pipeline.errors import Faults, RequestError
from pipeline.scenario import catalogue
from pipeline.serve.files import GivenFiles
from pipeline.voyage.request import VoyageRequest
from pipeline.voyage.table import Option, help_text, options, spelling

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

        known = {one.key: _known_names(one) for one in ASKED}
        given: dict[str, Any] = {}
        for one in ASKED:
            value = getattr(self, one.key)
            if value and (one.kind in {"source", "file"} or one.section):
                value = [named(one, text) for text in value] if one.most else named(one, value)
            given[one.key] = list(value) if one.most else value
        if faults.lines:
            raise RequestError(faults.lines)
        if self.areas:
            given["avoid"].append(str(files.keep(_geojson(self.areas), "areas.geojson").path))
        return given


def _known_names(one: Option) -> tuple[str, ...]:
    """Return the names of the catalogue from which an option chooses."""
    if one.section == "stations":
        return tuple(catalogue.stations())
    return catalogue.names(one.section) if one.section else ()


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
