"""Areas of the user's that may not be entered: always, or for some hours."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from renew.errors import GeometryError, ParameterError, Text, from_until
from renew.inputs.figures import is_number, shown


@dataclass(frozen=True, eq=False)
class ShutArea:
    """An area that is shut from `begin` until `end` (s), on the clock of the current, or always.

    Parameters
    ----------
    polygon : Polygon or MultiPolygon
        The area (m).
    begin, end : float
        Times (s) from which and until which no vessel may be in it.
    name : str
        What messages call it.

    Raises
    ------
    GeometryError
        An area that is no valid polygon; says where and why.
    ParameterError
        An end that does not come after the beginning.
    """

    polygon: Polygon | MultiPolygon
    begin: float = -math.inf
    end: float = math.inf
    name: str = ""

    def __post_init__(self) -> None:
        """Refuse what is no area, and no time."""
        polygon = self.polygon
        if not isinstance(polygon, Polygon | MultiPolygon) or polygon.is_empty:
            raise GeometryError(f"area {self.name!r} must be a non-empty polygon, not {polygon!r}")
        if not np.isfinite(shapely.get_coordinates(polygon)).all():
            raise GeometryError(f"area {self.name!r} has coordinates that are not finite")
        if not polygon.is_valid:
            raise GeometryError(
                f"area {self.name!r} is not valid: {shapely.is_valid_reason(polygon)}. Mend with "
                "shapely.make_valid"
            )
        hours = self.begin, self.end
        if not (all(map(is_number, hours)) and self.begin < self.end):
            begin, end = map(shown, hours)
            raise ParameterError(
                f"area {self.name!r} is shut from {begin} until {end} s; the end must come after "
                "the beginning"
            )

    @property
    def is_always_shut(self) -> bool:
        """Whether it has no hours at which it is open."""
        return math.isinf(self.begin) and math.isinf(self.end)

    @property
    def text(self) -> Text:
        """The area with its hours, for a message."""
        name = Text(f"area {self.name!r}" if self.name else "an area")
        if self.is_always_shut:
            return Text("{0}, always shut", (name,))
        return Text("{0}, which is shut{1}", (name, from_until(self.begin, self.end)))


def polygons_of(areas: Sequence[ShutArea]) -> list[Polygon]:
    """The polygons of some areas."""
    return [
        part
        for area in areas
        for part in shapely.get_parts(area.polygon)
        if isinstance(part, Polygon)
    ]
