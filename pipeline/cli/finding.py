"""A finding of `renew doctor`: the result of one check."""

from dataclasses import dataclass
from typing import Literal

State = Literal["ok", "warning", "fault"]


@dataclass(frozen=True, slots=True)
class Finding:
    """The checked item `what`, its state, details, and a remedy for a warning or a fault."""

    state: State
    what: str
    detail: str
    remedy: str = ""

    def __str__(self) -> str:
        """Return the finding as one line."""
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{self.state:<8} {self.what}: {self.detail}{remedy}"
