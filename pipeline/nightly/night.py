"""One night: plan all cases on the newest currents, and point `latest` at the results.

After an error, the link `latest` still points at the earlier cycle.
"""

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.errors import RequestError, StageError
from pipeline.machine.files import file_lock
from pipeline.machine.store import MAX_STORE_BYTES, Store, prune, remove_unfinished
from pipeline.nightly import outcome, records as results
from pipeline.nightly.cases import Cases, expand, pairs_on_land, request_hash
from pipeline.nightly.config import NightConfig
from pipeline.nightly.cycles import LATEST, Cycles, Partial, night_lock, writing
from pipeline.nightly.forecasts import Forecasts
from pipeline.nightly.newest_currents import Newest, base_of, newest_currents
from pipeline.nightly.outcome import NightEvent, NightEventHandler, NightOutcome, NightStage
from pipeline.nightly.voyages import VOYAGES_FILE, SailedVoyage, planned_again, write_voyages
from pipeline.texts import clean

if TYPE_CHECKING:
    from pipeline.nightly.planning import Planning

_ONLY = "only"
_HOUR_S = 3600.0


def run_night(
    config: NightConfig,
    *,
    only: str | None = None,
    scheduler: str | None = None,
    on_event: NightEventHandler | None = None,
) -> NightOutcome:
    """Plan a night's cases on the newest currents, and publish them as a cycle.

    Parameters
    ----------
    config
        The request.
    only
        A case's name, or its first parts: only matching cases are planned, in `OUTPUT/only/`.
    scheduler
        Address of a Dask scheduler whose workers have access to the same files; default:
        DASK_SCHEDULER_ADDRESS, or else processes of this machine.
    on_event
        Called with the events of every stage.

    Raises
    ------
    RequestError
        The request is wrong (exit code 2); nothing was written.
    BusyError
        Another job is running (exit code 4).
    ComeAgainError
        The currents are not available yet, or older than the last cycle's (exit code 5).
    StageError
        Nothing could be published (exit code 1); finished parts are kept for the next run.
    """
    return _Night(
        config,
        expand(config, only=only),
        only,
        scheduler,
        on_event or (lambda _: None),
    ).run()


