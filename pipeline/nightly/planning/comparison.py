"""What changed: yesterday's route sailed in tonight's current, beside tonight's best."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np
import shapely

import renew
from pipeline.model import RouteMetrics, Scene, SeasonPlan
from pipeline.nightly.cycle.earlier import EarlierRoute
from pipeline.nightly.cycle.part import Row
from pipeline.nightly.outcome import ACT, LOOK, SAME
from pipeline.scenario.model import PlannerOptions

# Distance between the ends of two routes below which they are the same, share of their length: a
# pair that was moved has no yesterday.
_SAME_END = 1e-6
# Percentage by which yesterday's route must be cheaper to be worth a word: above the planner's own
# tolerance.
_CHEAPER_PERCENT = 0.1
# Share of a line at which points are added for the distance between two, which is measured from
# points.
_DENSIFY = 0.01


@dataclass(frozen=True, slots=True)
class Rules:
    """When somebody should look: the saving, percent; and why the currents are too old, or ""."""

    look_percent: float
    stale: str = ""


def compared(
    earlier: EarlierRoute,
    scene: Scene,
    planned: SeasonPlan,
    best: RouteMetrics,
    options: PlannerOptions,
    scale: float,
    leaves: datetime | None,
) -> Row:
    """Return the columns that set tonight's best route beside yesterday's.

    `keep_fuel` is what yesterday's route needs in tonight's current, null where no way can be made
    along it or it now meets land. Its arrival follows from the fuel: at constant thrust one is
    proportional to the other.
    """
    path = scene.projection.to_plane(earlier.path)
    route = planned.ranked_routes[0]
    allowed = _SAME_END * max(route.length, 1e-9)
    if max(np.hypot(*(path[0] - scene.start)), np.hypot(*(path[-1] - scene.goal))) > allowed:
        return {}
    keep = renew.fuel(path, scene.currents[planned.season], scene.vessel, drift=options.drift)
    line = shapely.LineString(path)
    # A route may touch land where it was planned without padding, and rounding carries it inside.
    if shapely.intersection(scene.chart.hard_no_go, line).length > allowed:
        keep = math.inf
    row = earlier.columns()
    apart = shapely.hausdorff_distance(line, shapely.LineString(route.path), densify=_DENSIFY)
    row["apart_m"] = float(apart) * scale
    if math.isfinite(keep):
        row["keep_fuel"] = keep
        row["saving_percent"] = 100 * (keep - route.fuel) / keep
        if leaves is not None:
            duration_s = best.duration_s * keep / route.fuel
            row["keep_arrival"] = leaves + timedelta(seconds=round(duration_s))
    return row


def judged(row: Row, planned: SeasonPlan, rules: Rules) -> tuple[str, str]:
    """Return a planned case's outcome, and why it is not *same*."""
    act, look = list[str](), list[str]()
    if row.get("earlier_class") is not None:
        rejected = {one.homotopy for one in planned.plan.rejected} if planned.plan else set()
        sailed = {route.homotopy for route in planned.ranked_routes}
        name = row["earlier_class"]
        if name in rejected - sailed or row.get("keep_fuel") is None:
            act.append(f"yesterday's class {name} can't be sailed any more")
        if _has_flipped(row["earlier_side"], row["side"]):
            look.append(f"{row['earlier_side']} yesterday, {row['side']} now")
        saving = row.get("saving_percent")
        if saving is not None and saving < -_CHEAPER_PERCENT:
            # Tonight's best is the least of all routes that are safe tonight.
            look.append(
                f"yesterday's route would need {-saving:.1f} % less, but no longer keeps the "
                "clearance that tonight's current asks for"
            )
        if saving is not None and saving > rules.look_percent:
            look.append(f"changing the route saves {saving:.1f} %")
    if rules.stale:
        look.append(rules.stale)
    if row.get("stand_in"):
        look.append(row["stand_in"])
    outcome = ACT if act else LOOK if look else SAME
    return outcome, "; ".join([*act, *look])


def _has_flipped(earlier: str, now: str) -> bool:
    """Say whether the main island is passed on another side, not which island is."""
    return earlier != now and earlier.partition(" of ")[2] == now.partition(" of ")[2]
