"""The frozen dataclasses that stages take and return: nothing else passes between them."""

from pipeline.model.case import (
    Case as Case,
    Current as Current,
    Energy as Energy,
    MemberCurrents as MemberCurrents,
    SimplifiedLand as SimplifiedLand,
    SpeedChoice as SpeedChoice,
    VoyageBefore as VoyageBefore,
    Water as Water,
    plan_options as plan_options,
    planner_vessel as planner_vessel,
)
from pipeline.model.inputs import (
    Credit as Credit,
    CurrentGrid as CurrentGrid,
    Fetched as Fetched,
    Land as Land,
    MemberGrid as MemberGrid,
    Note as Note,
    Place as Place,
    PlaceName as PlaceName,
    Say as Say,
    Zone as Zone,
    of_cases as of_cases,
)
from pipeline.model.result import (
    CaseResult as CaseResult,
    DepartureChoice as DepartureChoice,
    EnsembleFigures as EnsembleFigures,
    Measures as Measures,
    NarrowStretch as NarrowStretch,
    Passage as Passage,
    ReplanFigures as ReplanFigures,
    RouteKey as RouteKey,
    RouteMetrics as RouteMetrics,
    ShoreCrossing as ShoreCrossing,
    ShutStrait as ShutStrait,
)
