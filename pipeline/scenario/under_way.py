"""A voyage that is planned again while the vessel sails an earlier plan."""

import os
from collections.abc import Iterator, Sequence
from typing import Annotated

from pydantic import AfterValidator, AwareDatetime, Field, ValidationInfo

from pipeline.scenario import strict
from pipeline.scenario.region import Region
from pipeline.scenario.season import Season
from pipeline.scenario.strict import StrictModel


def _behind_link(text: str, info: ValidationInfo) -> str:
    """Make a folder's path absolute, with its links: one leads to the newest results."""
    strict.usable_path(text, info)
    folder = str(info.context["folder"]) if text and info.context else ""
    whole = os.path.normpath(os.path.join(folder, os.path.expanduser(text))) if folder else text  # noqa: PTH111, PTH118 - a Path does not drop ".."
    return strict.DiskPath(whole)


class UnderWay(StrictModel):
    """The plan that the vessel sails, and its heading: it is at the scenario's start now."""

    results: Annotated[str, AfterValidator(_behind_link)] = Field(examples=["../crossing"])
    """Folder of the results that have the plan. Give the path of the folder of a finished run."""
    season: strict.Name = Field(examples=["summer"])
    """The season of those results that the vessel sails. Give its name."""
    departed: AwareDatetime = Field(examples=["2026-07-01T06:00:00Z"])
    """When the vessel left. Give a time with its zone, as 2026-07-01T06:00:00Z."""
    heading_deg: strict.Number | None = Field(
        default=None, ge=0, le=360, examples=[215.0], json_schema_extra=strict.unit("degrees true")
    )
    """The vessel's true heading, where the route begins with a turn; by default it begins on the
    best one. Give degrees from 0 to 360, clockwise from north."""
    same_currents: bool = False
    """Whether the plan's own currents still hold; otherwise those of the season are read. Give true
    or false."""
    switch_above: strict.Number = Field(default=0.02, ge=0, le=1)
    """Share of the fuel ahead that a way on another side has to save before the vessel changes to
    it. Give a share from 0 to 1, such as 0.02."""

    def faults(
        self, seasons: Sequence[Season], region: Region | None, scale: float, *, waits: bool
    ) -> Iterator[str]:
        """Find keys of a scenario that do not go together with this table."""
        if region is None:
            yield "has [under_way], which needs the [region] of the plan's results; add it"
        if scale != 1:
            yield (
                f"has [under_way] at scale = {scale:g}, where times under way are not the true "
                "ones; plan at true scale, scale = 1"
            )
        if waits:
            yield "has [under_way] and a wait at an anchorage; plan from here without [under_way]"
        if len(seasons) != 1:
            yield f"has [under_way] and {len(seasons)} seasons; give the one that is sailed"
            return
        (season,) = seasons
        if season.speed or season.members or season.leaves_departure_open:
            yield (
                f"season {season.name!r} has members of its current, or leaves speeds or times "
                "open, which [under_way] does not know; plan from here without [under_way]"
            )
        if season.departure is None:
            yield f"season {season.name!r} has no 'departure', the time at 'start'; add it"
        elif season.departure < self.departed:
            yield (
                f"season {season.name!r} has departure = {season.departure.isoformat()}, before "
                f"under_way.departed = {self.departed.isoformat()}; give a later time"
            )