@dataclass
class _Night:
    """One run of the nightly job."""

    config: NightConfig
    cases: Cases
    only: str | None
    scheduler: str | None
    handler: NightEventHandler
    started: datetime = field(default_factory=lambda: datetime.now(UTC))
    seconds: dict[str, float] = field(default_factory=dict)
    newest: Newest = field(init=False)
    cycles: Cycles = field(init=False)
    _look_back: results.LookBack = field(init=False)
    _revises: str = ""
    _current_stage: NightStage = "look"

    def __post_init__(self) -> None:
        """Choose the folder of cycles, and compute the deadline."""
        output = self.config.output
        if self.only is not None:
            output = output / _ONLY / self.only.strip("/").replace("/", "_")
        self.cycles = Cycles(output)
        self._deadline = time.monotonic() + self.config.spec.limit_hours * _HOUR_S

    def run(self) -> NightOutcome:
        """Plan and publish the cycle, unless it is published already."""
        with self._stage("look"):
            last_night = results.finished_at(self.cycles.folder(self.cycles.latest or LATEST))
            self.newest = newest_currents(self.cases, self.started, last_night)
            for reason in self.newest.ahead.values():
                self._note(reason)
            if (settled := self._settled()) is not None:
                return settled
            if faults := pairs_on_land(self.config, self.cases):
                raise RequestError(faults)
            self._note(f"{len(self.cases):,} cases on the currents of {self.newest.cycle}")
        with self._alone():
            if (settled := self._settled() or self._named()) is not None:
                return settled
            planning = self._planning()
            if results.faults_of(planning.partial.folder):
                self._plan(planning)
            return self._publish(planning)

    @cached_property
    def request(self) -> str:
        """Hash of the request; a cycle with another hash is planned again."""
        return request_hash(self.config, self.cases)

    # --- before there is anything to do ---

    def _settled(self) -> NightOutcome | None:
        """Return the outcome if this cycle is published already; else None.

        Raises
        ------
        ComeAgainError
            The currents are older than the last cycle's, or are stale and were used before.
        """
        latest, newest = self.cycles.latest, self.newest
        if base_of(latest) == base_of(newest.cycle):
            if not self.cycles.is_named(latest) or self._reason_to_revise(latest):
                return None
            stale = newest.stale_reason(self.started, self.config.spec.stale_hours)
            if newest.time is None and not newest.is_timeless:
                stale = "the currents have no date"
            if stale:
                raise outcome.ComeAgainError(
                    f"nothing new: the last night used these currents, of {latest}, and {stale}; "
                    "come again later, and check that newer currents are still published"
                )
            return self._outcome_of(latest, "nothing to do: the last night used these currents")
        if self.cycles.is_older(latest, newest.time):
            raise outcome.ComeAgainError(
                f"the currents of {newest.cycle} are older than those of the last cycle, {latest}; "
                f"come again later or, if {latest} is dated wrongly, move "
                f"{self.cycles.folder(latest)} away and run again"
            )
        return None

    def _reason_to_revise(self, cycle: str) -> str:
        """Return why a finished cycle on these currents must be planned again, or ""."""
        return results.reason_to_revise(self.cycles.folder(cycle), self.request, self.newest.digest)

    def _named(self) -> NightOutcome | None:
        """Publish this cycle if a killed job finished it without changing `latest`; else None."""
        for cycle in reversed(self.cycles.revisions(self.newest.cycle)):
            if not self._reason_to_revise(cycle):
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
                raise outcome.BusyError(
                    f"another program is cleaning {store}: wait until it has ended"
                )
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
        self._look_back = results.look_back(self.cycles)
        for note in self._look_back.notes:
            self._note(note)
        compared = self._look_back.cycle
        partial = Partial.opened(
            self.cycles.partial(self.newest.cycle),
            f"{own_identity()} {self.request} {self.newest.digest} {compared}",
        )
        earlier = {}
        if compared:
            cases_path = self.cycles.folder(compared) / results.CASES_FILE
            earlier = results.earlier_routes(compared, cases_path)
        return Planning(
            self.cases,
            self.newest,
            Store(self.cycles.output / ".artefacts", "nightly"),
            partial,
            earlier,
            self.config.spec.look_percent,
            self.newest.stale_reason(partial.started, self.config.spec.stale_hours),
            Forecasts(self.config.output),
            self._progress,
            self._check_time,
        )

    # --- the work ---

    def _plan(self, planning: "Planning") -> None:
        """Prepare charts and currents, and plan the cases that have no rows yet."""
        from pipeline.nightly.planning import night_workers

        if not planning.partial.missing(0, len(self.cases)):
            return
        with night_workers(
            self.scheduler,
            workers=self.config.spec.workers,
            memory_gb=self.config.spec.memory_gb,
            shared=planning.partial.request_file,
        ) as workers:
            with self._stage("prepare"):
                planning.forecasts.keep(self.cases, self.newest, prune=self.only is None)
                planning.prepare(workers)
            with self._stage("plan"):
                planning.plan(workers)

    def _publish(self, planning: "Planning") -> NightOutcome:
        """Write the cycle's files, check them, and point `latest` at them."""
        from pipeline.nightly.publishing import RESULTS, check_files, write_files

        partial = planning.partial
        if results.faults_of(partial.folder):
            with self._stage("publish"):
                voyages = self._voyages(partial.folder)
                warnings = tuple(one.sentence for one in voyages if one.outcome != outcome.SAME)
                notes = (*filter(None, [self._revises]), *warnings, *self._look_back.notes)
                counted = write_files(partial.folder, planning, self._look_back, notes)
            with self._stage("check"):
                check_files(partial.folder, len(self.cases))
            results.write_record(
                partial.folder,
                (*RESULTS, *([VOYAGES_FILE] if voyages else ())),
                {
                    "cycle": self.newest.cycle,
                    "revises": self._revises or None,
                    "reference_time": self.newest.time and self.newest.time.isoformat(),
                    "earlier_cycle": self._look_back.cycle or None,
                    "request": self.request,
                    "currents": self.newest.digest,
                    "cases": len(self.cases),
                    **counted,
                    "begun": partial.started.isoformat(timespec="seconds"),
                    "seconds_by_stage": {k: round(s, 3) for k, s in self.seconds.items()},
                },
                (*warnings, *self._look_back.notes),
            )
        partial.clear()
        self.cycles.publish(self.newest.cycle)
        self.cycles.prune(self.config.spec.keep)
        self._prune_store(planning.store)
        return self._outcome_of(self.newest.cycle, "", fresh=True)

    def _voyages(self, folder: Path) -> list[SailedVoyage]:
        """Plan the voyages again that are under way, and write their table."""
        found = list[SailedVoyage]()
        for spec in self.config.spec.voyages if self.only is None else ():
            self._check_time()
            found.append(planned_again(self.config, spec))
            self._note(found[-1].sentence)
        if found:
            write_voyages(found, folder / VOYAGES_FILE)
        return found

    def _prune_store(self, store: Store) -> None:
        """Prune the store if it is too large, except everything that this night used."""
        with contextlib.suppress(OSError):
            since = self.started.timestamp()
            prune(store.root, max_bytes=MAX_STORE_BYTES, keep_since=since)

    # --- outcome and events ---

    def _outcome_of(self, cycle: str, message: str, *, fresh: bool = False) -> NightOutcome:
        """Return the outcome in a finished cycle's record; exit code 0 unless it is `fresh`."""
        record = results.record_of(self.cycles.folder(cycle))
        counts = {name: int(record["cases_by_outcome"][name]) for name in outcome.OUTCOMES}
        code = int(record["exit_code"]) if fresh else outcome.DONE
        text = message or results.summary(record)
        return self._outcome(cycle, code, counts, text, fresh=fresh)

    def _outcome(
        self, cycle: str, code: int, counts: dict[str, int], message: str, *, fresh: bool
    ) -> NightOutcome:
        """Return the outcome of this run."""
        return NightOutcome(
            cycle,
            self.started,
            datetime.now(UTC),
            self.newest.time,
            code,
            counts,
            dict(self.seconds),
            fresh,
            message,
        )

    @contextlib.contextmanager
    def _stage(self, stage: NightStage) -> Iterator[None]:
        """Report the begin and end of a stage, and measure its time."""
        self._current_stage = stage
        begun = time.perf_counter()
        self._event(NightEvent(stage, "begun"))
        try:
            yield
        except Exception as error:
            self._event(NightEvent(stage, "failed", clean(str(error).replace("\n", "; "))))
            raise
        finally:
            self.seconds[stage] = time.perf_counter() - begun
        self._event(NightEvent(stage, "done", seconds=self.seconds[stage]))

    def _progress(self, done: int, total: int) -> None:
        """Report the progress of the current stage."""
        self._event(NightEvent(self._current_stage, "working", done=done, total=total))

    def _note(self, text: str) -> None:
        """Report a note."""
        self._event(NightEvent(self._current_stage, "note", text))

    def _event(self, event: NightEvent) -> None:
        """Report an event."""
        self.handler(event)

    def _check_time(self) -> None:
        """Raise StageError after the night's time limit."""
        if time.monotonic() > self._deadline:
            raise StageError(
                f"the limit of {self.config.spec.limit_hours:g} h is reached; nothing is "
                "published, and the parts that are done are kept: run again to continue"
            )
