"""The report's part on what is not known: sentences, shares of routes, straits that are shut."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipeline.formats.report.live_map.positions import place_on_map
from pipeline.formats.shared.note_words import note_texts
from pipeline.formats.shared.result import RunResult
from pipeline.formats.shared.text import capitalised, place
from pipeline.formats.shared.unknowns import MAX_STRAITS


@dataclass(frozen=True)
class RouteShares:
    """How much of a route is without figures of the current, and without charted depth."""

    season: str
    rank: int
    filled: float
    uncharted: float


@dataclass(frozen=True)
class Strait:
    """A strait that is shut: its place as text and for the map, widths in true metres, and why."""

    place: str
    on_map: str
    width_m: float
    needed_m: float
    by: str


@dataclass(frozen=True)
class Unknown:
    """The part's content; `more_straits` are not among those listed."""

    sentences: tuple[str, ...]
    routes: tuple[RouteShares, ...]
    straits: tuple[Strait, ...]
    more_straits: int

    @classmethod
    def of(cls, result: RunResult) -> Unknown:
        """Gather what is not known of a run, and those of its routes that lack figures."""
        rows = [
            RouteShares(
                result.season_title(row.season), row.rank, row.filled_share, row.uncharted_share
            )
            for row in result.evaluation.routes
            if not result.scenario.is_planar
        ]
        return cls(
            sentences=tuple(f"{capitalised(text)}." for text in note_texts(result.unknowns)),
            routes=tuple(row for row in rows if row.filled > 0 or row.uncharted > 0),
            straits=tuple(
                Strait(
                    place(one.lon, one.lat),
                    place_on_map(
                        result, result.scene.projection.to_plane(np.array([one.lon, one.lat]))
                    ),
                    one.width_m,
                    one.needed_m,
                    ", ".join((one.by, *map(result.season_title, one.seasons))),
                )
                for one in result.straits[:MAX_STRAITS]
            ),
            more_straits=max(0, len(result.straits) - MAX_STRAITS),
        )

    @property
    def has_depths(self) -> bool:
        """Whether the chart has depths, by the routes listed."""
        return any(not math.isnan(row.uncharted) for row in self.routes)
