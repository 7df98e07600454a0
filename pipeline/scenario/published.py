"""Published figures that a scenario's results are compared with."""

from pydantic import Field

from pipeline.scenario.strict import Positive, StrictModel, unit


class PublishedRow(StrictModel):
    """One published route, in the publication's own units."""

    label: str = Field(examples=["RENEW"])
    """Who planned it. Give any text."""
    season: str = Field(default="", examples=["summer"])
    """Season of this scenario that it belongs to. Give the season's name."""
    fuel: Positive | None = Field(default=None, examples=[160.563])
    """Published fuel, in the publication's units. Give a number above 0."""
    clearance: Positive | None = Field(
        default=None, examples=[9.153], json_schema_extra=unit("scaled m")
    )
    """Published clearance from land, in metres of the publication's scale. Give a number above 0.
    """
    length: Positive | None = Field(
        default=None, examples=[164.586], json_schema_extra=unit("scaled m")
    )
    """Published length, in metres of the publication's scale. Give a number above 0."""
    fuel_per_distance: Positive | None = Field(default=None, examples=[0.976])
    """Published F/D; if left out, fuel divided by length. Give a number above 0."""
    side: str = Field(default="", examples=["west"])
    """Compass side on which it passes the largest island. Give 'north', 'east', 'south' or 'west'.
    """


class Published(StrictModel):
    """Published figures that the report compares with this run's."""

    origin: str = Field(examples=["RENEW (AAAI 2026), Palawan"])
    """The publication. Give any text."""
    scale: Positive = 1.0
    """The publication's scale: true metres per published metre. Give a number above 0: 1 is the
    true scale."""
    rows: tuple[PublishedRow, ...]
    """The published routes. Add a [[published.rows]] table for each."""
