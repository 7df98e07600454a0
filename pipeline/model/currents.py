"""Currents on their grids, and the notes on them."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from pipeline._types import FloatArray
from pipeline.geo.known_cells import KnownCells
from pipeline.model.land import Credit, Land
from pipeline.model.notes import Note, of_seasons


@dataclass(frozen=True, slots=True)
class PassedOver:
    """A source of currents that was preferred but could not be used, and why, in one line."""

    source: str
    reason: str


@dataclass(frozen=True, slots=True)
class CurrentGrid:
    """A season's surface current on a lon/lat grid, at one or several times.

    Attributes
    ----------
    lon, lat : (nx,) and (ny,), ascending, degrees.
    u, v : (nt, ny, nx), m/s to east and to north; NaN where the source has no water, which is the
        same at all times.
    times_s : (nt,), ascending, seconds since the season's departure; of a steady current one.
    valid : the time that the field is valid for, as the source names it.
    notes : what a reader should know about the field.
    files : names and hashes of the files it came from.
    climatology_for : the season's own time where the field is a climatology in its place, or "".
    passed_over : the sources that the scenario prefers to this one, in its order.
    """

    season: str
    lon: FloatArray
    lat: FloatArray
    u: FloatArray
    v: FloatArray
    valid: str
    credit: Credit
    notes: tuple[Note, ...] = ()
    files: tuple[tuple[str, str], ...] = ()
    climatology_for: str = ""
    passed_over: tuple[PassedOver, ...] = ()
    times_s: FloatArray = field(default_factory=lambda: np.zeros(1))

    @property
    def cells(self) -> KnownCells:
        """Which of its cells have a figure."""
        return KnownCells(self.lon, self.lat, np.isfinite(self.u[0]) & np.isfinite(self.v[0]))

    @property
    def changes(self) -> bool:
        """Whether it changes during the voyage."""
        return len(self.times_s) > 1

    @property
    def change_notes(self) -> tuple[Note, ...]:
        """Say by how many time steps it changes; nothing of a steady one."""
        return (Note.of("current-changes", steps=len(self.times_s)),) if self.changes else ()

    @property
    def at_departure(self) -> tuple[FloatArray, FloatArray]:
        """The components (ny, nx) at departure, linear between the times around it."""
        if not self.changes:
            return self.u[0], self.v[0]
        after = int(np.clip(np.searchsorted(self.times_s, 0.0), 1, len(self.times_s) - 1))
        begin, end = self.times_s[after - 1 : after + 1]
        share = float(np.clip(-begin / (end - begin), 0.0, 1.0))
        u, v = ((1 - share) * part[after - 1] + share * part[after] for part in (self.u, self.v))
        return u, v

    @property
    def is_stand_in(self) -> bool:
        """Whether this is not the current that the scenario asks for first."""
        return bool(self.passed_over or self.climatology_for)

    @property
    def stand_in_notes(self) -> tuple[Note, ...]:
        """What the season was planned on in place of its first choice; empty where it is that."""
        source, valid, asked = self.credit.name, self.valid, self.climatology_for
        if asked:
            return (Note.of("climatology-stands-in", source=source, valid=valid, asked=asked),)
        used = Note.of("current-stands-in", source=source, valid=valid)
        return (used,) if self.passed_over else ()


@dataclass(frozen=True, slots=True)
class Fetched:
    """Data from the sources: land, and one current grid per season.

    `currents` is empty for a plane scenario, which gives its current as numbers. `notes` says
    which preferred sources were passed over and why, and what to know about the others.
    """

    land: Land
    currents: tuple[CurrentGrid, ...]
    notes: tuple[Note, ...] = ()

    @property
    def stand_in_notes(self) -> tuple[Note, ...]:
        """Those of the notes that only name what was used in place of a first choice."""
        return of_seasons({grid.season: grid.stand_in_notes for grid in self.currents})


def current_notes(currents: Iterable[CurrentGrid]) -> tuple[Note, ...]:
    """Notes on the currents of all seasons, and on the sources passed over for them."""
    return of_seasons(
        {
            grid.season: (
                *grid.change_notes,
                *grid.notes,
                *(
                    Note.of("source-passed-over", source=passed.source, reason=passed.reason)
                    for passed in grid.passed_over
                ),
                *grid.stand_in_notes,
            )
            for grid in currents
        }
    )
