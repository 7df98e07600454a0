"""An environment: a scenario, the cases planned in it, and published figures."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from pipeline.scenario.strict import Integer, Name, NonNegative, Positive, StrictModel

Padding = Literal["adaptive", "none"] | Positive


class Case(StrictModel):
    """One season of the scenario, and how our route is padded in it.

    With `vertices` its land is cut down to so many, as on the paper's charts.
    """

    name: Name
    title: str
    season: Name
    padding: Padding = Field(
        default="adaptive", description="Padding. Give 'adaptive', 'none' or metres."
    )
    clearance: NonNegative = Field(
        default=0.0, description="Floor on the padding, metres. Give 0 or more."
    )
    vertices: Annotated[Integer, Field(ge=8)] | None = Field(
        default=None, description="Most vertices of the chart. Give 8 or more."
    )


class Published(StrictModel):
    """A published row, in the publication's units; what it does not give is None."""

    case: Name
    planner: str
    smoothed: bool = True
    classes: Integer | None = None
    fuel: Positive
    clearance: Positive
    length: Positive
    fuel_per_distance: Positive | None = None
    states: Positive | None = None
    collisions: Annotated[Integer, Field(ge=0)] | None = None
    trials: Integer | None = None
    side: str = ""


class EnvironmentSpec(StrictModel):
    """What `experiments/catalog/<name>.toml` holds.

    `scene` says where it comes from: read off a published picture, reconstructed from published
    figures, or ours; then equal figures are no evidence. `scenario` is a scenario's name or its
    table; `currents` and `scale` replace the scenario's own. `cell_m` and `nodes` size the grids
    and roadmaps of the baselines, as published; `dubins_step_m` is the longest step of trees of
    poses, such that they are about as large as published; `station_m` is the spacing of the paper's
    contingency turns; `runs` is the number of seeds of planners that draw. `baselines` are those of
    the paper that run in it, all if it is left out; k and the order of classes vary where it
    `is_swept`. An environment with no `baselines` at all has no rivals either. `island` is a point,
    degrees, in an island on the way: tables say on which side of it, west or east, a path passes.
    """

    schema_version: Literal[1]
    name: Name
    title: str
    scene: Literal["read off", "reconstructed", "ours"]
    remark: str = Field(description="What is ours in it. Say so in a sentence.")
    scenario: Name | dict[str, Any]
    currents: tuple[Name, ...] = ()
    scale: Positive | None = None
    classes: Annotated[Integer, Field(ge=1)] = 16
    cell_m: Positive = 2.0
    nodes: Annotated[Integer, Field(ge=10)] = 2000
    dubins_step_m: Positive = 14.0
    station_m: Positive = 1.0
    runs: Annotated[Integer, Field(ge=1)] = 10
    baselines: tuple[str, ...] | None = None
    is_swept: bool = False
    island: tuple[float, float] | None = None
    cases: tuple[Case, ...] = Field(min_length=1)
    published: tuple[Published, ...] = ()

    def case(self, name: str) -> Case:
        """The case of a name."""
        return next(case for case in self.cases if case.name == name)
