"""How a night ends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping
    from datetime import datetime


@dataclass(frozen=True, slots=True)
class NightOutcome:
    """How a night ended.

    Attributes
    ----------
    cycle : name of the cycle that is in place now; "" where there is none.
    started, finished : aware datetimes of this run of the program.
    reference_time : that of the newest currents; None where they have no time.
    exit_code : 0 done, or nothing to do; 10 published, and some case is *look* or *act*.
    cases_by_outcome : number of cases by how they ended.
    seconds_by_stage : wall time of each stage of this run, s.
    """

    cycle: str
    started: datetime
    finished: datetime
    reference_time: datetime | None
    exit_code: int
    cases_by_outcome: Mapping[str, int]
    seconds_by_stage: Mapping[str, float]
