"""The catalogue: models of its vessels and sources, and how its files are found and read."""

import hashlib
import json
import math
import tomllib
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import Field, TypeAdapter, model_validator

from pipeline.errors import RequestError
from pipeline.machine.paths import NOT_THERE, expanded, shown as shown_path, unreadable_reason
from pipeline.scenario import strict
from pipeline.scenario.region import ChartSpec
from pipeline.scenario.season import Season, Speed
from pipeline.scenario.strict import StrictModel, near_miss, shown

# The limit of `renew.Vessel`: larger figures are typing errors, and their powers overflow.
_Figure = Annotated[strict.Positive, Field(le=1e6)]
# Acceleration to the side, m/s², that no vessel turns with: that of gravity.
_MAX_SIDEWAYS_M_S2 = 9.81
# Largest circle, m: IMO's MSC.137(76) asks for five lengths at most, 2.3 km for the longest ship.
_MAX_CIRCLE_M = 20_000.0


# The name of a vessel that was given none.
_UNNAMED = "vessel"


class VesselLimits(StrictModel):
    """Weather beyond which the vessel does not go."""

    wave_m: _Figure | None = None
    period_s: _Figure | None = None
    wind_m_s: _Figure | None = None
    gust_m_s: _Figure | None = None
    leeway: _Figure | None = Field(default=None, le=0.5)


# A watt-hour, joules.
_WH_J = 3600.0


class PowerSpec(StrictModel):
    """What the vessel burns, in watts, and what it has on board."""

    w_at_m_s: tuple[tuple[strict.Positive, strict.Positive], ...] = ()
    coefficient: strict.Positive | None = Field(default=None, le=1e12)
    exponent: strict.Number | None = Field(default=None, ge=1, le=20)
    hotel_w: strict.NonNegative = Field(default=0.0, le=1e12)
    battery_wh: strict.Positive | None = None
    tank_l: strict.Positive | None = None
    wh_per_l: strict.Positive | None = None
    reserve: strict.NonNegative = Field(default=0.0, lt=1)

    @model_validator(mode="after")
    def _is_one_law(self) -> Self:
        if bool(self.w_at_m_s) == (self.coefficient is not None) or (
            (self.coefficient is None) != (self.exponent is None)
        ):
            raise ValueError("needs either w_at_m_s, or coefficient and exponent; give one of them")
        if (self.tank_l is None) != (self.wh_per_l is None) or (self.tank_l and self.battery_wh):
            raise ValueError("needs either battery_wh, or tank_l and wh_per_l; leave the other out")
        return self

    @property
    def unit_j(self) -> float:
        """Joules of the unit of energy for readers: a watt-hour, or a litre of fuel."""
        return _WH_J * (self.wh_per_l or 1.0)

    @property
    def usable_j(self) -> float | None:
        """Energy on board that a plan may use, joules; None if it is not known."""
        stored = self.battery_wh if self.tank_l is None else self.tank_l
        return None if stored is None else stored * (1 - self.reserve) * self.unit_j


class VesselSpec(StrictModel):
    """A vessel: speed, turn rate and fuel law. An entry of the catalogue has the same keys."""

    name: strict.Name = _UNNAMED
    title: str = ""
    origin: str = ""
    length_m: strict.Positive = Field(le=600)  # the longest ship had 458 m
    draught_m: strict.Positive | None = Field(default=None, le=60)
    squat_m: strict.NonNegative = 0.0
    speed_m_s: Speed
    turn_rate_deg_s: _Figure
    fuel_coefficient: strict.Positive = Field(default=1.0, le=1e12)
    fuel_exponent: strict.Positive = Field(default=2.0, le=20)
    limits: VesselLimits | None = None
    power: PowerSpec | None = None

    @model_validator(mode="after")
    def _is_a_vessel(self) -> Self:
        given = {"fuel_coefficient", "fuel_exponent"} & self.model_fields_set
        if self.power is not None and given:
            raise ValueError(f"has a power table and {' and '.join(sorted(given))}; leave one out")
        rate = math.radians(self.turn_rate_deg_s)
        sideways_g = self.speed_m_s * rate / _MAX_SIDEWAYS_M_S2
        circle_m = 2 * self.speed_m_s / rate
        if sideways_g > 1 or circle_m > _MAX_CIRCLE_M:
            raise strict.RemediedError(
                f"turns at {self.speed_m_s:.3g} m/s by {self.turn_rate_deg_s:.3g} degrees/s, which "
                f"no vessel does: that is a circle of {circle_m:.3g} m with {sideways_g:.2g} g; "
                f"{_MAX_CIRCLE_M / 1000:g} km and 1 g are the most; correct speed_m_s (--speed) or "
                "turn_rate_deg_s (--turning-circle)"
            )
        return self

    @property
    def label(self) -> str:
        """The vessel's title, else its name; "" if it was given neither."""
        return self.title or ("" if self.name == _UNNAMED else self.name)


