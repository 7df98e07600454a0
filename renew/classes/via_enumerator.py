"""The k best classes of a voyage through via points: combinations of the classes of its parts.

A part begins when the one before it ends. An earlier arrival at a via point means no later arrival
at the next one (FIFO), so the best way to each via point is a part of the best way of all, and the
k best combinations are found part by part: of two lists in ascending order the i-th with the j-th
can be among the k least sums only where i x j <= k, counted from 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

from renew._types import FloatArray
from renew.classes.channel import Channel, Transition
from renew.classes.class_enumerator import ClassEnumerator
from renew.classes.h_signature import Rays
from renew.voyage.voyage import Voyage

_Looking: TypeAlias = Callable[[int, ClassEnumerator], list[Channel]]


@dataclass(frozen=True, eq=False)
class ViaEnumerator:
    """Gives channels from start to goal through the via points, no two of the same class.

    `parts` are the enumerators of the parts of the voyage.
    """

    voyage: Voyage
    parts: tuple[ClassEnumerator, ...]

    @property
    def sees_all(self) -> bool:
        """As of :class:`ClassEnumerator`."""
        return all(part.sees_all for part in self.parts)

    @property
    def has_many_triangles(self) -> bool:
        """As of :class:`ClassEnumerator`."""
        return any(part.has_many_triangles for part in self.parts)

    def by_rays(self, rays: Rays) -> ViaEnumerator:
        """Return the enumerator of the classes that other rays tell apart."""
        return replace(self, parts=tuple(part.by_rays(rays) for part in self.parts))

    def up_to(self, dearest: float) -> ViaEnumerator:
        """As of :class:`ClassEnumerator`, in each part."""
        return replace(self, parts=tuple(part.up_to(dearest) for part in self.parts))

    def leaving(self, voyage: Voyage) -> ViaEnumerator:
        """Return the enumerator of a voyage with another departure."""
        return replace(self, voyage=voyage)

    def channels(self, count: int, blocked: Collection[Transition] = ()) -> list[Channel]:
        """The first `count` channels, except those that make a blocked transition."""
        return self._combined(count, lambda _, part: part.channels(count, blocked))

    def channels_beside(self, paths: Sequence[FloatArray], count: int) -> list[Channel]:
        """The first `count` channels of paths beside some (n, 2), looked at closer."""
        pieces = [self.voyage.cut(path) for path in paths]
        return self._combined(
            count, lambda at, part: part.channels_beside([one[at] for one in pieces], count)
        )

    def _combined(self, count: int, look: _Looking) -> list[Channel]:
        """The `count` best combinations; each part departs at the earliest arrival before it."""
        combined: list[tuple[float, tuple[Channel, ...]]] = [(0.0, ())]
        for at, part in enumerate(self.parts):
            earliest = combined[0][0]
            # Where no way can be made the clock stops.
            begin = self.voyage.departure + (earliest if math.isfinite(earliest) else 0.0)
            voyage = self.voyage.part(at, begin)
            found = [
                (voyage.duration(channel.found_by.points), channel)
                for channel in look(at, part.leaving(voyage))
                if channel.found_by is not None
            ]
            found.sort(key=lambda one: one[0])
            pairs = [
                (before + time, (*parts, channel))
                for i, (before, parts) in enumerate(combined)
                for time, channel in found[: count // (i + 1)]
            ]
            if not pairs:
                return []
            combined = sorted(pairs, key=lambda one: one[0])[:count]
        return [Channel.joined(parts, self.voyage.via) for _, parts in combined]
