"""Report the start and end of a night to a service (`--ping`), and the end to a metrics file."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from pipeline.cli.failures import exit_code_of
from pipeline.cli.interruption import saying_last
from pipeline.nightly.outcome import BusyError, NightEvent, NightEventHandler, NightOutcome
from pipeline.nightly.ping import check_url, ping, report_for
from pipeline.nightly.prometheus import write_metrics


def watched(
    night: Callable[[], NightOutcome],
    *,
    metrics: Path | None,
    url: str | None,
    on_event: NightEventHandler,
) -> NightOutcome:
    """Run a night and report it; a report that fails gives only a note.

    Raises
    ------
    RequestError
        The address is not valid.
    """
    if url:
        check_url(url)
        _note(ping(url, "start"), on_event)
    started = datetime.now(UTC)
    teller = _Teller(metrics, url, on_event)

    def tell_failure(exit_code: int) -> None:
        teller.tell(NightOutcome("", started, datetime.now(UTC), None, exit_code, {}, {}))

    with saying_last(tell_failure):
        try:
            outcome = night()
        except BaseException as error:
            tell_failure(exit_code_of(error))
            raise
        teller.tell(outcome)
    return outcome


@dataclass(frozen=True)
class _Teller:
    """Reports the end of a night exactly once, even if a signal arrives meanwhile."""

    metrics: Path | None
    url: str | None
    on_event: NightEventHandler
    _told: list[NightOutcome] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def tell(self, outcome: NightOutcome) -> None:
        """Report how the night ended, unless it was reported before."""
        with self._lock:
            if self._told:
                return
            # If another job was running, that job writes the metrics.
            if self.metrics is not None and outcome.exit_code != BusyError.exit_code:
                _note(write_metrics(self.metrics, outcome), self.on_event)
            if self.url and (what := report_for(outcome.exit_code)) is not None:
                _note(ping(self.url, what), self.on_event)
            self._told.append(outcome)


def _note(fault: str, on_event: NightEventHandler) -> None:
    """Report a fault as an event, unless it is ""."""
    if fault:
        on_event(NightEvent("publish", "note", fault))
