"""Speeds of a season, among which the vessel chooses from leg to leg."""

from typing import Annotated

from pydantic import Field

from pipeline.scenario.strict import Positive, StrictModel

# As of a vessel's own speed.
_Speed = Annotated[Positive, Field(le=1e6)]


class SpeedRange(StrictModel):
    """Lowest and highest speed through water, in place of the vessel's own speed."""

    least: _Speed = Field(
        description="Lowest speed through water, m/s. Give a speed in m/s, above 0.",
        examples=[2.5],
        json_schema_extra={"unit": "m/s"},
    )
    most: _Speed = Field(
        description="Highest speed through water, m/s, for which land is padded. Give a speed in "
        "m/s, not below 'least'.",
        examples=[6.0],
        json_schema_extra={"unit": "m/s"},
    )