Section = Literal["scenarios", "vessels", "sources"]
DRAUGHT = "give it in metres, with the vessel's figures (--draught) or in its file (draught_m)"
"""The remedy where a chart with depths needs a vessel's draught."""
EXAMPLE = "`renew show palawan-season` prints one to start from"
SECTIONS: tuple[Section, ...] = ("scenarios", "vessels", "sources")


# Largest size of a file, bytes: checking it takes seconds, and some 200 times as much memory.
_MAX_TOML_BYTES = 4 << 20


class SourceBase(StrictModel):
    """The keys of every source's entry; `credit` is empty if the data state it themselves."""

    schema_version: Literal[1]
    name: strict.Name
    title: str
    credit: str = ""
    licence: str = ""
    url: str = ""


class LandSpec(SourceBase):
    """Land that states its own producer.

    That is OpenStreetMap's from the package `roaring-landmask`, or S-57 cells in a folder that the
    user names.
    """

    adapter: Literal["osm-land", "s57"]


class VectorSpec(SourceBase):
    """Land polygons in a vector file that the user names."""

    adapter: Literal["vector"]
    accuracy_m: strict.Positive


class TableSeason(StrictModel):
    """A season of an embedded table: its credit, and the time that it is valid for.

    Where no better current is at hand, it is used for its `months` (1 to 12) of any year.
    """

    credit: str
    licence: str
    url: str = ""
    valid: str
    months: tuple[Annotated[int, Field(ge=1, le=12)], ...] = ()


class EmbeddedTableSpec(SourceBase):
    """A table of currents in `catalog/currents` with the columns season, lon, lat, u, v."""

    adapter: Literal["embedded-table"]
    table: str = Field(pattern=r"^[a-z0-9_-]+\.csv$")
    seasons: dict[str, TableSeason]

    def season_for(self, season: Season) -> str | None:
        """Return the table's season to use for a season of a scenario; None if there is none.

        Either both have the same name, or the scenario's season is a month of the table's season.
        """
        if season.name in self.seasons:
            return season.name
        if season.name != season.valid:
            return None
        months = {month: name for name, it in self.seasons.items() for month in it.months}
        return months.get(season.period.begin.month)


class StillSpec(SourceBase):
    """No current at all: routes are planned as in still water."""

    adapter: Literal["still"]


StepLength = Literal["month", "day", "6 hours", "hour"]
StepKind = Literal["mean", "instant", "climatology"]


class CopernicusSpec(SourceBase):
    """A dataset of the Copernicus Marine Service.

    Without a `version` the newest is used. `covers` names the period of the data for readers.
    `first_day` and `days_ahead` (days from today to the last one) give it to the program; it may be
    a little shorter, which only the service knows. Data may still change until they are
    `settles_after_days` old.
    """

    adapter: Literal["copernicus"]
    product: str
    doi: str
    dataset: str
    version: str = Field(default="", pattern=r"^(\d{6})?$")
    eastward: str = "uo"
    northward: str = "vo"
    cell_deg: strict.Positive
    latitudes: tuple[strict.Latitude, strict.Latitude] = (-80.0, 90.0)
    across_180: bool = True
    depth_m: strict.NonNegative | None = None
    step: StepLength
    kind: StepKind
    covers: str
    first_day: str = Field(default="", pattern=r"^(\d{4}-\d{2}-\d{2})?$")
    days_ahead: strict.Integer = 0
    settles_after_days: strict.NonNegative = 0.0
    gaps_vary: bool = False
    speed_limit_m_s: strict.Positive
    deadline_s: strict.Positive = 900.0
    attempts: Annotated[int, Field(ge=1)] = 3
    pause_s: strict.NonNegative = 20.0


