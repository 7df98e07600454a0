"""Published figures that a scenario's results are compared with."""

from pydantic import Field

from pipeline.scenario.strict import Positive, StrictModel


class PublishedRow(StrictModel):
    """One published route, in the publication's own units."""

    label: str = Field(description="Who planned it. Give any text.", examples=["RENEW"])
    season: str = Field(
        default="",
        description="Season of this scenario that it belongs to. Give the season's name.",
        examples=["summer"],
    )
    fuel: Positive | None = Field(
        default=None,
        description="Published fuel, in the publication's units. Give a number above 0.",
        examples=[160.563],
    )
    clearance: Positive | None = Field(
        default=None,
        description="Published clearance from land, in metres of the publication's scale. Give a "
        "number above 0.",
        examples=[9.153],
        json_schema_extra={"unit": "scaled m"},
    )
    length: Positive | None = Field(
        default=None,
        description="Published length, in metres of the publication's scale. Give a number above "
        "0.",
        examples=[164.586],
        json_schema_extra={"unit": "scaled m"},
    )
    fuel_per_distance: Positive | None = Field(
        default=None,
        description="Published F/D; if left out, fuel divided by length. Give a number above 0.",
        examples=[0.976],
    )
    side: str = Field(
        default="",
        description="Compass side on which it passes the largest island. Give 'north', 'east', "
        "'south' or 'west'.",
        examples=["west"],
    )


class Published(StrictModel):
    """Published figures that the report compares with this run's."""

    origin: str = Field(
        description="The publication. Give any text.", examples=["RENEW (AAAI 2026), Palawan"]
    )
    scale: Positive = Field(
        default=1.0,
        description="The publication's scale: true metres per published metre. Give a number "
        "above 0: 1 is the true scale.",
    )
    rows: tuple[PublishedRow, ...] = Field(
        description="The published routes. Add a [[published.rows]] table for each."
    )
