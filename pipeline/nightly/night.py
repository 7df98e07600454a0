"""One night: plan all cases on the newest currents, and point `latest` at the results.

After an error, the link `latest` still points at the earlier cycle.
"""

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from typing import TYPE_CHECKING, Literal

from pipeline.errors import StageError, refuse_any
from pipeline.machine.files import file_lock
from pipeline.machine.store import MAX_STORE_BYTES, Store, prune, remove_unfinished
from pipeline.nightly import records
from pipeline.nightly.cases import Block, all_cases, expand, pairs_on_land, request_hash
from pipeline.nightly.config import NightConfig
from pipeline.nightly.currents import ComeAgainError, Newest, newest_currents
from pipeline.nightly.cycles import (
    LATEST,
    BusyError,
    Cycles,
    Partial,
    base_of,
    cycle_time,
    night_lock,
    writing,
)
from pipeline.texts import clean

if TYPE_CHECKING:
    from pipeline.nightly.planning import Planning

_ONLY = "only"
_HOUR_S = 3600.0
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


def run_night(
    config: NightConfig,
    *,
    only: str | None = None,
    scheduler: str | None = None,
    on_event: NightEventHandler | None = None,
) -> NightOutcome:
    """Plan a night's cases on the newest currents, and publish them as a cycle.

    Raises RequestError if the request is wrong (exit code 2); nothing was written; BusyError if
    another job is running (exit code 4); ComeAgainError if the currents are not available yet, or
    older than the last cycle's (exit code 5); StageError if nothing could be published (exit code
    1); finished parts are kept for the next run.

    With `only`, a case's name or its first parts, only matching cases are planned, in
    `OUTPUT/only/`. `scheduler` is the address of a Dask scheduler whose workers have access to the
    same files; default: DASK_SCHEDULER_ADDRESS, or else processes of this machine. `on_event` is
    called with the events of every stage.
    """
    return _Night(
        config, expand(config, only=only), only, scheduler, on_event or (lambda _: None)
    ).run()


