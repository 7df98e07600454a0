"""The tide: heights over chart datum from the harmonic constants of a station.

z(t) = Z0 + Σ f A cos(V + u − g) by Schureman (1940), Manual of Harmonic Analysis and Prediction of
Tides, Special Publication 98. The sum, its arguments V + u and its nodal factors f are predicted by
pyfes (CNES), the extra `tides`.
"""

import cmath
import datetime as dt
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from renew._types import BoolArray, FloatArray
from renew.errors import ParameterError, as_floats, is_number, shown

if TYPE_CHECKING:
    from pyfes.core import WaveTableInterface

Instants: TypeAlias = npt.NDArray[np.datetime64]

# NOAA's names of constituents that pyfes spells otherwise.
_SPELLED = {"LAM2": "LAMBDA2", "RHO": "RHO1"}
# Schureman's argument minus that of pyfes, degrees. His T is the hour angle of the mean sun, 180°
# at midnight, and M3 contains 3 T. With this, predictions meet the extreme tides that NOAA
# publishes.
_TURNED = {"M3": 180.0}
# Larger figures are typing errors: heights (m) and ratios; times (s); a constituent's m and
# degrees.
_LIMITS = {"mean_level": (-1e3, 1e3), "ratio": (0.0, 1e3), "offset": (-86400.0, 86400.0)}
_MOST = 1e6
# Largest time from the epoch, s: three centuries, beyond which the arguments' series err.
_MOST_TIME = 1e10
# Time step of predicted heights, s. Linear interpolation errs by (ω 60 s)² A / 8: 0.1 mm for an M2
# of 9 m.
_STEP = 60.0
# Length of a block of heights that is kept, s.
_BLOCK = 86400.0
# The nodal factors follow the moon's node and perigee (18.6 and 8.85 years): ten turns of one and
# 21 of the other give all their combinations. The factors are sampled every 20 days; between
# samples they rise by less than the margin below.
_NODAL_DATES = ("1900-01-01", "2087-01-01", 20)
_NODAL_MARGIN = 1.001


class Constant(NamedTuple):
    """A constituent's amplitude (m), and phase lag on Greenwich's equilibrium tide (degrees)."""

    amplitude: float
    phase: float


class HighAndLow(NamedTuple):
    """High and low waters: `times` (n,), s; `heights` (n,), m over datum; `is_high` (n,)."""

    times: FloatArray
    heights: FloatArray
    is_high: BoolArray


