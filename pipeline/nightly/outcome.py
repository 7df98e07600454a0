"""The outcome of a night, and the events that it reports while it works."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Literal

from pipeline.errors import StageError

DONE, LOOK_CODE = 0, 10
"""Exit codes: nothing to see; published, and somebody should look."""

SAME, LOOK, ACT = "same", "look", "act"
OUTCOMES = (SAME, LOOK, ACT)
"""How a case ends."""

NightStage = Literal["look", "prepare", "plan", "publish", "check"]


@dataclass(frozen=True, slots=True)
class NightOutcome:
    """How a night ended.

    Attributes
    ----------
    cycle : name of the cycle that is in place now; "" where there is none.
    started, finished : aware datetimes of this run of the program.
    reference_time : reference time of the newest currents; None if they have no time.
    exit_code : 0 done, or nothing to do; 10 published, and some case is "look" or "act".
    cases_by_outcome : number of cases that ended as "same", "look" and "act".
    seconds_by_stage : wall time of each stage of this run, s.
    fresh : whether this run made the cycle; False where there was nothing to do.
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
    """A stage began, got on, ended, or has a note; `done` of `total` tasks or cases are done."""

    stage: NightStage
    status: Literal["begun", "working", "done", "failed", "note"]
    detail: str = ""
    done: int = 0
    total: int = 0
    seconds: float = 0.0


NightEventHandler = Callable[[NightEvent], None]


def ignore(event: NightEvent) -> None:
    """Ignore an event."""
    del event


class BusyError(StageError):
    """Another job is at work on the same output: exit code 4."""

    exit_code = 4


class ComeAgainError(StageError):
    """The currents are not there yet, or older than those of the last cycle: exit code 5."""

    exit_code = 5
