"""The small run with changes that a file format might not handle."""

from collections.abc import Mapping
from dataclasses import replace

import shapely.affinity
from shapely.geometry import Polygon

from pipeline.findings.result import RunResult
from pipeline.geo.projection import Projection
from pipeline.model import Credit, Land
from pipeline.texts import clean
from tests.pipeline.results import with_water

SCRIPT = "<script>alert(1)</script>'; DROP TABLE routes; -- \"&\\ [% 1 + 1 %]"
_RIVER = "\u0646\u0647\u0631\U0001f30a"  # Arabic, right to left, and a wave
ODD = clean(f"|layername=no_go|option:X=1|subset=1 \x07\x1b ../..\u202e{_RIVER}{'x' * 300}")
BAD_CREDIT = Credit("Bad & worse", "land", f"© {SCRIPT} {ODD}", "<b>none</b>")


def renamed(result: RunResult, names: Mapping[str, str]) -> RunResult:
    """The same run, with seasons of other names."""
    seasons = tuple(
        spec.model_copy(update={"name": names[spec.name], "title": ""})
        for spec in result.scenario.seasons
    )
    return replace(
        result,
        scenario=result.scenario.model_copy(update={"seasons": seasons}),
        fetched=replace(
            result.fetched,
            currents=tuple(replace(g, case=names[g.case]) for g in result.fetched.currents),
        ),
        planned={
            names[name]: replace(case, name=names[name]) for name, case in result.planned.items()
        },
        results=tuple(replace(one, name=names[one.name]) for one in result.results),
    )


def badly_named(result: RunResult) -> RunResult:
    """The same run, with names, titles and credits that have a meaning in SQL, XML and QGIS."""
    bad = renamed(result, {"summer": SCRIPT, "winter": ODD})
    land = replace(bad.fetched.land, credits=(BAD_CREDIT,))
    return replace(
        bad,
        scenario=bad.scenario.model_copy(
            update={"name": ODD, "title": SCRIPT, "description": SCRIPT}
        ),
        fetched=replace(bad.fetched, land=land),
    )


def moved_east(result: RunResult, degrees: float) -> RunResult:
    """The same run further east; the planar data stay, since the plane has its own meridian."""
    region = result.scenario.area

    def shifted(polygons: tuple[Polygon, ...]) -> tuple[Polygon, ...]:
        return tuple(shapely.affinity.translate(polygon, degrees) for polygon in polygons)

    land: Land = result.fetched.land
    projection = Projection.for_region(
        shapely.affinity.translate(region, degrees), result.scenario.scale
    )
    return replace(
        with_water(result, projection=projection),
        fetched=replace(
            result.fetched,
            land=replace(land, polygons=shifted(land.polygons)),
            currents=tuple(replace(g, lon=g.lon + degrees) for g in result.fetched.currents),
        ),
        simplified=replace(result.simplified, polygons=shifted(result.simplified.polygons)),
    )
