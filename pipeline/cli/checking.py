"""What `renew check-route` prints: the answer in sentences and a table of times, or JSON."""

import json
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
from pipeline.voyage.check import CheckedRoute, checked_lines
from pipeline.voyage.route_file import GivenRoute

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
    """Print what was found; end with 1 if it crosses land or a shut area, or a season failed."""
    if as_json:
        answer = [_json(one, route, departure) for one in found]
        content = {"route": route.name, "form": route.form, "seasons": answer, **caveats_json(run)}
        content["notes"] = note_texts(dict.fromkeys(run.fetched.notes))
        typer.echo(json.dumps(json_value(content), ensure_ascii=False))
    else:
        for one in found:
            typer.echo("\n".join(_lines(one, route, departure)))
        decided = dict.fromkeys((*run.decisions, *run.choices))
        told = {*decided, *run.unknowns}
        rest = [note for note in dict.fromkeys(run.fetched.notes) if note not in told]
        for title, notes in (("Decided:", decided), ("Not known:", run.unknowns), ("Notes:", rest)):
            if notes:
                typer.echo("\n".join(["", title, *(f"- {line}" for line in note_texts(notes))]))
    is_whole = not run.fetched.failures
    raise typer.Exit(0 if is_whole and not any(one.crossed or one.shut for one in found) else 1)


def _lines(one: CheckedRoute, route: GivenRoute, departure: datetime | None) -> Iterator[str]:
    """Yield the answer for one case, and when its points are passed."""
    yield from checked_lines(one, route)
    if len(one.passed_s) <= _MOST_POINTS and departure is not None:
        yield from table([*_times(one, route, departure)], 1, terminal_width())


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
        "said": [*checked_lines(one, route)],
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
