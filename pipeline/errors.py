"""The kinds of error that end a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


class PipelineError(Exception):
    """An expected error, whose text is written for the user."""

    exit_code = 1


class RequestError(PipelineError):
    """The request is wrong: exit code 2, nothing is written.

    Parameters
    ----------
    faults
        One line each: the value, the limit and the remedy.
    """

    exit_code = 2

    def __init__(self, faults: Sequence[str]) -> None:
        self.faults = tuple(" ".join(fault.split()) for fault in faults)
        super().__init__("\n".join(self.faults))

    def __reduce__(self) -> tuple[type[RequestError], tuple[tuple[str, ...]]]:
        """Keep the faults when the error is pickled by a worker process."""
        return type(self), (self.faults,)


class NoWayError(RequestError):
    """No season has a way from start to goal in the region: there may be one in a wider region."""


class StageError(PipelineError):
    """A stage failed though the request is valid: exit code 1, finished stages are kept."""
