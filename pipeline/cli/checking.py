"""What `renew check-route` prints: the answer in sentences and a table of times, or JSON."""

import json
import math
from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta
from typing import Any

import typer

from pipeline.cli.terminal import table, terminal_width
from pipeline.findings import text
from pipeline.findings.names import figures
from pipeline.findings.note_words import caveats_json, note_texts, note_value
from pipeline.findings.result import RankedRoute, RunResult
from pipeline.findings.text import json_value
from pipeline.model import Place
from pipeline.voyage.check import CheckedRoute
from pipeline.voyage.route_file import GivenRoute

# Number of places that are named in a sentence.
_FEW = 3
# Share by which fuels may differ and count as the same: two searches for one path differ by less.
_SAME = 1e-4
# Number of points of a route of which a table shows the times; a line's points are only its shape.
_MOST_POINTS = 100


def print_check(
    run: RunResult,
    found: Sequence[CheckedRoute],
    route: GivenRoute,
    departure: datetime | None,
    *,
    as_json: bool,
) -> None:
    """Print what was found, and end with code 1 if the route crosses land or a shut area."""
    if as_json:
        answer = [_json(one, route, departure) for one in found]
        content = {"route": route.name, "form": route.form, "seasons": answer, **caveats_json(run)}
        typer.echo(json.dumps(json_value(content), ensure_ascii=False))
    else:
        for one in found:
            typer.echo("\n".join(_lines(one, route, departure)))
        for title, notes in (
            ("Decided:", dict.fromkeys((*run.decisions, *run.choices))),
            ("Not known:", run.unknowns),
        ):
            if notes:
                typer.echo("\n".join(["", title, *(f"- {line}" for line in note_texts(notes))]))
    raise typer.Exit(1 if any(one.crossed or one.shut for one in found) else 0)


def _lines(one: CheckedRoute, route: GivenRoute, departure: datetime | None) -> Iterator[str]:
    """Yield the answer for one case."""
    row, took_s = one.given.metrics, float(one.passed_s[-1])
    named = f" {route.name!r}" * bool(route.name)
    yield (
        f"{text.season_name(one.given.season)}: {route.form}{named}, "
        f"{text.distance(row.length_m)}, {text.duration(took_s)}, fuel {text.fuel(row.fuel, row)}"
    )
    no_go = row.no_go_name
    for land in one.crossed[:_FEW]:
        yield (
            f"OVER LAND: {text.distance(land.length_m)} of {land.name or no_go} at "
            f"{land.place.text}"
        )
    if len(one.crossed) > _FEW:
        yield f"OVER LAND at {len(one.crossed) - _FEW} more places"
    if one.nearest is not None:
        yield f"Nearest {no_go}: {text.clearance(row.clearance_m)}, at {one.nearest.text}"
    yield from (f"SHUT: {said}" for said in one.shut)
    for lane in one.against:
        how_far = text.distance(lane.length_m)
        yield f"AGAINST the {lane.zone.name}: for {how_far}, at {lane.place.text}"
    if row.collisions:
        places = ", ".join(place.text for place in one.met[:_FEW])
        more = f" and {len(one.met) - _FEW} more places" * (len(one.met) > _FEW)
        yield (
            f"NOT SAFE EVERYWHERE: {row.collisions:,} of {row.trials:,} hard-over turns meet "
            f"{no_go}, from {places}{more}"
        )
    else:
        yield f"All {row.trials:,} hard-over turns are clear of {no_go}"
    if math.isfinite(row.adrift_s):
        place = Place(row.adrift_lon, row.adrift_lat)
        yield (
            f"WITHOUT THRUST ashore in {text.duration(row.adrift_s)} from {place.text}; within 6 h "
            f"from {text.percent(row.adrift_share)} of the way"
        )
    yield from _compared(one)
    if len(one.passed_s) <= _MOST_POINTS and departure is not None:
        yield from table([*_times(one, route, departure)], 1, terminal_width())


def _compared(one: CheckedRoute) -> Iterator[str]:
    """Yield how the given route compares with the routes of a plan."""
    if one.why_not:
        which = "of any side" if one.best is None else "of its side"
        yield f"No safe route {which} beside it: {one.why_not}"
    beside = {"of its side": one.same_side, "of all": one.best}
    if one.same_side is one.best:
        beside = {"of its side and of all": one.best}
    for which, other in beside.items():
        if other is not None:
            more = one.given.metrics.fuel / other.metrics.fuel - 1
            size = f"{text.percent(abs(more), 2)} {'above' if more > 0 else 'below'}"
            way = f", {other.metrics.way}" * bool(other.metrics.way)
            yield (
                f"{size if abs(more) > _SAME else 'As much fuel as'} the least-fuel route "
                f"{which} that keeps room to turn: {text.fuel(other.metrics.fuel, other.metrics)}, "
                f"{text.distance(other.metrics.length_m)}{way}"
            )


def _times(one: CheckedRoute, route: GivenRoute, departure: datetime) -> Iterator[tuple[str, ...]]:
    """Yield the rows of a table: each point, when it is passed, and how much later than stated."""
    yield "point", "passed", "file states", "difference"
    for number, (point, seconds) in enumerate(
        zip(route.points, one.passed_s, strict=True), start=1
    ):
        name, stated = point.name, point.time
        passed = departure + timedelta(seconds=round(float(seconds)))
        late = "" if stated is None else f"{(passed - stated).total_seconds():+,.0f} s"
        yield (
            name or str(number),
            text.exact_moment_text(passed),
            "" if stated is None else text.exact_moment_text(stated),
            late,
        )


def _json(one: CheckedRoute, route: GivenRoute, departure: datetime | None) -> dict[str, Any]:
    """Return the answer for one case as JSON."""

    def beside(other: RankedRoute | None) -> dict[str, Any] | None:
        if other is None:
            return None
        more = one.given.metrics.fuel / other.metrics.fuel - 1
        return {**figures(other.metrics, "json"), "fuel_more_share": more}

    return {
        "season": one.given.season,
        **figures(one.given.metrics, "json"),
        "duration_s": float(one.passed_s[-1]),
        "crosses": [
            {"name": land.name, "length_m": land.length_m, "place": note_value(land.place)}
            for land in one.crossed
        ],
        "nearest": one.nearest and note_value(one.nearest),
        "shut": one.shut,
        "against_lanes": [
            {"name": lane.zone.name, "length_m": lane.length_m, "place": note_value(lane.place)}
            for lane in one.against
        ],
        "turns_meet_land_from": [note_value(place) for place in one.met],
        "same_side": beside(one.same_side),
        "best": beside(one.best),
        "why_not": one.why_not,
        "points": [
            {
                "name": point.name,
                "lon": point.lon,
                "lat": point.lat,
                "passed_s": float(seconds),
                "passed": departure and departure + timedelta(seconds=float(seconds)),
                "stated": point.time,
            }
            for point, seconds in zip(route.points, one.passed_s, strict=True)
        ],
    }
