"""The frozen dataclasses that stages take and return: nothing else passes between them."""

from pipeline.model.currents import (
    CurrentGrid,
    Fetched,
    PassedOver,
    current_notes,
)
from pipeline.model.evaluation import (
    ClockWorth,
    Evaluation,
    GapShares,
    NumberedIsland,
    Passage,
    RouteKey,
    RouteMetrics,
    ShoreCrossing,
    ShutStrait,
    Side,
    SideBound,
)
from pipeline.model.land import (
    Credit,
    DepthArea,
    Land,
    PlaceName,
    Zone,
)
from pipeline.model.planning import Current as Current
from pipeline.model.planning import (
    DepartureChoice,
    Scene,
    SeasonPlan,
    Simplified,
    SpeedChoice,
)

__all__ = [
    "ClockWorth",
    "Credit",
    "CurrentGrid",
    "DepartureChoice",
    "DepthArea",
    "Evaluation",
    "Fetched",
    "GapShares",
    "Land",
    "NumberedIsland",
    "Passage",
    "PassedOver",
    "PlaceName",
    "RouteKey",
    "RouteMetrics",
    "Scene",
    "SeasonPlan",
    "ShoreCrossing",
    "ShutStrait",
    "Side",
    "SideBound",
    "Simplified",
    "SpeedChoice",
    "Zone",
    "current_notes",
]
