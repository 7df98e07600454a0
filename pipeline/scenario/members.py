"""The members of a season's current: forecasts that may each come true."""

from typing import Literal, Self

from pydantic import Field, model_validator

from pipeline.scenario import strict
from pipeline.scenario.strict import StrictModel

FILES, CYCLES = "files", "cycles"
"""Words for members that are files of their own, or the forecasts in folders of their own."""


class MembersSpec(StrictModel):
    """Currents that may each come true, and what the side is chosen by.

    Turns are clear in every member, and results say in how many of them each side is best.
    """

    along: str = Field(default="", examples=["member"])
    """Where the members are: 'files', if each file of the season's source is one; 'cycles', if the
    files of each folder are one forecast, the newest in the folder whose name is the last; or the
    name of a dimension of its files. Give 'files', 'cycles' or a name such as 'realization', or
    leave it out for 'spread', and in a night for the forecasts that it has kept."""
    spread: strict.Positive | None = Field(
        default=None, le=10, examples=[0.2], json_schema_extra=strict.unit("m/s")
    )
    """Typical error of the current, rms: members are then the current with random eddies of this
    speed. Give m/s, such as 0.2, or leave it out for 'along'."""
    eddy_km: strict.Positive = Field(default=80.0, le=1e4, json_schema_extra=strict.unit("km"))
    """Wave length of the eddies of 'spread', about, true km. Give km, such as 80."""
    count: strict.Integer = Field(default=20, ge=2, le=200)
    """Number of members with 'spread'; of forecasts that a night keeps, the most. Give a whole
    number from 2 to 200."""
    weights: tuple[strict.NonNegative, ...] = Field(default=(), examples=[[2.0, 1.0, 1.0]])
    """How likely each member is, in their order; by default all are equally likely. Give numbers,
    0 or more, or leave it out."""
    choose: Literal["mean", "p90", "cvar90", "regret"] = "mean"
    """What the side is chosen by: the mean fuel over the members, the fuel that nine in ten don't
    exceed, the mean of the worst tenth, or the largest excess over a member's best side. Give
    'mean', 'p90', 'cvar90' or 'regret'."""

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if self.along and self.spread is not None:
            raise ValueError("has both 'along' and 'spread'; give one of the two")
        if self.weights and not self.along:
            which = "forecasts that a night keeps" if self.are_kept else "random members"
            raise ValueError(f"has 'weights' for {which}; leave them out, or give 'along'")
        return self

    @property
    def are_kept(self) -> bool:
        """Whether the members are the forecasts that a night keeps."""
        return not self.along and self.spread is None
