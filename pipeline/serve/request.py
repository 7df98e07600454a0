"""What a page or a program may ask for: the options of `renew go`, but never a path."""

import json
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from pipeline.errors import Faults, RequestError
from pipeline.scenario import catalogue
from pipeline.serve.files import GivenFiles

# Largest numbers of points on the way, of months, of files of one kind, of areas, and of corners of
# all areas: more are a slip, or are given to the command line as a file.
_MAX_VIA, _MAX_MONTHS, _MAX_FILES, _MAX_AREAS, _MAX_CORNERS = 20, 12, 32, 50, 5_000
# Options that the command line takes as they are, in its order; the page's key is the same.
_TEXTS = (
    *("vessel", "speed", "length", "turning_circle", "draught"),
    *("depart", "until", "arrive_by", "clearance", "datum", "members", "within", "endurance"),
)
_LISTS = ("month", "currents", "via", "avoid", "tide")
_PATHS = ("charts", "depths", "havens")
_FLAGS = ("explain_gap",)

_Text = Annotated[str, Field(max_length=200)]
# A name of the catalogue, or what the server called a file that it was given.
_Source = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
_Corner = tuple[Annotated[float, Field(ge=-360, le=360)], Annotated[float, Field(ge=-90, le=90)]]


class PlanRequest(BaseModel):
    """A voyage: each key is an option of `renew go`, as text.

    Files are named by the `id` that the server gave them; a path is refused.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    start: _Text = Field(examples=["120.30,12.80"])
    goal: _Text = Field(examples=["116.80,7.70"])
    via: tuple[_Text, ...] = Field(default=(), max_length=_MAX_VIA)
    vessel: _Text = Field(default="", description="A vessel of the catalogue.")
    speed: _Text = ""
    length: _Text = ""
    turning_circle: _Text = ""
    draught: _Text = ""
    month: tuple[_Text, ...] = Field(default=(), max_length=_MAX_MONTHS)
    depart: _Text = ""
    until: _Text = ""
    arrive_by: _Text = ""
    currents: tuple[_Source, ...] = Field(
        default=(), max_length=_MAX_FILES, description="Sources of the catalogue, or given files."
    )
    areas: tuple[Annotated[tuple[_Corner, ...], Field(min_length=3)], ...] = Field(
        default=(), max_length=_MAX_AREAS, description="Shut areas: rings of lon, lat, degrees."
    )
    avoid: tuple[_Source, ...] = Field(
        default=(), max_length=_MAX_FILES, description="Given files of shut areas."
    )
    havens: _Source | None = Field(default=None, description="A given file of havens.")
    within: _Text = ""
    endurance: _Text = ""
    clearance: _Text = ""
    charts: _Source | None = Field(default=None, description="A given file of land.")
    depths: _Source | None = Field(default=None, description="A given file of depths.")
    datum: _Text = ""
    tide: tuple[_Source, ...] = Field(
        default=(), max_length=_MAX_FILES, description="Stations of the catalogue, or given files."
    )
    members: _Text = ""
    explain_gap: bool = False

    def options(self, files: GivenFiles) -> dict[str, Any]:
        """Return the options of `renew go` by the names of its parameters, paths as text.

        Raises
        ------
        RequestError
            A line for each vessel, source or file that is not known.
        """
        faults = Faults()
        if self.vessel and self.vessel not in catalogue.names("vessels"):
            known = ", ".join(catalogue.names("vessels"))
            faults.lines.append(
                f"vessel = {self.vessel!r} is not in the catalogue ({known}); choose one, or give "
                "speed, length and turning_circle"
            )
        if sum(map(len, self.areas)) > _MAX_CORNERS:
            faults.lines.append(
                f"areas have more than {_MAX_CORNERS:,} corners; give them as a file, in avoid"
            )

        def path(key: str, name: str) -> str:
            return faults.collect(lambda: str(files.path(name, key))) or ""

        def source(key: str, name: str, known: tuple[str, ...]) -> str:
            return name if name in known else path(key, name)

        sources, stations = catalogue.names("sources"), tuple(catalogue.stations())
        given: dict[str, Any] = {
            "positions": [self.start, self.goal],
            **{key: getattr(self, key) for key in _TEXTS},
            "month": list(self.month),
            "via": list(self.via),
            "currents": [source("currents", one, sources) for one in self.currents],
            "tide": [source("tide", one, stations) for one in self.tide],
            "avoid": [path("avoid", one) for one in self.avoid],
            **{key: path(key, one) for key in _PATHS if (one := getattr(self, key)) is not None},
            **{key: getattr(self, key) for key in _FLAGS},
        }
        if faults.lines:
            raise RequestError(faults.lines)
        if self.areas:
            given["avoid"].append(str(files.keep(_geojson(self.areas), "areas.geojson").path))
        return given


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


def with_paths(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options as `renew go` has them, with paths in place of their texts."""
    given = dict(options)
    given["avoid"] = [Path(one) for one in given.get("avoid") or ()]
    return given | {key: Path(given[key]) for key in _PATHS if given.get(key)}


def command_line(options: Mapping[str, Any], name: str, output: Path, *, offline: bool) -> str:
    """Return the command that plans the same, to be typed in a shell."""
    words = ["renew", "go"]
    for key in (*_TEXTS, *_PATHS):
        if options.get(key):
            words += [_option(key), str(options[key])]
    for key in _LISTS:
        for one in options.get(key) or ():
            words += [_option(key), str(one)]
    words += ["--name", name, "--output", str(output)]
    words += ["--offline"] * offline + [_option(key) for key in _FLAGS if options.get(key)]
    # After "--" nothing is an option: a longitude may begin with a minus.
    return shlex.join([*words, "--", *options["positions"]])


def _option(key: str) -> str:
    """Return the option of a parameter."""
    return f"--{key.replace('_', '-')}"
