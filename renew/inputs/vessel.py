"""The vessel: its speed, rate of turn, length and fuel law."""

import math
from dataclasses import dataclass

from renew.errors import ParameterError, is_number, shown

MAX_SPEED = 1e6
"""Highest speed through water (m/s); a higher one is taken for a typing error."""

# Largest figures (m/s, rad/s, m, ...); larger ones are typing errors, and their powers overflow.
_LIMITS = {
    "speed": MAX_SPEED,
    "turn_rate": 1e6,
    "length": 1e6,
    "fuel_coefficient": 1e12,
    "fuel_exponent": 20.0,
}


@dataclass(frozen=True, slots=True)
class Vessel:
    """A vessel at constant thrust.

    Parameters
    ----------
    speed : float
        Speed through water, v (m/s).
    turn_rate : float
        Turn rate with the rudder hard over, ω (rad/s).
    length : float
        Length overall (m).
    fuel_coefficient, fuel_exponent : float
        Fuel law: fuel a second is α vᵏ (paper, Eq. 4; α = 1 and k = 2 there).

    Raises
    ------
    ParameterError
        A figure that is not positive, or larger than any vessel's.
    """

    speed: float
    turn_rate: float
    length: float = 2.0
    fuel_coefficient: float = 1.0
    fuel_exponent: float = 2.0

    def __post_init__(self) -> None:
        """Refuse figures that no vessel has; the error names all faults."""
        faults = [
            f"{name} = {shown(value)} must be a number above 0 and at most {most:g}"
            for name, most in _LIMITS.items()
            if not (is_number(value := getattr(self, name)) and 0 < value <= most)
        ]
        if faults:
            raise ParameterError("vessel: " + "; ".join(faults))
        # As floats, because every kernel would be compiled again for ints.
        for name in _LIMITS:
            object.__setattr__(self, name, float(getattr(self, name)))

    @property
    def turning_radius(self) -> float:
        """Radius of a hard-over turn in still water, v/ω (m)."""
        return self.speed / self.turn_rate

    @property
    def turn_period(self) -> float:
        """Time of one full hard-over turn, 2π/ω (s)."""
        return 2 * math.pi / self.turn_rate

    @property
    def fuel_rate(self) -> float:
        """Fuel a second at constant thrust, α vᵏ (fuel units per second)."""
        return float(self.fuel_coefficient * self.speed**self.fuel_exponent)
