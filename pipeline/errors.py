"""The two ways in which a run ends without its result."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


class PipelineError(Exception):
    """What this package raises on purpose; its text is for the reader, not for a debugger."""

    exit_code = 1


class RequestError(PipelineError):
    """The request is wrong: exit 2, nothing written.

    Parameters
    ----------
    faults
        One line each: the value, the limit, and what to change.
    """

    exit_code = 2

    def __init__(self, faults: Sequence[str]) -> None:
        self.faults = tuple(" ".join(fault.split()) for fault in faults)
        super().__init__("\n".join(self.faults))

    def __reduce__(self) -> tuple[type[RequestError], tuple[tuple[str, ...]]]:
        """Survive the way back from a worker process."""
        return type(self), (self.faults,)


class StageError(PipelineError):
    """A stage failed though the request is right: exit 1, what was done stays."""
