"""Voyages under way: each is planned again in tonight's currents from its last position."""

import csv
import math
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

from pipeline.errors import PipelineError, RequestError
from pipeline.nightly.config import NightConfig, VoyageSpec
from pipeline.nightly.cycles import Row
from pipeline.nightly.records import ACT, LOOK, SAME
from pipeline.scenario.strict import looks_like_path
from pipeline.texts import cell
from pipeline.voyage.positions import Position
from pipeline.voyage.under_way import Fix, last_fix

VOYAGES_FILE = "voyages.csv"
"""A cycle's table of the voyages under way."""


# Columns that are figures of planning again, in the planner's units of fuel, metres and seconds.
_FIGURES = ("fuel", "kept_fuel", "off_m", "late_s", "by_drift", "by_forecast", "saved")
_COLUMNS = (
    *("voyage", "outcome", "answer", "reason", "time", "lon", "lat"),
    *(*_FIGURES, "results"),
)


def planned_again(config: NightConfig, spec: VoyageSpec) -> Row:
    """Plan a voyage again from its last position; results lie beside those of its plan.

    Returns a row of the table: where the vessel was, and what planning again answered: kept,
    switched or failed, with the reason. `results` is the folder of the new results. A voyage that
    can't be planned again does not stop the night: its row says why.
    """
    folder = Path(config.here(spec.results)).expanduser()
    row: Row = {"voyage": folder.name}
    try:
        fix = _last_fix(config, spec)
        time = datetime.fromtimestamp(fix.time, UTC)
        row |= {"time": time.isoformat(), "lon": fix.lon, "lat": fix.lat}
        return row | _answer(config, spec, folder, Position(fix.lon, fix.lat), time)
    except PipelineError as error:
        reason = "; ".join(str(error).splitlines())
        return row | {"outcome": ACT, "answer": "failed", "reason": reason}


def _last_fix(config: NightConfig, spec: VoyageSpec) -> Fix:
    """Return the vessel's last position; RequestError if there is none."""
    path = Path(config.here(spec.positions)).expanduser()
    try:
        fix = last_fix(path)
    except OSError as error:
        raise RequestError(f"positions: {path.name} can't be read ({error.strerror})") from None
    if fix is None:
        raise RequestError(
            f"positions: {path.name} ends without a position; give NMEA 0183 (RMC) or JSON lines"
        )
    return fix


def _answer(
    config: NightConfig, spec: VoyageSpec, folder: Path, at: Position, time: datetime
) -> Row:
    """Run the voyage ahead, and return the columns with what that answers."""
    from pipeline.findings.choices import replanned_text
    from pipeline.run import run
    from pipeline.voyage.request import UnderWayRequest
    from pipeline.voyage.under_way import under_way_scenario

    currents = (config.here(name) if looks_like_path(name) else name for name in spec.currents)
    scenario, _ = under_way_scenario(
        UnderWayRequest(
            results=folder,
            at=at,
            time=time,
            currents=tuple(currents),
            season=spec.season,
            departed=spec.departed,
        )
    )
    ended = run(scenario, folder.absolute().parent)
    (replanned,) = (case.replanned for case in ended.result.results)
    if replanned is None:
        raise RequestError("; ".join(ended.failures))
    return {
        "outcome": SAME if replanned.answer == "kept" else LOOK,
        "answer": replanned.answer,
        "reason": " ".join(replanned_text(replanned)),
        **{name: getattr(replanned, name) for name in _FIGURES},
        "results": ended.directory.name,
    }


def write_voyages(voyages: Iterable[Row], path: Path) -> None:
    """Write the table of voyages; figures that are missing are empty."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, _COLUMNS, lineterminator="\n")
        writer.writeheader()
        for voyage in voyages:
            known = {
                name: cell(value)
                for name, value in voyage.items()
                if not isinstance(value, float) or math.isfinite(value)
            }
            writer.writerow(known)
