"""A haven: a place where a vessel can take refuge, from the user's list."""

import math
from dataclasses import dataclass

import numpy as np

from renew._types import FloatArray
from renew.errors import ParameterError, as_floats, is_number, shown


@dataclass(frozen=True, eq=False)
class Haven:
    """A place where a vessel can take refuge, by the user's word.

    Parameters
    ----------
    name : str
        Its name in messages and results.
    place : array_like
        Point (2,), m, in the chart's water and outside the soft no-go zone.
    opens, closes : float
        Times (s), on the clock of the current, from which and until which it can be entered. A
        vessel that comes earlier waits outside, and burns fuel at its thrust.

    Raises
    ------
    ParameterError
        A name without letters, a place that is no point, or hours that don't ascend.
    """

    name: str
    place: FloatArray
    opens: float = -math.inf
    closes: float = math.inf

    def __post_init__(self) -> None:
        """Refuse figures that no haven has; the error names all faults."""
        faults = []
        if not str(self.name).strip():
            faults.append("its name is empty")
        place = as_floats("place", self.place)
        if place.shape != (2,) or not np.isfinite(place).all():
            faults.append(f"place = {shown(self.place)} must be two finite numbers (m)")
        hours = (self.opens, self.closes)
        if not (all(map(is_number, hours)) and self.opens < self.closes):
            faults.append(
                f"opens = {shown(self.opens)} s must be a time before closes = "
                f"{shown(self.closes)} s"
            )
        if faults:
            raise ParameterError(f"haven {shown(self.name)}: " + "; ".join(faults))
        object.__setattr__(self, "place", place)
