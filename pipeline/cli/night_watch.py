"""Tells a service (`--ping`) and a file of metrics how a night begins and ends."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

from pipeline.cli.failures import exit_code_of
from pipeline.nightly.outcome import BusyError, NightEvent, NightOutcome
from pipeline.nightly.ping import check_url, ping, told_by
from pipeline.nightly.prometheus import write_metrics

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from pipeline.nightly.outcome import NightEventHandler


def watched(
    night: Callable[[], NightOutcome],
    *,
    metrics: Path | None,
    url: str | None,
    on_event: NightEventHandler,
) -> NightOutcome:
    """Run a night; what goes wrong in telling of it is a note, and never fails it.

    Raises
    ------
    RequestError
        The address is none that can be asked.
    """
    if url:
        check_url(url)
        _note(ping(url, "start"), on_event)
    started = datetime.now(UTC)
    try:
        outcome = night()
    except BaseException as error:
        failed = NightOutcome("", started, datetime.now(UTC), None, exit_code_of(error), {}, {})
        _tell(failed, metrics, url, on_event)
        raise
    _tell(outcome, metrics, url, on_event)
    return outcome


def _tell(
    outcome: NightOutcome, metrics: Path | None, url: str | None, on_event: NightEventHandler
) -> None:
    """Tell how a night ended."""
    # The job that is at work writes the figures of its own night.
    if metrics is not None and outcome.exit_code != BusyError.exit_code:
        _note(write_metrics(metrics, outcome), on_event)
    if url and (what := told_by(outcome.exit_code)) is not None:
        _note(ping(url, what), on_event)


def _note(fault: str, on_event: NightEventHandler) -> None:
    """Report what went wrong, if anything did."""
    if fault:
        on_event(NightEvent("publish", "note", fault))
