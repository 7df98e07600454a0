"""The catalogue: models of its vessels and sources, and how its files are found and read."""

import hashlib
import json
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
from pipeline.scenario.season import Season
from pipeline.scenario.strict import StrictModel, near_miss, shown

# The limit of `renew.Vessel`: larger figures are typing errors, and their powers overflow.
_Figure = Annotated[strict.Positive, Field(le=1e6)]
_TURN_RATE_LIMIT_DEG_S = 5e7  # 1e6 radians/s is a little more


# The name of a vessel that was given none.
_UNNAMED = "vessel"


class AgainstCurrent(StrictModel):
    """Wind against the current: both limits are reached together."""

    wind_m_s: _Figure = Field(examples=[8.0], json_schema_extra=strict.unit("m/s"))
    """Mean wind at 10 m from which it counts, m/s. Give m/s, above 0."""
    current_m_s: _Figure = Field(examples=[0.5], json_schema_extra=strict.unit("m/s"))
    """Component of the current against the direction to which the wind blows, from which it counts,
    m/s. Give m/s, above 0."""


class VesselLimits(StrictModel):
    """Weather beyond which the vessel does not go."""

    wave_m: _Figure | None = Field(default=None, examples=[1.2], json_schema_extra=strict.unit("m"))
    """Greatest significant wave height, metres. Give metres above 0, or leave it out."""
    period_s: _Figure | None = Field(
        default=None, examples=[9.0], json_schema_extra=strict.unit("s")
    )
    """Longest period of the waves, peak or mean as the files of waves have it, s. Give seconds
    above 0, or leave it out."""
    wind_m_s: _Figure | None = Field(
        default=None, examples=[12.0], json_schema_extra=strict.unit("m/s")
    )
    """Strongest mean wind at 10 m, m/s. Give m/s above 0, or leave it out."""
    gust_m_s: _Figure | None = Field(
        default=None, examples=[17.0], json_schema_extra=strict.unit("m/s")
    )
    """Strongest gust, m/s, of the files of wind. Give m/s above 0, or leave it out."""
    wind_against_current: AgainstCurrent | None = Field(
        default=None, examples=[{"wind_m_s": 8.0, "current_m_s": 0.5}]
    )
    """Wind against the current, which raises short and steep waves. Give a table with both limits,
    or leave it out."""
    anchor_m: _Figure | None = Field(
        default=None, examples=[30.0], json_schema_extra=strict.unit("m")
    )
    """Greatest charted depth in which the vessel anchors while it waits, metres, on charts with
    areas of depth (S-57). Give metres above 0, or leave it out: it then holds its place."""
    leeway: _Figure | None = Field(default=None, le=0.5, examples=[0.03])
    """Speed at which the wind at 10 m carries the vessel without thrust, as a share of the wind's:
    it counts in hours adrift. Give a share, such as 0.03, or leave it out."""


# A watt-hour, joules.
_WH_J = 3600.0


