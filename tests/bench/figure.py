"""One figure: what was asked and what was reached."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Figure:
    """A measured figure beside the one asked for; `met` is None where nothing was asked."""

    name: str
    asked: str
    reached: str
    met: bool | None = None

    @property
    def verdict(self) -> str:
        """Return "met", "missed" or nothing."""
        return {True: "met", False: "missed", None: ""}[self.met]


def at_most(name: str, value: float, limit: float, unit: str = "", digits: int = 2) -> Figure:
    """Figure that should not be above a limit."""
    text = f"{value:.{digits}f}{unit}"
    return Figure(name, f"<= {limit:g}{unit}", text, value <= limit)
