"""The tide of a scenario: its stations, and how much of the prediction the vessel relies on."""

from typing import Annotated

from pydantic import AfterValidator, Field, ValidationInfo

from pipeline.scenario import strict
from pipeline.scenario.strict import StrictModel
from pipeline.scenario.times import Span, span


def _as_path(station: str, info: ValidationInfo) -> str:
    """Make the path of a station's file absolute; keep a name of the catalogue."""
    return strict.usable_path(station, info) if strict.looks_like_path(station) else station


class TideSpec(StrictModel):
    """Stations that predict the tide over the chart datum, and how far the vessel relies on it."""

    stations: tuple[Annotated[str, AfterValidator(_as_path)], ...] = Field(
        min_length=1, max_length=100, examples=[["boston"], ["./boston.json"]]
    )
    """Tide stations. Each counts in its zone, or else in the waters to which it is the nearest by
    water, within 10 km. Give names of the catalogue (`renew list`), or paths of files with harmonic
    constants."""
    surge_m: strict.NonNegative = 0.3
    """Height by which the water may stand lower than predicted, by wind and air pressure, metres.
    Give metres, 0 or more."""
    lag: Span = "15min"
    """Time by which the tide may be early or late. Give '15min' or '1h', or '0min'."""

    @property
    def lag_s(self) -> float:
        """Time by which the tide may be early or late, s."""
        return span(self.lag).total_seconds()
