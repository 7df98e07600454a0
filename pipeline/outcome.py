"""The events that a run reports, and its outcome."""

from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Literal, get_args

from pipeline.formats.shared.note_words import note_texts
from pipeline.formats.shared.result import RunResult
from pipeline.formats.shared.text import gap_figure, season_name, season_text
from pipeline.geo.earth import position_text
from pipeline.model import Evaluation, Fetched, Note, SeasonPlan
from pipeline.scenario.model import Scenario

Stage = Literal["fetch", "simplify", "project", "choose", "plan", "compare", "write"]
STAGES: tuple[Stage, ...] = get_args(Stage)
"""The stages that events report; a season is evaluated in the task that plans it."""


@dataclass(frozen=True, slots=True)
class Event:
    """The begin, a part, the end, the failure or a note of a stage, or of one season in it."""

    stage: Stage
    status: Literal["begun", "part", "done", "failed", "note"]
    season: str = ""
    seconds: float = 0.0
    detail: str = ""
    note: Note | None = None


EventHandler = Callable[[Event], None]


def ignore(event: Event) -> None:
    """Ignore an event."""
    del event


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of a run; `fresh` is False if its files existed already."""

    result: RunResult
    directory: Path
    fresh: bool
    seconds: float

    @property
    def scenario(self) -> Scenario:
        """The complete scenario, with all values that were chosen."""
        return self.result.scenario

    @property
    def plans(self) -> tuple[SeasonPlan, ...]:
        """The plans of all seasons, also of failed ones."""
        return self.result.plans

    @property
    def evaluation(self) -> Evaluation:
        """The measurements of the routes."""
        return self.result.evaluation

    @property
    def choices(self) -> tuple[str, ...]:
        """Sentences on the values that were chosen because the scenario leaves them out."""
        return tuple(note_texts(self.result.choices))

    @property
    def fetched(self) -> Fetched:
        """Land and currents, with all notes."""
        return self.result.fetched

    @property
    def failures(self) -> tuple[str, ...]:
        """One line for each failed season, and for each route that crosses the original land."""
        seasons = [f"{season_text(p.season)}: {p.failure}" for p in self.plans if p.failure]
        over_land = [
            f"{season_text(row.season)}: route {row.rank} crosses {row.land_m:.0f} m of the "
            f"original {row.no_go_name}, the most at {position_text(row.land_lon, row.land_lat)}; "
            "raise chart.margin_m"
            for row in self.evaluation.routes
            if row.land_m > 0
        ]
        return (*seasons, *over_land)

    @property
    def exit_code(self) -> int:
        """Exit code: 0 without failures, else 1."""
        return 1 if self.failures else 0

    def _repr_html_(self) -> str:
        """Return the routes as a table for a notebook."""
        no_go = self.fetched.land.no_go_name
        header = (
            "season",
            "rank",
            "way",
            "fuel",
            "km",
            f"clear of {no_go}, km",
            "gap",
            f"turns met {no_go}",
        )
        rows = [
            (
                season_name(row.season),
                str(row.rank),
                row.way,
                f"{row.fuel:.1f}",
                f"{row.length_m / 1000:.1f}",
                f"{row.clearance_m / 1000:.2f}",
                gap_figure(row.optimality_gap),
                f"{row.collisions} of {row.trials:,}",
            )
            for row in self.evaluation.routes
        ]
        heads = "".join(f"<th>{text}</th>" for text in header)
        cells = "".join(
            f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows
        )
        faults = "".join(f"<p>{escape(fault)}</p>" for fault in self.failures)
        return (
            f"<table><caption>{escape(self.scenario.title or self.scenario.name)}</caption>"
            f"<thead><tr>{heads}</tr></thead><tbody>{cells}</tbody></table>{faults}"
        )