ChartEntry = LandSpec | VectorSpec
CurrentEntry = EmbeddedTableSpec | CopernicusSpec | StillSpec
SourceSpec = Annotated[ChartEntry | CurrentEntry, Field(discriminator="adapter")]
_SOURCE: TypeAdapter[ChartEntry | CurrentEntry] = TypeAdapter(SourceSpec)


@cache
def root() -> Path:
    """Return the catalogue's folder: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    for place in (package / "catalog", package.parent / "catalog"):
        if (place / "scenarios").is_dir():
            return place
    raise RequestError(
        f"no catalogue in {package} or beside it: the installation is incomplete; install again"
    )


def names(section: Section) -> tuple[str, ...]:
    """Return the names of a section's entries, sorted."""
    return _names_in(root() / section)


@cache
def _names_in(folder: Path) -> tuple[str, ...]:
    """Return the names of a folder's entries; cached, because each season asks for them."""
    return tuple(sorted(path.stem for path in folder.glob("*.toml")))


def choices(section: Section | Literal["stations"]) -> tuple[str, ...]:
    """Return the names that an option may give of a section, or of the stations of the tide."""
    return tuple(stations()) if section == "stations" else names(section)


def entry(section: Section, name: str) -> dict[str, Any]:
    """Read an entry without checking it."""
    return read_toml(root() / section / f"{name}.toml")


def stations() -> dict[str, Path]:
    """Return the files of the stations of the tide, by name."""
    return {path.stem: path for path in sorted((root() / "tides").glob("*.json"))}


def source(name: str) -> ChartEntry | CurrentEntry:
    """Read and check a source's entry."""
    if name not in names("sources"):
        raise RequestError(f"unknown source {name!r}: {near_miss(name, names('sources'))}")
    return _SOURCE.validate_python(entry("sources", name))


def vessel(name: str) -> VesselSpec:
    """Read and check a vessel's entry."""
    if name not in names("vessels"):
        raise RequestError(f"unknown vessel {name!r}: {near_miss(name, names('vessels'))}")
    return vessel_of_file(root() / "vessels" / f"{name}.toml", f"vessel {name!r}")


def vessel_of_file(file: Path, label: str) -> VesselSpec:
    """Read and check the vessel in a file; faults begin with the label."""
    data = read_toml(file)
    data.pop("schema_version", None)
    return strict.validated(VesselSpec, data, lambda line: f"{label}: {line}")


def scenario_path(asked: str) -> Path:
    """Return the file of a scenario: a name in the catalogue, or a path that exists.

    Raises RequestError if there is no such name or path, or it is a directory; the message suggests
    a similar name.
    """
    named = root() / "scenarios" / f"{asked}.toml"
    if asked in names("scenarios"):
        return named
    path = expanded(asked, "scenario")
    reason = unreadable_reason(path)
    if not reason and path.is_dir():
        raise RequestError(
            f"{asked!r} is a directory, not a scenario; name the .toml file inside it"
        )
    if not reason:
        return path
    if reason != NOT_THERE:
        raise RequestError(f"scenario: {shown_path(path)} {reason}")
    looks_like_file = Path(asked).suffix or len(Path(asked).parts) > 1
    reason = "no such file" if looks_like_file else "no such file or entry"
    raise RequestError(
        f"no scenario {asked!r} ({reason}): {near_miss(Path(asked).stem, names('scenarios'))}"
    )


def entry_path(asked: str) -> Path:
    """Return the file of any entry, scenarios first, or of a scenario by its path."""
    for section in SECTIONS:
        if asked in names(section):
            return root() / section / f"{asked}.toml"
    if unreadable_reason(expanded(asked, "entry")) != NOT_THERE:
        return scenario_path(asked)
    if asked in stations():
        raise RequestError(f"{asked} is a station of the tide: `renew tide show {asked}` lists it")
    known = [name for section in SECTIONS for name in names(section)]
    raise RequestError(f"no entry {asked!r} in the catalogue: {near_miss(asked, known)}")