@dataclass
class _Night:
    """One run of the nightly job."""

    config: NightConfig
    blocks: list[Block]
    only: str | None
    scheduler: str | None
    handler: NightEventHandler
    started: datetime = field(default_factory=lambda: datetime.now(UTC))
    seconds: dict[str, float] = field(default_factory=dict)
    newest: Newest = field(init=False)
    cycles: Cycles = field(init=False)
    _compared: str = ""
    _revises: str = ""
    _damage: list[str] = field(default_factory=list)
    _current_stage: NightStage = "look"

    def __post_init__(self) -> None:
        """List the cases, choose the folder of cycles, and compute the deadline."""
        self.cases = list(all_cases(self.blocks))
        output = self.config.output
        if self.only is not None:
            output = output / _ONLY / self.only.strip("/").replace("/", "_")
        self.cycles = Cycles(output)
        self._deadline = time.monotonic() + self.config.spec.limit_hours * _HOUR_S

    def run(self) -> NightOutcome:
        """Plan and publish the cycle, unless it is published already."""
        with self._stage("look"):
            last_night = records.finished_at(self.cycles.folder(self.cycles.latest or LATEST))
            self.newest = newest_currents(self.blocks, self.started, last_night)
            for reason in self.newest.ahead.values():
                self._note(reason)
            if (settled := self._settled()) is not None:
                return settled
            refuse_any(pairs_on_land(self.config, self.blocks))
            self._note(f"{len(self.cases):,} cases on the currents of {self.newest.cycle}")
        with self._alone():
            if (settled := self._settled() or self._named()) is not None:
                return settled
            planning = self._planning()
            if records.faults_of(planning.partial.folder):
                self._plan(planning)
            return self._publish(planning)

    @cached_property
    def request(self) -> str:
        """Hash of the request; a cycle with another hash is planned again."""
        return request_hash(self.config, self.blocks)

    # --- before there is anything to do ---

    def _settled(self) -> NightOutcome | None:
        """Return the outcome if this cycle is published already; else None.

        Raises ComeAgainError if the currents are older than the last cycle's, or are stale and were
        used before.
        """
        latest, newest = self.cycles.latest, self.newest
        if base_of(latest) == base_of(newest.cycle):
            if not self.cycles.is_named(latest) or self._reason_to_revise(latest):
                return None
            stale = newest.stale_reason(self.started, self.config.spec.stale_hours)
            if newest.time is None and not newest.is_timeless:
                stale = "the currents have no date"
            if stale:
                raise ComeAgainError(
                    f"nothing new: the last night used these currents, of {latest}, and {stale}; "
                    "come again later, and check that newer currents are still published"
                )
            return self._outcome_of(latest, "nothing to do: the last night used these currents")
        time_of_latest = cycle_time(latest)
        if time_of_latest and newest.time and newest.time < time_of_latest:
            raise ComeAgainError(
                f"the currents of {newest.cycle} are older than those of the last cycle, {latest}; "
                f"come again later or, if {latest} is dated wrongly, move "
                f"{self.cycles.folder(latest)} away and run again"
            )
        return None

    def _reason_to_revise(self, cycle: str) -> str:
        """Return why a finished cycle on these currents must be planned again, or ""."""
        return records.reason_to_revise(self.cycles.folder(cycle), self.request, self.newest.digest)

    def _named(self) -> NightOutcome | None:
        """Publish this cycle if a killed job finished it without changing `latest`; else None."""
        for cycle in reversed(self.cycles.finished()):
            is_on_these = base_of(cycle) == base_of(self.newest.cycle)
            if is_on_these and not self._reason_to_revise(cycle):
                self.cycles.point_at(cycle)
                self.cycles.prune(self.config.spec.keep)
                return self._outcome_of(cycle, "", fresh=True)
        return None

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """Hold the locks of the output folder and its store, and remove leftovers."""
        output = self.cycles.output
        with writing(output):
            output.mkdir(parents=True, exist_ok=True)
        store = output / ".artefacts"
        with night_lock(output), contextlib.ExitStack() as held:
            with writing(store):
                shares = held.enter_context(
                    file_lock(store / "store.lock", shared=True, wait_s=60.0)
                )
            if not shares:
                raise BusyError(f"another program is cleaning {store}: wait until it has ended")
            self.cycles.remove_leftovers()
            remove_unfinished(store, "nightly")
            yield

    def _planning(self) -> "Planning":
        """Open the cycle's folder, and return the planning of its cases."""
        from pipeline.machine.cluster import own_identity
        from pipeline.nightly.planning import Planning

        latest = self.cycles.latest
        if base_of(latest) == self.newest.cycle:
            self._revises = self._reason_to_revise(latest)
            self._note(f"planned anew: {self._revises}")
        self.newest = replace(self.newest, cycle=self.cycles.free_name(self.newest.cycle))
        self._compared, self._damage = records.readable_cycle(self.cycles)
        for note in self._damage:
            self._note(note)
        partial = Partial.opened(
            self.cycles.partial(self.newest.cycle),
            f"{own_identity()} {self.request} {self.newest.digest} {self._compared}",
        )
        earlier = {}
        if self._compared:
            cases_path = self.cycles.folder(self._compared) / records.CASES_FILE
            earlier = records.earlier_routes(self._compared, cases_path)
        return Planning(
            self.cases,
            self.newest,
            Store(self.cycles.output / ".artefacts", "nightly"),
            partial,
            earlier,
            self.config.spec.look_percent,
            self.newest.stale_reason(partial.started, self.config.spec.stale_hours),
            self.config.output,
            self._progress,
            self._check_time,
        )

    # --- the work ---

    def _plan(self, planning: "Planning") -> None:
        """Prepare charts and currents, and plan the cases that have no rows yet."""
        from pipeline.nightly.planning import night_workers

        if len(planning.partial.rows) == len(self.cases):
            return
        with night_workers(
            self.scheduler,
            workers=self.config.spec.workers,
            memory_gb=self.config.spec.memory_gb,
            shared=planning.partial.request_file,
        ) as workers:
            with self._stage("prepare"):
                planning.prepare(workers)
            with self._stage("plan"):
                planning.plan(workers)

    def _publish(self, planning: "Planning") -> NightOutcome:
        """Write the cycle's files, check them, and point `latest` at them."""
        from pipeline.nightly.publishing import RESULTS, check_files, write_files

        partial = planning.partial
        if records.faults_of(partial.folder):
            history = None
            if self._compared:
                history = self.cycles.folder(self._compared) / records.HISTORY_FILE
            with self._stage("publish"):
                notes = [*filter(None, [self._revises]), *self._damage]
                counted = write_files(partial.folder, planning, history, notes)
            with self._stage("check"):
                check_files(partial.folder, len(self.cases))
            records.write_record(
                partial.folder,
                RESULTS,
                {
                    "cycle": self.newest.cycle,
                    "revises": self._revises or None,
                    "reference_time": self.newest.time and self.newest.time.isoformat(),
                    "earlier_cycle": self._compared or None,
                    "request": self.request,
                    "currents": self.newest.digest,
                    "cases": len(self.cases),
                    **counted,
                    "begun": partial.started.isoformat(timespec="seconds"),
                    "seconds_by_stage": {k: round(s, 3) for k, s in self.seconds.items()},
                },
                self._damage,
            )
        partial.clear()
        self.cycles.publish(self.newest.cycle)
        self.cycles.prune(self.config.spec.keep)
        with contextlib.suppress(OSError):
            # Everything that this night used stays.
            since = self.started.timestamp()
            prune(planning.store.root, max_bytes=MAX_STORE_BYTES, keep_since=since)
        return self._outcome_of(self.newest.cycle, "", fresh=True)

    # --- outcome and events ---

    def _outcome_of(self, cycle: str, message: str, *, fresh: bool = False) -> NightOutcome:
        """Return the outcome in a finished cycle's record; exit code 0 unless it is `fresh`."""
        record = records.record_of(self.cycles.folder(cycle))
        return NightOutcome(
            cycle,
            self.started,
            datetime.now(UTC),
            self.newest.time,
            int(record["exit_code"]) if fresh else records.DONE,
            {name: int(record["cases_by_outcome"][name]) for name in records.OUTCOMES},
            dict(self.seconds),
            fresh,
            message or records.summary(record),
        )

    @contextlib.contextmanager
    def _stage(self, stage: NightStage) -> Iterator[None]:
        """Report the begin and end of a stage, and measure its time."""
        self._current_stage = stage
        begun = time.perf_counter()
        self.handler(NightEvent(stage, "begun"))
        try:
            yield
        except Exception as error:
            self.handler(NightEvent(stage, "failed", clean(str(error).replace("\n", "; "))))
            raise
        finally:
            self.seconds[stage] = time.perf_counter() - begun
        self.handler(NightEvent(stage, "done", seconds=self.seconds[stage]))

    def _progress(self, done: int, total: int) -> None:
        self.handler(NightEvent(self._current_stage, "working", done=done, total=total))

    def _note(self, text: str) -> None:
        self.handler(NightEvent(self._current_stage, "note", text))

    def _check_time(self) -> None:
        """Raise StageError after the night's time limit."""
        if time.monotonic() > self._deadline:
            raise StageError(
                f"the limit of {self.config.spec.limit_hours:g} h is reached; nothing is "
                "published, and the parts that are done are kept: run again to continue"
            )
