"""All that a power cut may leave of a command's writes, and how the next start copes with it."""

from __future__ import annotations

import os
import random
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from tests.robustness.disk import (
    Call,
    Disk,
    Replay,
    State,
    calls_in,
    digest,
    folder_of,
    traced,
    write_state,
)

SEED = 20_261_124
# Number of different states of the disk from which a next start is tried.
STARTS = int(os.environ.get("RENEW_POWER_CUTS", "25"))


class Cuts:
    """All states that a power cut may leave while a command writes to a folder with results."""

    def __init__(self, folder: Path, output: Path, link: str, command: Sequence[str]) -> None:
        self.output, self.link = output, str(output / link)
        rng = random.Random(SEED)  # noqa: S311 - a test's seed
        disk = Disk.of(output)
        self.old = folder_of(dict(disk.states(rng))["nothing lost"], self.link)
        traced(command, folder, folder / "notes")
        real = dict(Disk.of(output).states(rng))["nothing lost"]
        self.new = folder_of(real, self.link)
        assert self.old is not None
        assert self.new is not None
        assert self.new != self.old
        self.met: Counter[str] = Counter()
        self.calls = 0
        self.different: dict[str, State] = {}
        replay = Replay(disk, folder)
        for call in calls_in(folder / "notes"):
            if replay.changes(call):
                self.calls += 1
                for lost, state in disk.states(rng):
                    self._look(call, lost, state)
        # The model is right: nothing was written that it has not seen.
        modelled = dict(disk.states(rng))
        assert modelled["nothing lost"] == real
        # Once a program has reported that it published something, that stays published.
        for lost, state in modelled.items():
            assert folder_of(state, self.link) == self.new, lost

    def _look(self, call: Call, lost: str, state: State) -> None:
        """Check that what is published is whole, the old or the new."""
        published = folder_of(state, self.link)
        assert published in (self.old, self.new), (call, lost, _difference(published, self.new))
        self.met["old" if published == self.old else "new"] += 1
        self.different[digest(state)] = state

    @property
    def summary(self) -> str:
        """What was tried."""
        states = sum(self.met.values())
        return f"{self.calls} calls, {states} states, {len(self.different)} different, {self.met}"

    def start_again(self, again: Callable[[], None]) -> int:
        """Start the program on some of the states; return their number."""
        rng = random.Random(SEED)  # noqa: S311 - a test's seed
        chosen = rng.sample(sorted(self.different), min(STARTS, len(self.different)))
        for number, key in enumerate(chosen):
            write_state(self.different[key], self.output)
            print(f"start {number + 1} of {len(chosen)}", flush=True)  # noqa: T201 - it takes long
            again()
        return len(chosen)


def _difference(published: State | None, new: State | None) -> object:
    """Say how what is published differs from what is to be."""
    if published is None or new is None:
        return "nothing is published"
    return [name for name in {*published, *new} if published.get(name) != new.get(name)]
