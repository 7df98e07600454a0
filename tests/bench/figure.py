"""One figure: what was asked and what was reached."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Figure:
    """A measured figure beside the one asked for; `met` is None where nothing was asked.

    `values` are those that pages quote, by their names in docs/figures/SUITE.csv. `seconds` is
    what a time took: `--save` keeps it.
    """

    name: str
    asked: str
    reached: str
    met: bool | None = None
    values: dict[str, float] = field(default_factory=dict)
    seconds: float | None = None

    @property
    def verdict(self) -> str:
        """Return "met", "missed" or nothing."""
        return {True: "met", False: "missed", None: ""}[self.met]


_SECONDS = {" s": 1.0, " ms": 1e-3}


def at_most(
    name: str, value: float, limit: float, unit: str = "", digits: int = 2, key: str = ""
) -> Figure:
    """Figure that should not be above a limit; pages quote it by `key`, if that is given."""
    text = f"{value:.{digits}f}{unit}"
    values = {key: value} if key else {}
    seconds = value * _SECONDS[unit] if unit in _SECONDS else None
    return Figure(name, f"<= {limit:g}{unit}", text, value <= limit, values, seconds)


def quoted(name: str, **values: float) -> Figure:
    """Figures that pages quote and that nothing is asked of."""
    return Figure(name, "", ", ".join(f"{value:.6g}" for value in values.values()), None, values)
