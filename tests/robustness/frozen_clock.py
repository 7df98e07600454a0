"""The command line under a clock that stands still: two runs of a scenario write the same bytes."""

import contextlib
from collections.abc import Iterator
from datetime import UTC, datetime
from types import SimpleNamespace
from unittest.mock import patch

import pipeline.run
import pipeline.stages.compare
import pipeline.stages.plan_case

_NOW = datetime(2026, 1, 1, tzinfo=UTC)


@contextlib.contextmanager
def frozen_clock() -> Iterator[None]:
    """Stop the clocks whose readings are written to results: the date, and the stages' times."""
    timer = SimpleNamespace(perf_counter=lambda: 0.0)
    date = SimpleNamespace(now=_NOW.astimezone)
    with (
        patch.object(pipeline.stages.compare, "datetime", date),
        patch.object(pipeline.run, "time", timer),
        patch.object(pipeline.stages.plan_case, "time", timer),
    ):
        yield


if __name__ == "__main__":
    from pipeline.cli.main import main

    with frozen_clock():
        main()
