"""The outcome of a run as one JSON object, for programs."""

import json
import math
from datetime import datetime

from pipeline.formats.shared.note_words import note_json, note_texts, rejections
from pipeline.formats.shared.writing import json_value
from pipeline.model import ClockWorth, RouteMetrics
from pipeline.running.outcome import Outcome
from pipeline.stages.write import season_stem


def outcome_json(outcome: Outcome) -> str:
    """Return an outcome as JSON on one line; numbers that are not finite are null.

    Lengths are in true metres, durations in seconds. `files` of the best route are all files of its
    season. `files` of another route are those with all routes of the season: a GPX and a GeoJSON.
    """
    files = sorted(path.name for path in outcome.directory.iterdir() if path.is_file())
    fields = {
        "scenario": outcome.scenario.name,
        "directory": str(outcome.directory),
        "files": files,
        "routes": [
            _route(
                row,
                outcome.scenario.passage(row.season, round(row.duration_s)),
                season_stem(outcome.scenario.name, row.season),
                files,
            )
            for row in outcome.evaluation.routes
        ],
        "rejected": [
            {"season": plan.season, **json_value(one)}
            for plan in outcome.plans
            for one in rejections(outcome.result, plan.season)
        ],
        "clock_worth": [_clock_worth(one) for one in outcome.evaluation.clock_worths],
        "unknown": note_texts(outcome.result.unknowns),
        "notes": note_texts(outcome.fetched.notes),
        "note_values": json_value([note_json(note) for note in outcome.fetched.notes]),
        "failures": list(outcome.failures),
    }
    return json.dumps(fields, ensure_ascii=False, allow_nan=False)


def _route(
    row: RouteMetrics, passage: tuple[datetime, datetime] | None, stem: str, files: list[str]
) -> dict[str, object]:
    """Return one route's values and the files that contain it."""
    of_all = ("-all.gpx", ".geojson")
    of_best = (".rtz", ".gpx", *of_all, ".kml", ".plan", ".waypoints")
    return {
        "season": row.season,
        "rank": row.rank,
        "way": row.way,
        "class": row.homotopy,
        "fuel": row.fuel,
        "length_m": row.length_m,
        "clearance_m": _finite(row.clearance_m),
        "duration_s": row.duration_s,
        "speed_through_water_m_s": row.speed_m_s,
        "departure": passage[0].isoformat() if passage else None,
        "arrival": passage[1].isoformat() if passage else None,
        "optimality_gap": _finite(row.optimality_gap),
        "filled_share": row.filled_share,
        "uncharted_share": _finite(row.uncharted_share),
        "files": [
            name
            for name in (f"{stem}{end}" for end in (of_best if row.rank == 1 else of_all))
            if name in files
        ],
    }


def _clock_worth(worth: ClockWorth) -> dict[str, object]:
    """Return the fuel of plans for a steady current, sailed in a season's changing current."""
    return {
        "season": worth.season,
        "best_fuel": worth.best,
        "departure_plan_fuel": _finite(worth.frozen),
        "mean_plan_fuel": _finite(worth.mean),
        "shortest_path_fuel": _finite(worth.shortest),
        "fuel_bound": worth.bound,
    }


def _finite(value: float) -> float | None:
    """Return a number, or None if it is not finite, as the clearance without any land."""
    return value if math.isfinite(value) else None
