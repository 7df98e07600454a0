"""Wind and waves of a voyage from the user's files, as far as the vessel has a limit for them."""

from collections.abc import Iterator
from pathlib import Path

from shapely.geometry import Polygon

from pipeline.errors import RequestError
from pipeline.model import CurrentGrid, Land
from pipeline.scenario.catalogue import VesselLimits
from pipeline.scenario.model import LimitsSpec
from pipeline.scenario.season import Season
from pipeline.sources.cf.adapter import CfFiles
from pipeline.sources.quantities import GUST, PERIOD, WAVES, WIND, Quantity


def weather_files(spec: LimitsSpec, limits: VesselLimits) -> Iterator[tuple[str, CfFiles]]:
    """Yield the files that are needed, each by the name of its limit."""
    rows: tuple[tuple[str, tuple[str, ...], Quantity], ...] = (
        ("wave_m", spec.waves, WAVES),
        ("period_s", spec.waves, PERIOD),
        ("wind_m_s", spec.wind, WIND),
        ("gust_m_s", spec.wind, GUST),
        ("wind_against_current", spec.wind, WIND),
        ("leeway", spec.wind, WIND),
    )
    for name, paths, quantity in rows:
        if getattr(limits, name) is not None and paths:
            yield name, CfFiles(paths, quantity=quantity)


def weather_grids(
    spec: LimitsSpec, limits: VesselLimits, region: Polygon, season: Season
) -> dict[str, CurrentGrid]:
    """Read the fields that have a limit, on the clock of a season, by the name of the limit.

    Raises
    ------
    RequestError
        A file can't be read, or lacks the region or the departure; all faults are listed.
    """
    found, faults = dict[str, CurrentGrid](), list[str]()
    for name, source in weather_files(spec, limits):
        reason = source.uncovered_reason(region, season)
        if reason:
            faults.append(reason)
            continue
        try:
            found[name] = source.current(region, season, Land((), (), 0.0), Path())
        except RequestError as error:
            faults += error.faults
    if faults:
        raise RequestError([f"limits: {fault}" for fault in dict.fromkeys(faults)])
    return found
