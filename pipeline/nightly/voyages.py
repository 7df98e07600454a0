"""Voyages under way: each is planned again in tonight's currents from its last position."""

import csv
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from pipeline.errors import PipelineError, RequestError
from pipeline.nightly.config import NightConfig, VoyageSpec
from pipeline.nightly.outcome import ACT, LOOK, SAME
from pipeline.scenario.strict import looks_like_path
from pipeline.texts import cell
from pipeline.underway.reports import Fix, last_fix
from pipeline.voyage.readers import Position

VOYAGES_FILE = "voyages.csv"
"""A cycle's table of the voyages under way."""


@dataclass(frozen=True)
class SailedVoyage:
    """A row of the table: where the vessel was, and what planning again answered.

    `answer` is kept, switched or failed, with its `reason`. Fuel is in the planner's units; figures
    are NaN where there are none. `results` is the folder of the new results.
    """

    voyage: str
    outcome: str
    answer: str
    reason: str
    time: str
    lon: float
    lat: float
    fuel: float = math.nan
    kept_fuel: float = math.nan
    off_m: float = math.nan
    late_s: float = math.nan
    by_drift: float = math.nan
    by_forecast: float = math.nan
    saved: float = math.nan
    results: str = ""

    @property
    def sentence(self) -> str:
        """What happened, for a reader."""
        return f"voyage {self.voyage}: {self.reason}"


def planned_again(config: NightConfig, spec: VoyageSpec) -> SailedVoyage:
    """Plan a voyage again from its last position; results lie beside those of its plan.

    A voyage that can't be planned again does not stop the night: its row says why.
    """
    folder = Path(config.here(spec.results)).expanduser()
    fix: Fix | None = None
    try:
        fix = _last_fix(config, spec)
        return _answered(config, spec, folder, fix)
    except PipelineError as error:
        reason = "; ".join(str(error).splitlines())
        time, lon, lat = _place(fix)
        return SailedVoyage(folder.name, ACT, "failed", reason, time, lon, lat)


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


def _answered(config: NightConfig, spec: VoyageSpec, folder: Path, fix: Fix) -> SailedVoyage:
    """Run the voyage ahead, and return its row."""
    from pipeline.findings.choices import replanned_text
    from pipeline.run import run
    from pipeline.underway.replan import under_way_scenario
    from pipeline.underway.request import UnderWayRequest

    time, lon, lat = _place(fix)
    currents = (config.here(one) if looks_like_path(one) else one for one in spec.currents)
    scenario, _ = under_way_scenario(
        UnderWayRequest(
            results=folder,
            at=Position(fix.lon, fix.lat),
            time=datetime.fromtimestamp(fix.time, UTC),
            currents=tuple(currents),
            season=spec.season,
            departed=spec.departed,
        )
    )
    ended = run(scenario, folder.absolute().parent)
    (found,) = (one.replanned for one in ended.result.results)
    if found is None:
        raise RequestError("; ".join(ended.failures))
    return SailedVoyage(
        voyage=folder.name,
        outcome=SAME if found.answer == "kept" else LOOK,
        answer=found.answer,
        reason=" ".join(replanned_text(found)),
        time=time,
        lon=lon,
        lat=lat,
        fuel=found.fuel,
        kept_fuel=found.kept_fuel,
        off_m=found.off_m,
        late_s=found.late_s,
        by_drift=found.by_drift,
        by_forecast=found.by_forecast,
        saved=found.saved,
        results=ended.directory.name,
    )


def _place(fix: Fix | None) -> tuple[str, float, float]:
    """Return time, longitude and latitude of a position for the table."""
    if fix is None:
        return "", math.nan, math.nan
    return datetime.fromtimestamp(fix.time, UTC).isoformat(), fix.lon, fix.lat


def write_voyages(voyages: Sequence[SailedVoyage], path: Path) -> None:
    """Write the table of voyages; figures that are missing are empty."""
    rows = [asdict(one) for one in voyages]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow(
                {
                    key: "" if isinstance(one, float) and not math.isfinite(one) else cell(one)
                    for key, one in row.items()
                }
            )