@dataclass(frozen=True, eq=False)
class Tide:
    """Heights of the tide over chart datum, from harmonic constants.

    Parameters
    ----------
    constants : mapping
        Amplitude (m) and phase lag (degrees at Greenwich, Schureman's arguments, as NOAA gives
        them) by name: "M2", "S2", ... A tide without constants stands at its mean level.
    mean_level : float
        Z0: mean sea level over chart datum (m).
    epoch : datetime or numpy.datetime64
        Instant (UTC) at which the planner's clock is 0. One without a time zone is UTC.
    name, datum : str, optional
        Station, and its chart datum: "MLLW", "LAT".
    ratio, offset : float, optional
        Height ratio, and time offset (s; positive is later), of a place that follows the station:
        its height at t is ratio · z(t − offset).

    Raises
    ------
    ParameterError
        Figures that are not finite, a negative amplitude or ratio, or names that pyfes doesn't
        know; all faults at once. Or pyfes is not installed.
    """

    constants: Mapping[str, Constant]
    mean_level: float
    epoch: dt.datetime | np.datetime64
    name: str = ""
    datum: str = ""
    ratio: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        """Check the figures and names; keep plain copies of them."""
        given: object = self.constants
        if not isinstance(given, Mapping):
            raise ParameterError(f"tide: constants = {shown(given)} must be a mapping")
        faults = [
            f"{name} = {shown(value)} must be a number from {least:g} to {most:g}"
            for name, (least, most) in _LIMITS.items()
            if not (is_number(value := getattr(self, name)) and least <= value <= most)
        ]
        faults += [
            f"{name} = {shown(pair)} must be an amplitude (m) not below 0, and a phase (degrees)"
            for name, pair in given.items()
            if not (isinstance(name, str) and isinstance(pair, tuple | list) and len(pair) == 2)
            or not all(map(is_number, pair))
            or not (0 <= pair[0] <= _MOST and abs(pair[1]) <= _MOST)
        ]
        faults += _name_faults(given)
        if faults:
            of = f" of {self.name}" if self.name else ""
            raise ParameterError(f"tide{of}: " + "; ".join(faults))
        constants = {name: Constant(*map(float, constant)) for name, constant in given.items()}
        object.__setattr__(self, "constants", constants)
        object.__setattr__(self, "epoch", _instant(self.epoch))

    def __reduce__(self) -> tuple[type["Tide"], tuple[object, ...]]:
        """Pickle the parameters only; predictions are quickly computed again."""
        return type(self), tuple(getattr(self, field.name) for field in fields(self))

    def heights(self, times: FloatArray) -> FloatArray:
        """Heights over datum (m) at times (s on the planner's clock), of the same shape."""
        times = _finite_times(times)
        if not self._moving:
            return np.full(times.shape, self.ratio * self.mean_level)
        block = np.floor(times / _BLOCK)
        heights = np.empty(times.shape)
        for number in np.unique(block):
            within = block == number
            heights[within] = np.interp(times[within], *self._kept(float(number)))
        return heights

    def high_and_low(self, begin: float, end: float) -> HighAndLow:
        """High and low waters between two times (s), to the second, in their order."""
        for time in (begin, end):
            if not is_number(time):
                raise ParameterError(f"tide: {shown(time)} must be a time, s")
        begin, end = _finite_times([begin, end]).tolist()
        if not self._moving or begin >= end:
            none = np.empty(0)
            return HighAndLow(none, none, np.empty(0, dtype=bool))
        times, heights = self._table(begin, end)
        rising = np.diff(heights) > 0
        turn = 1 + np.flatnonzero(rising[1:] != rising[:-1])
        # The parabola through the three heights around a high or low.
        slope = (heights[turn + 1] - heights[turn - 1]) / 2
        bend = heights[turn + 1] - 2 * heights[turn] + heights[turn - 1]
        when, high = times[turn] - _STEP * slope / bend, heights[turn] - slope**2 / (2 * bend)
        within = (when >= begin) & (when <= end)
        return HighAndLow(when[within], high[within], bend[within] < 0)

    @property
    def highest(self) -> float:
        """Height (m) that no prediction exceeds: Z0 plus the largest f A of each constituent."""
        return self.ratio * (self.mean_level + self._reach)

    @property
    def lowest(self) -> float:
        """Height (m) below which no prediction falls: Z0 minus the largest f A of each."""
        return self.ratio * (self.mean_level - self._reach)

    @cached_property
    def _moving(self) -> dict[str, Constant]:
        """The constituents that have an amplitude, by pyfes's names and with its phases."""
        return {
            _known()[_upper(name)]: Constant(amplitude, phase + _TURNED.get(_upper(name), 0.0))
            for name, (amplitude, phase) in self.constants.items()
            if amplitude > 0
        }

    @cached_property
    def _reach(self) -> float:
        """Sum of the amplitudes (m), each times the largest nodal factor that it ever has."""
        if not self._moving:
            return 0.0
        first, last, step = _NODAL_DATES
        dates = np.arange(first, last, step, dtype="datetime64[D]")
        factors, _ = arguments(self._moving, dates)
        amplitudes = np.array([constant.amplitude for constant in self._moving.values()])
        return float(_NODAL_MARGIN * factors.max(axis=1) @ amplitudes)

    @cached_property
    def _kept(self) -> Callable[[float], tuple[FloatArray, FloatArray]]:
        """Cached function that returns the times and heights of a block of time by its number."""
        return lru_cache(maxsize=512)(
            lambda block: self._table(block * _BLOCK, (block + 1) * _BLOCK)
        )

    def _table(self, begin: float, end: float) -> tuple[FloatArray, FloatArray]:
        """Times (s) from just before `begin` to just after `end`, and heights (m) over datum."""
        steps = np.arange(math.floor(begin / _STEP) - 1, math.ceil(end / _STEP) + 2)
        times = _STEP * steps.astype(float)
        return times, self.ratio * (self.mean_level + self._predicted(times))

    def _predicted(self, times: FloatArray) -> FloatArray:
        """Sum of the constituents (m) at times (n,), s, by the library."""
        table = _waves(self._moving)
        waves = [self._moving[name] for name in table.constituents]
        tides = np.array([a * cmath.exp(1j * math.radians(phase)) for a, phase in waves])
        since = np.rint(1e6 * (times - self.offset)).astype("timedelta64[us]")
        return np.asarray(table.tide_from_tide_series(self.epoch + since, tides)).ravel()


