"""Find the earlier results that a night needs: the newest readable cycle, and the history.

Files that can't be read are moved to the folder of damaged files, with a note; the night continues
without them.
"""

from dataclasses import dataclass
from pathlib import Path

from pipeline.nightly.cycle.earlier import CASES_FILE
from pipeline.nightly.cycle.folders import Cycles
from pipeline.nightly.cycle.record import faults_of

HISTORY_FILE = "history.parquet"
_CONSEQUENCES = {
    CASES_FILE: "tonight is compared with an earlier night, if there is one",
    HISTORY_FILE: "the history is made again from the cycles that are kept",
}


@dataclass(frozen=True, slots=True)
class LookBack:
    """The readable results of earlier nights.

    Attributes
    ----------
    cycle : the newest cycle with a readable table of cases, for the comparison with tonight; or "".
    history : the newest readable history, or None.
    later : cycles newer than that history, oldest first: name and readable table of cases.
    notes : one line for each file that could not be read.
    """

    cycle: str = ""
    history: Path | None = None
    later: tuple[tuple[str, Path], ...] = ()
    notes: tuple[str, ...] = ()


def look_back(cycles: Cycles) -> LookBack:
    """Find the readable results of earlier nights; set unreadable files aside.

    The search goes backwards and usually ends after two files of the last cycle.
    """
    compared, history, notes = "", None, list[str]()
    later: list[tuple[str, Path]] = []
    for cycle in reversed(cycles.up_to_latest()):
        folder = cycles.folder(cycle)
        wanted = (CASES_FILE,) if history is not None else (CASES_FILE, HISTORY_FILE)
        faults = faults_of(folder, wanted)
        for name, fault in faults.items():
            cycles.set_aside(folder / name)
            notes.append(f"{cycle}/{name} {fault}; {_CONSEQUENCES[name]}")
        if CASES_FILE not in faults:
            compared = compared or cycle
        if history is None and HISTORY_FILE not in faults:
            history = folder / HISTORY_FILE
        elif history is None and CASES_FILE not in faults:
            later.insert(0, (cycle, folder / CASES_FILE))
        if compared and history is not None:
            break
    return LookBack(compared, history, tuple(later), tuple(notes))
