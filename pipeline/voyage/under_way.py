"""Plan the voyage of a finished run again from where the vessel is, as a run of its own."""

import re
from datetime import datetime, timedelta
from typing import Any

from pipeline.errors import RequestError
from pipeline.findings.text import exact_moment_text
from pipeline.machine.paths import expanded
from pipeline.scenario.catalogue import read_toml
from pipeline.scenario.loading import parse_scenario, with_currents
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import departure_name, interval, named_departure
from pipeline.stages.under_way import FinishedSeason, finished_season
from pipeline.voyage.request import UnderWayRequest

# Number of characters of a run's name that are kept when a time is added; and the form of a time
# that an earlier replanning added.
_NAME = 45
_ADDED = re.compile(r"-at-\d{4}-\d{2}-\d{2}t\d{4}z$")
# Keys of a season that leave its times open; and its title, which may name the old departure.
_OPEN = ("departures", "to_within", "arrive_by", "title")


def under_way_scenario(
    request: UnderWayRequest, finished: FinishedSeason | None = None
) -> tuple[Scenario, tuple[str, ...]]:
    """Return the scenario of the voyage ahead, with notes on how the request was understood.

    `finished` are the results that the request names, if they have been read already. Raises
    RequestError if the results are damaged or of a plane, or the request does not go with them; one
    line for each fault.
    """
    finished = finished or finished_season(request.results, request.season)
    left = _departed(finished, request)
    file = expanded(finished.folder / "scenario.toml", "RESULTS")
    data = _table(read_toml(file), finished, request, left)
    late = finished.season["arrive_by"]
    dropped = f"the latest arrival, {late}, is not asked of the way ahead" if late else ""
    notes = tuple(filter(None, (request.at.note, dropped)))
    if request.currents:
        data, left_out = with_currents(data, request.currents)
        notes = (*notes, *left_out)
    return parse_scenario(data, file.parent), notes


def _departed(finished: FinishedSeason, request: UnderWayRequest) -> datetime:
    """Return when the vessel left: as planned, or as given where the plan has no departure."""
    left = finished.departed(request.departed)
    if left is None:
        raise RequestError(
            "--departed is missing: the plan has no departure; give when the vessel left, as "
            "2026-11-22T06:00Z"
        )
    if request.time < left:
        raise RequestError(
            f"--time {exact_moment_text(request.time)} is before the departure, "
            f"{exact_moment_text(left)}; give the time of the position"
        )
    return left


def _table(
    data: dict[str, Any], finished: FinishedSeason, request: UnderWayRequest, left: datetime
) -> dict[str, Any]:
    """Return the scenario's table for the rest of the voyage."""
    names = [one["name"] for one in finished.scenario["seasons"]]
    try:
        season = data["seasons"][names.index(finished.season["name"])]
    except (KeyError, IndexError):
        raise RequestError(
            f"--season {finished.season['name']!r} goes on from an anchorage: plan from here by "
            "renew go"
        ) from None
    if "speed" in season:
        raise RequestError(
            f"--season {finished.season['name']!r} chose its speeds, which can't be chosen again "
            "under way: plan from here by renew go --speed"
        )
    named = named_departure(finished.season["name"]) is not None
    again = {key: one for key, one in season.items() if key not in _OPEN}
    again |= {
        "name": departure_name(request.time) if named else finished.season["name"],
        "departure": request.time,
    }
    under_way = {
        "results": str(finished.folder.absolute()),
        "season": finished.season["name"],
        "departed": left,
        "same_currents": not request.currents,
    }
    if request.heading_deg is not None:
        under_way["heading_deg"] = request.heading_deg
    if "endurance" in data.get("havens", {}):
        rest = _endurance_left(data["havens"]["endurance"], left, request.time)
        data = {**data, "havens": {**data["havens"], "endurance": rest}}
    place = request.at
    first = _ADDED.sub("", data["name"])
    start = data["start"]
    title = data.get("title") or first
    return data | {
        "name": request.name or f"{first[:_NAME].rstrip('-_')}-at-{departure_name(request.time)}",
        "title": f"{title.partition(', planned again ')[0]}, planned again "
        f"{exact_moment_text(request.time)}",
        "start": [place.lon + 360.0 * round((start[0] - place.lon) / 360), place.lat],
        "seasons": [again],
        "under_way": under_way,
    }


def _endurance_left(endurance: str, left: datetime, now: datetime) -> str:
    """Return what is left of an endurance that counts from the departure, in whole minutes."""
    minutes = (interval(endurance) - (now - left)) // timedelta(minutes=1)
    if minutes < 1:
        raise RequestError(
            f"--time {exact_moment_text(now)} is beyond havens.endurance = {endurance!r} from the "
            f"departure, {exact_moment_text(left)}; check both"
        )
    return f"{minutes}min"
