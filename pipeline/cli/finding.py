"""A finding of `renew doctor`: one line for each thing that it checks."""

from dataclasses import dataclass
from typing import Literal

State = Literal["ok", "warning", "fault"]


@dataclass(frozen=True, slots=True)
class Finding:
    """The thing that was checked, its state, details, and the remedy if it is not in order."""

    state: State
    what: str
    detail: str
    remedy: str = ""

    def __str__(self) -> str:
        """One line."""
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{self.state:<8} {self.what}: {self.detail}{remedy}"
