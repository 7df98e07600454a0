"""A voyage under way, as it is asked for: the table of its options."""

from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Annotated

from pipeline.voyage.readers import Position, read_position, zoned_time
from pipeline.voyage.table import Option

_option = partial(Option, group="Other options")


def _heading(degrees: float) -> float:
    """Check a true heading, degrees."""
    if not 0 <= degrees <= 360:
        raise ValueError(
            f"{degrees:g} is no true heading; give degrees from 0 to 360, clockwise from north"
        )
    return float(degrees)


@dataclass(frozen=True, kw_only=True)
class UnderWayRequest:
    """Where the vessel is, when, on which true heading (degrees), and what has changed.

    `departed` is when it left, if the plan does not say so. Without `currents` those of the plan
    hold. `name` is that of the new results.
    """

    results: Annotated[
        Path,
        Option(
            group="",
            kind="folder",
            metavar="RESULTS",
            help="Folder of a finished run, such as outputs/NAME.",
        ),
    ]
    at: Annotated[
        Position,
        _option(
            read=read_position,
            metavar="POSITION",
            help="Where the vessel is, as '119.95E 9.99N'.",
        ),
    ]
    time: Annotated[
        datetime,
        _option(read=zoned_time, metavar="TIME", help="When it is there, as 2026-11-22T09:30Z."),
    ]
    heading_deg: Annotated[
        float | None,
        _option(
            name="heading",
            kind="number",
            read=_heading,
            metavar="DEGREES",
            help="Its true heading, from which the route begins with a turn; by default it begins "
            "on the best heading.",
        ),
    ] = None
    currents: Annotated[
        tuple[str, ...],
        _option(
            kind="source",
            read=tuple,
            most=32,
            help="The new currents, as for `renew run`; by default those of the plan hold.",
        ),
    ] = ()
    season: Annotated[str, _option(help="The season that is sailed, if several were planned.")] = ""
    departed: Annotated[
        datetime | None,
        _option(
            read=zoned_time,
            metavar="TIME",
            help="When the vessel left, as 2026-11-22T06:00Z, if the plan has no departure.",
        ),
    ] = None
    name: Annotated[str, _option(help="Name of the folder of results.")] = ""
    offline: Annotated[bool, _option(kind="flag", help="Use no source that needs the network.")] = (
        False
    )
