"""What the page shows of a plan: the routes of each case, best first, and why to take which."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import shapely

from pipeline._types import FloatArray
from pipeline.findings.note_words import caveats_json, note_texts
from pipeline.findings.result import RankedRoute, RunCase, RunResult, addressed
from pipeline.findings.text import capitalised, json_value
from pipeline.formats.report.season import case_facts
from pipeline.geo.lonlat import METRES_PER_DEGREE

# Largest distance of a drawn line from the route, as a share of the route's longer side: half a
# pixel on a map of 2,000 pixels.
_DETAIL = 1 / 4000
# Decimals of drawn positions, degrees: about 1 m.
_DECIMALS = 5


def drawn(path: FloatArray) -> list[list[float]]:
    """Return a path (n, 2), lon/lat degrees, with as many points as a map shows."""
    line = shapely.LineString(path)
    west, south, east, north = line.bounds
    detail = max(east - west, north - south, 1 / METRES_PER_DEGREE) * _DETAIL
    points = shapely.get_coordinates(shapely.simplify(line, detail))
    shown: list[list[float]] = np.round(points, _DECIMALS).tolist()
    return shown


def sides(result: RunResult) -> dict[str, Any]:
    """Return each case's routes with their figures and sentences, ready for JSON.

    Lengths and distances are in true metres, durations in seconds. The first route by each passage
    of the main island is marked as a side's best one. `gap` is a share, None where none is proven.
    `warnings` tell which currents stand in for others.
    """
    stand_ins = addressed(result.fetched.stand_in_notes, result.scenario)
    return dict(
        json_value(
            {
                "name": result.scenario.name,
                "title": result.scenario.title,
                "no_go": result.fetched.land.no_go_name,
                "seasons": [
                    {
                        "name": case.name,
                        "title": case.title,
                        "failure": case.result.failure,
                        "routes": list(_routes(case)),
                    }
                    for case in result.cases
                ],
                "warnings": [capitalised(one) for one in note_texts(stand_ins)],
                **caveats_json(result),
                "notes": [capitalised(one) for one in note_texts(result.fetched.notes)],
            }
        )
    )


def _routes(case: RunCase) -> Iterator[dict[str, Any]]:
    """Yield the routes of a case, best first."""
    facts = case_facts(case)
    passed: set[str] = set()
    for one in case.routes:
        row = one.metrics
        because = "" if facts is None else facts.because() if one.rank == 1 else ""
        if facts is not None and one.rank > 1:
            because = facts.why_dearer(row)
        yield {
            **_figures(one),
            "excess": row.fuel / case.routes[0].metrics.fuel - 1,
            "because": because,
            "certainty": facts.certainty() if facts is not None and one.rank == 1 else "",
            "is_side": row.main_passage not in passed,
        }
        passed.add(row.main_passage)


def _figures(ranked: RankedRoute) -> dict[str, Any]:
    """Return a route's figures and its line."""
    row, case = ranked.metrics, ranked.case
    passage = case.scenario.passage(case.name, round(row.duration_s))
    return {
        "rank": row.rank,
        "way": row.way,
        "side": row.main_passage,
        "fuel": row.fuel,
        "length_m": row.length_m,
        "duration_s": row.duration_s,
        "clearance_m": row.clearance_m,
        "gap": case.proven_gap(row),
        "trials": row.trials,
        "collisions": row.collisions,
        "departure": passage[0].isoformat() if passage else None,
        "arrival": passage[1].isoformat() if passage else None,
        "line": drawn(case.run.water.projection.to_lonlat(np.asarray(ranked.route.path))),
    }