class PowerSpec(StrictModel):
    """What the vessel burns, in watts, and what it has on board."""

    w_at_m_s: tuple[tuple[strict.Positive, strict.Positive], ...] = Field(
        default=(), examples=[[[0.5, 2.0], [1.0, 19.0], [2.0, 190.0]]]
    )
    """Power at some speeds through water, [m/s, W] each; between them it is interpolated. Give two
    or more that rise, the steeper the faster, or a coefficient and an exponent."""
    coefficient: strict.Positive | None = Field(default=None, le=1e12, examples=[19.13])
    """K of the power K vⁿ, watts at 1 m/s. Give a number above 0, and the exponent."""
    exponent: strict.Number | None = Field(default=None, ge=1, le=20, examples=[3.33])
    """n of the power K vⁿ. Give a number from 1 to 20, and the coefficient."""
    hotel_w: strict.NonNegative = Field(default=0.0, le=1e12, examples=[30.0])
    """Power of all else on board, whatever the speed, W. Give watts, 0 or more."""
    battery_wh: strict.Positive | None = Field(default=None, examples=[1064.0])
    """Energy of the batteries at departure, Wh. Give watt-hours, or leave it out."""
    tank_l: strict.Positive | None = Field(default=None, examples=[120.0])
    """Fuel in the tank at departure, litres, in place of batteries. Give litres, and wh_per_l."""
    wh_per_l: strict.Positive | None = Field(default=None, examples=[3300.0])
    """Energy that a litre of fuel gives, after the losses of the engine, Wh. Give it with tank_l.
    """
    reserve: strict.NonNegative = Field(default=0.0, lt=1, examples=[0.2])
    """Share of the battery or tank that no plan may use. Give a share from 0 to below 1."""

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
    """Name of the vessel. Use up to 64 lower-case letters, digits, '-' and '_'."""
    title: str = Field(default="", examples=["Ocean-going unmanned surface vessel, 7 m"])
    """Name of the vessel for readers. Give any text."""
    origin: str = Field(default="", examples=["Sea trials of May 2025"])
    """Where the vessel's figures come from. Give any text."""
    length_m: _Figure = Field(examples=[7.0])
    """Length overall, metres. Give the length overall in metres."""
    draught_m: strict.Positive | None = Field(default=None, examples=[0.9])
    """Draught, metres; needed on charts with depths. Give the metres that the vessel reaches below
    the water line."""
    squat_m: strict.NonNegative = 0.0
    """Squat, metres: by how much more the vessel reaches below the water line under way in shallow
    water; added to the draught. Give metres, 0 or more."""
    speed_m_s: _Figure = Field(examples=[5.0])
    """Speed through water, m/s, the same all the way. Give the speed through water in m/s."""
    turn_rate_deg_s: strict.Positive = Field(le=_TURN_RATE_LIMIT_DEG_S, examples=[16.5])
    """Turn rate with the helm hard over, degrees/s. Give the hard-over turn rate in degrees/s."""
    fuel_coefficient: strict.Positive = Field(default=1.0, le=1e12)
    """Factor of the fuel law: fuel per second = coefficient × speed^exponent, which sets the unit
    of all fuel figures. Give a number above 0."""
    fuel_exponent: strict.Positive = Field(default=2.0, le=20)
    """Exponent of the fuel law: fuel per second = coefficient × speed^exponent. Give a number above
    0, at most 20: 2 is the paper's, 3 the propeller law of displacement hulls."""
    limits: VesselLimits | None = None
    """Weather in which the vessel does not go; it counts where [limits] names files. Add a
    [vessel.limits] table, or leave it out."""
    power: PowerSpec | None = None
    """The fuel law in watts, in place of fuel_coefficient and fuel_exponent: fuel is energy then.
    Add a [vessel.power] table ([power] in a vessel's own file), or leave it out."""

    @model_validator(mode="after")
    def _has_one_law(self) -> Self:
        given = {"fuel_coefficient", "fuel_exponent"} & self.model_fields_set
        if self.power is not None and given:
            raise ValueError(f"has a power table and {' and '.join(sorted(given))}; leave one out")
        return self

    @property
    def label(self) -> str:
        """The vessel's title, else its name; "" if it was given neither."""
        return self.title or ("" if self.name == _UNNAMED else self.name)


Section = Literal["scenarios", "vessels", "sources"]
EXAMPLE = "`renew show palawan-season` prints one to start from"
SECTIONS: tuple[Section, ...] = ("scenarios", "vessels", "sources")


# Largest size of a file, bytes: checking it takes seconds, and some 200 times as much memory.
_MAX_TOML_BYTES = 4 << 20


class SourceBase(StrictModel):
    """The keys of every source's entry; `credit` is empty if the data state it themselves."""

    schema_version: Literal[1]
    name: strict.Name
    """Name in the catalogue, and of the files made from it. Use up to 64 lower-case letters,
    digits, '-' and '_'."""
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


def table(name: str) -> Path:
    """Return the path of an embedded table of currents."""
    return root() / "currents" / name


def islands() -> Path:
    """Return the path of the table of islands' names."""
    return root() / "islands.csv"


def canals() -> Path:
    """Return the path of the table of canals between seas."""
    return root() / "canals.csv"


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

    Raises
    ------
    RequestError
        There is no such name or path, or it is a directory; the message suggests a similar name.
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
        return tomllib.loads(content.decode("utf-8"))
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
