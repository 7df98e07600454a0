"""A run's figures compared with published ones."""

from dataclasses import dataclass

from pipeline.formats.shared.result import RunResult
from pipeline.scenario.published import PublishedRow


@dataclass(frozen=True)
class Comparison:
    """A season's best route, or a published one; unknown figures are None.

    `fuel` and `length` are in the scaled units of the route's own planner, `length_m` and
    `clearance_m` true metres.
    """

    season: str
    planner: str
    is_ours: bool
    scale: float
    way: str
    fuel_per_distance: float | None
    fuel: float | None
    length: float | None
    length_m: float | None
    clearance_m: float | None


def comparison(result: RunResult) -> tuple[Comparison, ...]:
    """Each season's best route, followed by the published ones of that season."""
    published = result.scenario.published
    if published is None:
        return ()
    rows = []
    seasons = {entry.season for entry in result.plans}
    for entry in result.plans:
        for ranked in result.season_routes(entry.season)[:1]:
            metrics = ranked.metrics
            rows.append(
                Comparison(
                    season=result.season_title(entry.season),
                    planner="This run",
                    is_ours=True,
                    scale=result.scenario.scale,
                    way=metrics.main_passage,
                    fuel_per_distance=metrics.fuel_per_distance,
                    fuel=metrics.fuel,
                    length=metrics.length,
                    length_m=metrics.length_m,
                    clearance_m=metrics.clearance_m,
                )
            )
        rows += [
            Comparison(
                season=result.season_title(row.season) if row.season in seasons else row.season,
                planner=row.label,
                is_ours=False,
                scale=published.scale,
                way=row.side,
                fuel_per_distance=_published_ratio(row),
                fuel=row.fuel,
                length=row.length,
                length_m=None if row.length is None else row.length * published.scale,
                clearance_m=None if row.clearance is None else row.clearance * published.scale,
            )
            for row in published.rows
            if row.season == entry.season or (not row.season and entry is result.plans[0])
        ]
    return tuple(rows)


def _published_ratio(row: PublishedRow) -> float | None:
    """F/D as published, or from fuel and length."""
    if row.fuel_per_distance is None and row.fuel is not None and row.length is not None:
        return row.fuel / row.length
    return row.fuel_per_distance
