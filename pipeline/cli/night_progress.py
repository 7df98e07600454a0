"""Report the progress of a night: one JSON object per line on standard error."""

import contextlib
import sys
import time
from collections.abc import Iterator

from pipeline.cli.json_lines import json_lines
from pipeline.nightly.outcome import NightEvent, NightEventHandler

# Minimum time between two lines on the progress of a stage, s.
_PROGRESS_S = 10.0


@contextlib.contextmanager
def night_progress() -> Iterator[NightEventHandler]:
    """Yield an event handler that logs to standard error."""
    log = json_lines(sys.stderr)
    said = 0.0

    def on_event(event: NightEvent) -> None:
        nonlocal said
        fields: dict[str, object] = {"stage": event.stage}
        if event.status == "working":
            if time.monotonic() - said < _PROGRESS_S and event.done < event.total:
                return
            said = time.monotonic()
            fields |= {"done": event.done, "total": event.total}
        if event.detail:
            fields["detail"] = event.detail
        if event.seconds:
            fields["seconds"] = round(event.seconds, 3)
        level = {"failed": log.error, "note": log.warning}.get(event.status, log.info)
        level(event.status, **fields)

    yield on_event