class ScenarioFile(NamedTuple):
    """A scenario's file as it was read once: its path, the SHA-256 of its content, its table."""

    path: Path
    sha256: str
    table: dict[str, Any]

    @classmethod
    def read(cls, path: Path) -> "ScenarioFile":
        """Read a file; RequestError if it is no TOML."""
        content = _content(path)
        return cls(path, hashlib.sha256(content).hexdigest(), _toml(content, path))

    @property
    def real_path(self) -> Path:
        """The absolute path, without links."""
        return self.path.resolve()


def read_scenario(asked: str) -> ScenarioFile:
    """Locate a scenario's file by its name in the catalogue or its path, and read it."""
    return ScenarioFile.read(scenario_path(asked))


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file; anything else is refused with a one-line error."""
    return _toml(_content(path), path)


def _content(path: Path) -> bytes:
    """Return a file's bytes; RequestError if it can't be read or is too large to be a request."""
    try:
        with path.open("rb") as file:
            content = file.read(_MAX_TOML_BYTES + 1)
        if len(content) > _MAX_TOML_BYTES:
            size = f"{path.stat().st_size >> 20:,} MB, more than {_MAX_TOML_BYTES >> 20}"
            raise RequestError(f"{path} has {size}: too much for a request; {EXAMPLE}")
    except OSError as error:
        raise RequestError(f"{path} can't be read: {error.strerror}; check the path") from None
    return content


def _toml(content: bytes, path: Path) -> dict[str, Any]:
    """Return the table in a TOML file's bytes; anything else is refused with a one-line error."""
    try:
        return tomllib.loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise RequestError(
            f"{path} is not text (byte {error.start} is not UTF-8); give a TOML file"
        ) from None
    except ValueError as error:  # TOMLDecodeError, or a number with thousands of digits
        raise RequestError(f"{path} is not TOML: {error}; {EXAMPLE}") from None
    except RecursionError:
        raise RequestError(f"{path} is nested too deeply for a scenario; {EXAMPLE}") from None


def unknown(kind: str, value: str, known: Iterable[str]) -> str:
    """Say that a value is not a name in the catalogue; the text follows the key in a message."""
    return f"= {shown(value)} is not a {kind} of the catalogue: {near_miss(value, known)}"


def has_world_land(chart: ChartSpec) -> bool:
    """Say whether one of a scenario's land sources is that of the whole world."""
    entries = (source(given.name) for given in chart.source if given.name)
    return any(entry.adapter == "osm-land" for entry in entries)


_ACCOUNT = "a Copernicus Marine account"


def listed() -> dict[str, list[dict[str, str]]]:
    """Return the entries of each section, sorted by name; only scenarios have `needs`."""
    sections: dict[str, list[dict[str, str]]] = {}
    for section in SECTIONS:
        sections[section] = []
        for name in names(section):
            content = entry(section, name)
            title, needs = content.get("title", ""), section == "scenarios" and _needs(content)
            about = {"section": section, "name": name, "title": title, "needs": needs or ""}
            sections[section].append(about)
    sections["tides"] = []
    for name, path in stations().items():
        title = json.loads(path.read_text(encoding="utf-8"))["name"]
        about = {"section": "tides", "name": name, "title": title, "needs": ""}
        sections["tides"].append(about)
    return sections


def _needs(scenario: dict[str, Any]) -> str:
    """Say which files or account a scenario needs, or that it runs offline."""
    files = "--charts with S-57 cells" if scenario.get("chart", {}).get("source") == "s57" else ""
    seasons = [Season.model_validate(table) for table in scenario["seasons"]]
    offline = [season.name for season in seasons if _runs_offline(season)]
    if len(offline) == len(seasons):
        return f"needs {files}" if files else "runs offline"
    if not offline:
        return f"needs {' and '.join(filter(None, (files, _ACCOUNT)))}, or --currents"
    online = [season.name for season in seasons if season.name not in offline]
    return f"offline: {', '.join(offline)}; {', '.join(online)} needs {_ACCOUNT}, or --currents"


def _runs_offline(season: Season) -> bool:
    """Whether a season has a current that needs neither account nor network."""
    if not season.currents:
        return True  # a formula
    # The user's own files, which have no name, are in no scenario of the catalogue.
    for given in (source(name) for name in season.currents if isinstance(name, str)):
        if given.adapter == "still":
            return True
        if given.adapter == "embedded-table" and given.season_for(season) is not None:
            return True
    return False
