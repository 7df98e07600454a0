"""The outcome of a night, and the events that it reports while it runs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Literal

from pipeline.errors import StageError

DONE = 0
"""Exit code of a night that has nothing to tell."""
LOOK_CODE = 10
"""Exit code of a night that published, and an operator should look at some cases or notes."""
SAME = "same"
"""Outcome of a case: yesterday's way is still the best, or nearly."""
LOOK = "look"
"""Outcome of a case that an operator should look at."""
ACT = "act"
"""Outcome of a case: yesterday's way can't be sailed any more, or there is no route."""
OUTCOMES = (SAME, LOOK, ACT)

NightStage = Literal["look", "prepare", "plan", "publish", "check"]


@dataclass(frozen=True, slots=True)
class NightOutcome:
    """How a night ended.

    Attributes
    ----------
    cycle : name of the cycle that `latest` points at; "" if there is none.
    started, finished : start and end of this run of the program, with time zone.
    reference_time : reference time of the newest currents; None if they have no time.
    exit_code : 0 if done or if there was nothing to do; 10 if published, but some case is "look" or
        "act", or there are notes; other codes as the errors of `run_night`.
    cases_by_outcome : number of cases with the outcomes "same", "look" and "act".
    seconds_by_stage : wall time of each stage of this run, s.
    fresh : whether this run made the cycle; False if there was nothing to do.
    message : one line for a reader.
    """

    cycle: str
    started: datetime
    finished: datetime
    reference_time: datetime | None
    exit_code: int
    cases_by_outcome: Mapping[str, int]
    seconds_by_stage: Mapping[str, float]
    fresh: bool = True
    message: str = ""


@dataclass(frozen=True, slots=True)
class NightEvent:
    """The begin, progress (`done` of `total` tasks or cases), end or note of a stage."""

    stage: NightStage
    status: Literal["begun", "working", "done", "failed", "note"]
    detail: str = ""
    done: int = 0
    total: int = 0
    seconds: float = 0.0


NightEventHandler = Callable[[NightEvent], None]


class BusyError(StageError):
    """Another job is running in the same output folder; exit code 4."""

    exit_code = 4


class ComeAgainError(StageError):
    """The currents are not available yet, or older than those of the last cycle; exit code 5."""

    exit_code = 5
