"""Which planner runs where, and with which seeds: the design of the experiments."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from experiments.baselines.registry import PLANNERS, Planner
from experiments.environments.model import EnvironmentSpec
from experiments.jobs import Job

Part = Literal["main", "equal-padding", "k-sweep", "ablation", "eddies"]

SWEEP = (1, 2, 4, 8, 16, 32)
"""Numbers of classes k of the sweep."""
ORDERS = ("depth-first", "length", "fuel")
"""Orders of classes of the sweep; depth-first is the paper's."""
QUICK = ("single-gyre", "four-gyre")
"""Environments of a quick run."""

TIMED = "four-gyre"
"""Environment in which anytime planners also run with smaller budgets, for fuel against time."""

# Share of an anytime planner's budget in a quick run.
_QUICK_SHARE = 0.1
# Smaller shares of its budget with which it also runs in a full run.
_SHARES = (0.03, 0.1, 0.3)


@dataclass(frozen=True)
class Design:
    """The environments of a run, and whether it is a quick one: one seed, small budgets."""

    specs: Sequence[EnvironmentSpec]
    is_quick: bool

    def ours(self) -> Iterator[Job]:
        """Our own plans; other jobs need their padding."""
        for spec in self.specs:
            for case in spec.cases:
                yield Job(spec.name, case.name, "RENEW")

    def theirs(self) -> Iterator[Job]:
        """All other jobs, the longest first."""
        for planner in PLANNERS.values():
            if planner.group == "fuel":
                yield from self._rivals(planner)
        for planner in reversed(PLANNERS.values()):
            if planner.group == "paper" or (planner.group == "ours" and planner.name != "RENEW"):
                yield from self._paper(planner)
        yield from self._sweep()

    def _rivals(self, planner: Planner) -> Iterator[Job]:
        """A rival with fuel as its objective: every case, with our padding."""
        for spec in self.specs:
            if spec.baselines == ():
                continue
            runs = 1 if self.is_quick else min(planner.runs, spec.runs)
            calls = int(planner.calls * _QUICK_SHARE) if self.is_quick else planner.calls
            budgets = [calls]
            if calls and spec.name == TIMED and not self.is_quick:
                budgets += [int(calls * share) for share in _SHARES]
            for case in spec.cases:
                for budget, seed in itertools.product(budgets, range(runs)):
                    options = (("calls", budget),) if calls else ()
                    yield Job(spec.name, case.name, planner.name, seed, "padded", options)

    def _paper(self, planner: Planner) -> Iterator[Job]:
        """One of the paper's methods: the first case of each environment, or all if it is ours.

        Unpadded, as in the paper.
        """
        for spec in self.specs:
            is_ours = planner.group == "ours"
            if not is_ours and spec.baselines is not None and planner.name not in spec.baselines:
                continue
            runs = 1 if self.is_quick else min(planner.runs, spec.runs)
            # The baselines know no padding: what differs between cases is the current.
            every = is_ours or spec.baselines is not None
            for case in spec.cases if every else spec.cases[:1]:
                yield from (Job(spec.name, case.name, planner.name, seed) for seed in range(runs))

    def _sweep(self) -> Iterator[Job]:
        """K classes in each order, in the first case of an environment that is swept."""
        for spec in self.specs:
            if not spec.is_swept:
                continue
            case = spec.cases[0].name
            for order in ORDERS:
                for k in SWEEP if not self.is_quick else (1, 16):
                    yield Job(spec.name, case, "RENEW", options=(("classes", k), ("order", order)))
