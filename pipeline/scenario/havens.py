"""The havens of a scenario: places of refuge, and how soon one must be reached from the route."""

from typing import Self

from pydantic import Field, model_validator

from pipeline.scenario import strict
from pipeline.scenario.strict import StrictModel
from pipeline.scenario.times import Interval, interval


class HavensSpec(StrictModel):
    """A list of havens, and the limits within which one of them must be reached."""

    path: strict.PathText = Field(examples=["./havens.geojson"])
    """File with the havens as points, with a column 'name'; relative paths start at the scenario's
    folder. Give a GeoJSON file, another vector file, or CSV with the columns name, lon and lat."""
    within: Interval | None = Field(default=None, examples=["6h"])
    """Longest time from a place of the route to a haven. Give '30min', '6h' or '1d', or leave it
    out where there is an endurance."""
    endurance: Interval | None = Field(default=None, examples=["2d"])
    """Time under way for which there is fuel at departure: what is left where the vessel turns off
    must do. Give '30min', '6h' or '2d', or leave it out where there is 'within'."""

    @model_validator(mode="after")
    def _is_limited(self) -> Self:
        if self.within is None and self.endurance is None:
            raise ValueError(
                "has neither 'within' nor 'endurance'; give one of the two, as within = '6h', or "
                "both"
            )
        return self

    @property
    def within_s(self) -> float | None:
        """Longest time to a haven, s."""
        return None if self.within is None else interval(self.within).total_seconds()

    @property
    def endurance_s(self) -> float | None:
        """Time under way for which there is fuel at departure, s."""
        return None if self.endurance is None else interval(self.endurance).total_seconds()
