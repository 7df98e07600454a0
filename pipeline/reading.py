"""From a scenario's file to the model, with every fault at once.

pydantic finds what is wrong inside a table; what is wrong between tables is looked for among
those that are sound, so that one bad key hides no other fault.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel, TypeAdapter, ValidationError

from pipeline import catalogue
from pipeline.catalogue import EXAMPLE
from pipeline.errors import RequestError
from pipeline.faults import model_faults
from pipeline.scenario import Plane, Point, Region, Scenario, Season

if TYPE_CHECKING:
    from collections.abc import Iterator

ModelT = TypeVar("ModelT", bound=BaseModel)
_POINT: TypeAdapter[Point] = TypeAdapter(Point)


def load_scenario(asked: str) -> Scenario:
    """Read a scenario by its name in the catalogue or its path.

    Raises
    ------
    RequestError
        Not found, not a scenario, or wrong: one line for each fault.
    """
    path = catalogue.scenario_path(asked)
    data = catalogue.read_toml(path)
    if not {"start", "goal", "seasons"} & data.keys():
        raise RequestError(
            [f"{path} is TOML but no scenario: it has no start, goal or seasons; {EXAMPLE}"]
        )
    return parse_scenario(data)


def parse_scenario(data: dict[str, Any]) -> Scenario:
    """Check a scenario's table and resolve its catalogue names."""
    faults = list(_unknown_names(data))
    resolved = _with_vessel(data)
    try:
        scenario = Scenario.model_validate(resolved)
    except ValidationError as error:
        faults += model_faults(error, Scenario, resolved)
    else:
        if not faults:
            faults += _between(_Sound.of(data))
            if not faults:
                return scenario
            raise RequestError(faults)
    raise RequestError(faults + list(_between(_Sound.of(data))))


@dataclass(frozen=True)
class _Sound:
    """The tables of a scenario that are sound by themselves."""

    region: Region | None
    plane: Plane | None
    ends: dict[str, Point]
    seasons: tuple[Season, ...]

    @classmethod
    def of(cls, data: dict[str, Any]) -> _Sound:
        """Pick them out of a scenario's table."""
        seasons = data.get("seasons")
        found = [_sound(Season, item) for item in seasons] if isinstance(seasons, list) else []
        ends = {}
        for name in ("start", "goal"):
            try:
                ends[name] = _POINT.validate_python(data.get(name))
            except ValidationError:
                continue
        return cls(
            region=_sound(Region, data.get("region")),
            plane=_sound(Plane, data.get("plane")),
            ends=ends,
            seasons=tuple(season for season in found if season is not None),
        )


def _sound(model: type[ModelT], data: object) -> ModelT | None:
    """Validate one table; nothing where it is absent or wrong."""
    try:
        return model.model_validate(data)
    except ValidationError:
        return None


def _with_vessel(data: dict[str, Any]) -> dict[str, Any]:
    """Replace a vessel's catalogue name by its entry."""
    name = data.get("vessel")
    if not isinstance(name, str):
        return data
    if name in catalogue.names("vessels"):
        return {**data, "vessel": catalogue.vessel_table(name)}
    # Told already as an unknown name: any sound vessel keeps pydantic from telling it again.
    return {**data, "vessel": {"length_m": 1.0, "speed_m_s": 1.0, "turn_rate_deg_s": 1.0}}


def _unknown_names(data: dict[str, Any]) -> Iterator[str]:
    """Find names of vessels and sources that the catalogue does not have."""
    vessel = data.get("vessel")
    if isinstance(vessel, str) and vessel not in catalogue.names("vessels"):
        yield catalogue.unknown("vessel", "vessel", vessel, catalogue.names("vessels"))
    sources = catalogue.names("sources")
    chart = data.get("chart")
    if isinstance(chart, dict) and isinstance(land := chart.get("source"), str):
        if land not in sources:
            yield catalogue.unknown("source", "chart.source", land, sources)
        elif catalogue.source(land).adapter != "osm-land":
            yield f"chart.source = {land!r} gives currents, not land; use 'osm-land'"
    seasons = data.get("seasons")
    for i, season in enumerate(seasons if isinstance(seasons, list) else ()):
        named = season.get("currents") if isinstance(season, dict) else None
        for j, name in enumerate(named if isinstance(named, list) else ()):
            key = f"seasons[{i}].currents[{j}]"
            if name not in sources:
                yield catalogue.unknown("source", key, name, sources)
            elif catalogue.source(name).adapter == "osm-land":
                yield f"{key} = {name!r} gives land, not currents; name a source of currents"


def _between(sound: _Sound) -> Iterator[str]:
    """Faults between tables: ends outside the waters, currents that do not reach over them."""
    if sound.region is not None:
        yield from _ends_outside_region(sound.region, sound.ends)
        yield from _uncovered(sound.region, sound.seasons)
    elif sound.plane is not None:
        import shapely

        for name, point in sound.ends.items():
            away = shapely.distance(sound.plane.shape, shapely.Point(point))
            if away > 0:
                yield (
                    f"{name} = {list(point)} lies {away:.4g} m outside plane.extent "
                    f"{list(sound.plane.extent)}; move it inside or widen the extent"
                )


def _ends_outside_region(region: Region, ends: dict[str, Point]) -> Iterator[str]:
    """Say which end lies outside the region, and how far."""
    import shapely

    for name, point in ends.items():
        here = shapely.Point(point)
        if region.shape.covers(here):
            continue
        lon, lat = point
        if not (-180 <= lon <= 360 and -90 <= lat <= 90):
            yield (f"{name} = {list(point)} is no place on earth: give [longitude, latitude]")
            continue
        import pyproj

        nearest = shapely.get_coordinates(shapely.shortest_line(here, region.shape))[-1]
        away = pyproj.Geod(ellps="WGS84").inv(lon, lat, *nearest)[2] / 1000
        bounds = ", ".join(f"{bound:g}" for bound in region.shape.bounds)
        yield (
            f"{name} = {list(point)} lies {away:.0f} km outside the region (its bounds: {bounds}); "
            "move it inside or widen the region"
        )


def _uncovered(region: Region, seasons: tuple[Season, ...]) -> Iterator[str]:
    """Say which season has no source whose figures reach over the region."""
    from pipeline.sources import current_source

    for season in seasons:
        known = [name for name in season.currents if name in catalogue.names("sources")]
        known = [name for name in known if catalogue.source(name).adapter != "osm-land"]
        reasons = [current_source(name).uncovered(region.shape, season) for name in known]
        if reasons and all(reasons):
            yield f"season {season.name!r}: {'; '.join(reasons)}"