def arguments(names: Iterable[str], instants: Instants) -> tuple[FloatArray, FloatArray]:
    """Nodal factors f and arguments V + u (radians, at Greenwich) by Schureman.

    `names` are those of constituents, as in `Tide`; `instants` (n,) are datetime64, UTC. Both
    results are (constituents, n), in the order of the names. Raises ParameterError for names that
    pyfes doesn't know, or if it is not installed.
    """
    names = list(names)
    if faults := _name_faults(names):
        raise ParameterError("tide: " + "; ".join(faults))
    known = [_known()[_upper(name)] for name in names]
    table = _waves(known)
    factors, angles = table.compute_nodal_modulations(instants.astype("datetime64[us]"))
    order = [table.constituents.index(name) for name in known]
    turned = np.radians([_TURNED.get(_upper(name), 0.0) for name in names])
    return factors[order], angles[order] + turned[:, None]


def speeds(names: Iterable[str]) -> FloatArray:
    """Speeds of constituents, degrees an hour."""
    known = [_known()[_upper(name)] for name in names]
    from pyfes import DEGREE_PER_HOUR

    table = _waves(known)
    return np.array([table[name].frequency(DEGREE_PER_HOUR) for name in known])


def _waves(names: Iterable[str]) -> "WaveTableInterface":
    """Return the library's table of some constituents, by its own names."""
    import pyfes

    return pyfes.wave_table_factory(pyfes.DARWIN, list(names))


@lru_cache(maxsize=1)
def _known() -> dict[str, str]:
    """The library's names of all constituents, by their spelling in capitals."""
    try:
        import pyfes
    except ImportError as error:
        raise ParameterError(
            "tide: heights from harmonic constants need pyfes, which is not installed; "
            "pip install 'pyfes<2026.10'"
        ) from error
    return {name.upper(): name for name in pyfes.wave_table_factory(pyfes.DARWIN).constituents}


def _upper(name: str) -> str:
    """Spell a constituent in capitals, as the library would."""
    return _SPELLED.get(name.upper(), name.upper())


def _name_faults(given: Iterable[object]) -> list[str]:
    """Say which names the library doesn't know, and which stand for one constituent."""
    names = [name for name in given if isinstance(name, str)]
    counts = Counter(map(_upper, names))
    return [
        f"{shown(name)} is no constituent that pyfes knows; leave it out if it is small"
        for name in names
        if _upper(name) not in _known()
    ] + [f"{name} is given {count} times" for name, count in counts.items() if count > 1]


def _instant(epoch: object) -> np.datetime64:
    """Return an instant as UTC, to the microsecond."""
    if isinstance(epoch, dt.datetime):
        aware = epoch if epoch.tzinfo is not None else epoch.replace(tzinfo=dt.UTC)
        epoch = np.datetime64(aware.astimezone(dt.UTC).replace(tzinfo=None), "us")
    if not isinstance(epoch, np.datetime64) or np.isnat(epoch):
        raise ParameterError(f"tide: epoch = {shown(epoch)} must be a datetime or a datetime64")
    instant: np.datetime64 = epoch.astype("datetime64[us]")
    return instant


def _finite_times(times: object) -> FloatArray:
    """Refuse times (s) that are not numbers, or lie centuries from the epoch."""
    seconds = as_floats("tide: times", times)
    if not (abs(seconds) <= _MOST_TIME).all():
        raise ParameterError(f"tide: times must be within {_MOST_TIME:g} s of the epoch")
    return seconds
