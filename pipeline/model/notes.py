"""Notes: what a reader should know beside the result, as values without words."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

from pipeline.geo.position import position_text


@dataclass(frozen=True, slots=True)
class Place:
    """A place in degrees, or in a plane's metres."""

    x: float
    y: float
    is_planar: bool = False

    @property
    def text(self) -> str:
        """The place for a reader."""
        return (
            f"({self.x:.6g}, {self.y:.6g}) m" if self.is_planar else position_text(self.x, self.y)
        )


@dataclass(frozen=True, slots=True)
class Note:
    """Something that a reader should know; `pipeline.formats.shared.note_words` puts it in words.

    Attributes
    ----------
    kind : what it is about, one of the kinds for which there are words.
    values : the figures by their names: numbers, names, places, dates, other notes, tuples of them;
        units are in the names.
    seasons : the seasons that it is about; empty where it is about all.
    """

    kind: str
    values: tuple[tuple[str, object], ...] = ()
    seasons: tuple[str, ...] = ()

    @classmethod
    def of(cls, kind: str, **values: object) -> Note:
        """Return a note with its values."""
        return cls(kind, tuple(values.items()))

    def about(self, *seasons: str) -> Note:
        """Return the note about some seasons."""
        return replace(self, seasons=seasons)


Say = Callable[[Note], None]
"""Reports a note while a stage is at work."""


def of_seasons(notes: Mapping[str, Iterable[Note]]) -> tuple[Note, ...]:
    """Return notes by season as each note once, about all its seasons."""
    seasons: dict[Note, list[str]] = {}
    for season, own in notes.items():
        for note in dict.fromkeys(own):
            seasons.setdefault(note, []).append(season)
    return tuple(note.about(*names) for note, names in seasons.items())
