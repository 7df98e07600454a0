"""Compare yesterday's route, sailed in tonight's current, with tonight's best route."""

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

# If start or goal moved by more than this share of the route's length, the routes of a pair are not
# compared.
_SAME_END = 1e-6
# If yesterday's route is cheaper by more than this percentage, that is reported; the planner's
# tolerance is smaller.
_CHEAPER_PERCENT = 0.1
# Largest spacing of the points from which the distance between two lines is measured, as a share of
# a leg.
_DENSIFY = 0.01


@dataclass(frozen=True, slots=True)
class Rules:
    """Rules for the outcome "look": the smallest saving, percent; why currents are stale, or ""."""

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
    """Return the columns that compare tonight's best route with yesterday's.

    `keep_fuel` is the fuel of yesterday's route in tonight's current. It is missing if the current
    overpowers the vessel or the route now meets land. The arrival is computed from it, because
    duration and fuel are proportional at constant thrust.
    """
    path = scene.projection.to_plane(earlier.path)
    route = planned.ranked_routes[0]
    allowed = _SAME_END * max(route.length, 1e-9)
    if max(np.hypot(*(path[0] - scene.start)), np.hypot(*(path[-1] - scene.goal))) > allowed:
        return {}
    keep = renew.fuel(path, scene.currents[planned.season], scene.vessel, drift=options.drift)
    line = shapely.LineString(path)
    # A tolerance, because a route without padding may touch land, and rounding may move it onto it.
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
    """Return a planned case's outcome, and the reasons if it is not "same"."""
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
            # Tonight's best route has the least fuel of all routes that are safe tonight.
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
    """Whether the same main island is passed on another side."""
    return earlier != now and earlier.partition(" of ")[2] == now.partition(" of ")[2]
