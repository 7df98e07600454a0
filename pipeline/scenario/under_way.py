"""A voyage that is planned again while the vessel sails an earlier plan."""

import os
from typing import Annotated

from pydantic import AfterValidator, AwareDatetime, Field, ValidationInfo

from pipeline.scenario import strict
from pipeline.scenario.strict import StrictModel


def _behind_link(text: str, info: ValidationInfo) -> str:
    """Make a folder's path absolute, with its links: one leads to the newest results."""
    strict.usable_path(text, info)
    folder = str(info.context["folder"]) if text and info.context else ""
    return os.path.normpath(os.path.join(folder, os.path.expanduser(text))) if folder else text  # noqa: PTH111, PTH118 - a Path does not drop ".."


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
