"""The files that a voyage names, as tables of its scenario."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from pipeline.errors import Faults, RequestError
from pipeline.machine.paths import NOT_THERE, resolved, shown, unreadable_reason
from pipeline.scenario import catalogue
from pipeline.scenario.model import TideSpec
from pipeline.sources.tides.station import stations_of
from pipeline.voyage.request import VoyageRequest


def tables_of(request: VoyageRequest) -> dict[str, Any]:
    """Return the tables of a scenario that name files: chart, areas to avoid, havens and tide.

    Raises RequestError: one line for each fault.
    """
    faults = Faults()

    def read(option: str, path: Path, remedy: str) -> str:
        file = faults.collect(lambda: resolved(path, option))
        if file is not None and (reason := unreadable_reason(file)):
            remedy = f"; {remedy}" if reason == NOT_THERE else ""
            faults.lines.append(f"{option} = '{shown(file)}' {reason}{remedy}")
        return str(file)

    data: dict[str, Any] = {}
    if request.avoid:
        remedy = "give a vector file, such as GeoJSON"
        data["avoid"] = [{"path": read("--avoid", path, remedy)} for path in request.avoid]
    if havens := faults.collect(lambda: _havens(request)):
        read("--havens", Path(havens["path"]), "give a GeoJSON file of points")
        data["havens"] = havens
    if chart := _chart(request, read):
        data["chart"] = chart
    if request.datum and not request.charts and not request.depths:
        faults.lines.append(
            f"--datum = {request.datum!r} is of charted depths; add --depths or --charts"
        )
    if request.tide:
        data["tide"] = {"stations": [_station(one) for one in request.tide]}
        faults.collect(lambda: stations_of(TideSpec(**data["tide"])))
    if faults.lines:
        raise RequestError(faults.lines)
    return data


def _chart(request: VoyageRequest, read: Callable[[str, Path, str], str]) -> dict[str, Any]:
    """Return the table of the chart, if any; `read` checks a path."""
    chart: dict[str, Any] = {}
    if request.charts is not None:
        remedy = "give a vector file, or a folder of S-57 cells"
        chart["source"] = {"path": read("--charts", request.charts, remedy)}
    if request.depths is not None:
        remedy = "give a GEBCO or EMODnet grid in NetCDF"
        chart["depths"] = read("--depths", request.depths, remedy)
    return chart | ({"datum": request.datum} if request.datum else {})


def _havens(request: VoyageRequest) -> dict[str, Any]:
    """Return the table of havens, if any; refuse a list without a limit, or a limit without one."""
    limits = {"within": request.within, "endurance": request.endurance}
    given = {key: one for key, one in limits.items() if one}
    if request.havens is None and not given:
        return {}
    if request.havens is None:
        words = "limit the way" if len(given) > 1 else "limits the way"
        raise RequestError(
            f"{', '.join(f'--{key}' for key in given)} {words} to a haven; add --havens FILE"
        )
    if not given:
        raise RequestError("--havens needs a limit; add --within 6h or --endurance 2d, or both")
    return {"path": str(resolved(request.havens, "--havens")), **given}


def _station(text: str) -> str:
    """Return a station's name in the catalogue, or the path of its file."""
    return text if text in catalogue.stations() else str(resolved(Path(text), "--tide"))
