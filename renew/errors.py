"""Every way in which a plan can be refused, and the first check of callers' arguments.

A message names the value, the limit it broke and what to change.
"""

import math
import reprlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias, TypeGuard, TypeVar

import numpy as np

from renew._types import FloatArray

PlaceSpelling: TypeAlias = Callable[[FloatArray], str]
"""Spells a place (2,), m, for a message: in metres, or in the coordinates that the caller knows."""
_SHORT = reprlib.Repr()
ValueT = TypeVar("ValueT")


def in_metres(place: FloatArray) -> str:
    """Spell a place in planar metres, to the millimetre."""
    x, y = (round(float(metres), 3) for metres in place)
    return f"({x:.10g}, {y:.10g}) m"


@dataclass(frozen=True, slots=True)
class Moment:
    """A moment on the clock of the current, s, that a message names."""

    seconds: float


MomentSpelling: TypeAlias = Callable[[Moment], str]
"""Spells a moment for a message: in seconds, or as a date where the clock's beginning is known."""


def in_seconds(moment: Moment) -> str:
    """Spell a moment in seconds on the clock of the current."""
    return f"{moment.seconds:.6g} s"


@dataclass(frozen=True, slots=True)
class Length:
    """A length in planar metres that a message names.

    `across` (2, 2) is the gap that it is measured in, from bank to bank: on a chart where a margin
    covers the shores, readers are told the length with the margins there.
    """

    metres: float
    across: FloatArray | None = field(default=None, compare=False)

    def __str__(self) -> str:
        """Spell it to the centimetre."""
        return f"{self.metres:.2f} m"


@dataclass(frozen=True, slots=True)
class Duration:
    """A time that something takes, s, that a message names."""

    seconds: float

    def __str__(self) -> str:
        """Spell it, rounded up: to the minute from a quarter of an hour on, else to 0.1 s."""
        if self.seconds < 900:
            return f"{math.ceil(10 * self.seconds - 1e-3) / 10:g} s"
        hours, minutes = divmod(math.ceil(self.seconds / 60 - 1e-3), 60)
        parts = [f"{hours} h"] * (hours > 0) + [f"{minutes} min"] * (minutes > 0)
        return " ".join(parts)


@dataclass(frozen=True, slots=True)
class ClassName:
    """The name of a homotopy class that a message names, shortened for a sentence."""

    name: str

    def __str__(self) -> str:
        """Return the name."""
        return self.name


LengthSpelling: TypeAlias = Callable[[Length], str]
"""Spells a length for a message: in planar metres, or in true metres if the scale is known."""
DurationSpelling: TypeAlias = Callable[[Duration], str]
"""Spells a duration for a message: as the planner takes it, or a true one."""


@dataclass(frozen=True, slots=True, eq=False)
class Text:
    """A message that keeps places, moments and lengths as values, until somebody spells them.

    Attributes
    ----------
    template : for `str.format`, {0} being the first value; used unchanged if there are no values.
    values : places (2,), m; moments; lengths; durations; names of classes; texts inside the text.
    """

    template: str
    values: "tuple[Value, ...]" = ()

    def __str__(self) -> str:
        """Return the message with places and lengths in metres and moments in seconds."""
        return self.spelled()

    def spelled(
        self,
        place: PlaceSpelling = in_metres,
        moment: MomentSpelling = in_seconds,
        length: LengthSpelling = str,
        duration: DurationSpelling = str,
    ) -> str:
        """Return the message with its places, moments, lengths and durations spelled."""
        words = []
        for value in self.values:
            match value:
                case Text():
                    words.append(value.spelled(place, moment, length, duration))
                case Moment():
                    words.append(moment(value))
                case Length():
                    words.append(length(value))
                case Duration():
                    words.append(duration(value))
                case ClassName():
                    words.append(value.name)
                case _:
                    words.append(place(value))
        return self.template.format(*words) if words else self.template

    def values_of(self, kind: type[ValueT]) -> tuple[ValueT, ...]:
        """Return the values of a kind in their order, also those of texts inside this text."""
        values = list[ValueT]()
        for value in self.values:
            if isinstance(value, Text):
                values += value.values_of(kind)
            elif isinstance(value, kind):
                values.append(value)
        return tuple(values)

    @property
    def places(self) -> tuple[FloatArray, ...]:
        """The places that it names, (2,) m each, in the order of its values."""
        return self.values_of(np.ndarray)

    @classmethod
    def joined(cls, separator: str, texts: "Sequence[Text]") -> "Text":
        """Return texts one after the other."""
        return cls(separator.join(f"{{{at}}}" for at in range(len(texts))), tuple(texts))


Value: TypeAlias = FloatArray | Moment | Length | Duration | ClassName | Text
"""What a text keeps as a value."""


def from_until(begin: float, end: float, *, on: str = "") -> Text:
    """Spell begin and end (s), as far as they are finite; `on` replaces an infinite end."""
    parts = [Text(" from {0}", (Moment(begin),))] if math.isfinite(begin) else []
    parts.append(Text(" until {0}", (Moment(end),)) if math.isfinite(end) else Text(on))
    return Text.joined("", parts)


class PlanningError(Exception):
    """A plan that cannot be made; the base of all errors that `renew` raises on purpose.

    Its class says which kind of error it is.

    Parameters
    ----------
    message
        The text; where values are given, a template for `str.format`: {0} is the first.
    values
        Places (2,), m, moments, lengths and texts that the message names. `str(error)` gives
        places and lengths in planar metres and moments in seconds.
    """

    def __init__(self, message: str | Text, *values: Value) -> None:
        self.text = message if isinstance(message, Text) else Text(message, values)
        super().__init__(str(self.text))

    @property
    def places(self) -> tuple[FloatArray, ...]:
        """The places that the message names, (2,) m each."""
        return self.text.places

    def __reduce__(self) -> "tuple[type[PlanningError], tuple[Text]]":
        """Pickle the text: the error can then come back from a worker process."""
        return type(self), (self.text,)


class ParameterError(PlanningError, ValueError):
    """An argument outside its range: unknown method, risk not in (0, 1), k < 1."""


class GeometryError(PlanningError, ValueError):
    """A chart whose polygons are not valid, not finite, or leave no water."""


class StartInNoGoError(PlanningError):
    """The start lies on land or outside the chart."""


class GoalInNoGoError(PlanningError):
    """The goal lies on land or outside the chart."""


class ViaInNoGoError(PlanningError):
    """A via point lies on land or outside the chart."""


class ArrivalError(PlanningError):
    """No voyage from the requested departure arrives in time."""


class CurrentTooStrongError(PlanningError):
    """The current is as strong as the vessel at a place where the vessel has to be."""


@dataclass(frozen=True, eq=False)
class Strait:
    """Where a class is blocked: its padding takes a whole gap.

    Attributes
    ----------
    gap : (2, 2) metres, from the left to the right bank.
    triangle : the triangle that holds it, by its number in the triangulation; `before` and `after`
        are the ones that the channel comes from and leads to, -1 at its ends.
    padding_left, padding_right : the paddings that the two banks need, m.
    """

    gap: FloatArray
    before: int
    triangle: int
    after: int
    padding_left: float
    padding_right: float

    @property
    def transition(self) -> tuple[int, int, int]:
        """The triangle, with the ones before and after it."""
        return self.before, self.triangle, self.after

    @property
    def width(self) -> float:
        """Metres from bank to bank."""
        return math.dist(*self.gap)


class UnreachableError(PlanningError):
    """No water joins start and goal, or no class between them can be sailed.

    `straits` are the gaps that block the classes; empty where something else blocks one of the
    classes. `causes` are the errors for which classes were rejected; empty where no class was
    found.
    """

    straits: tuple[Strait, ...] = ()
    causes: tuple[PlanningError, ...] = ()


class ShutStartError(UnreachableError):
    """The start's water is shut; neither another way nor less padding helps."""


class InfeasibleError(PlanningError):
    """One class can't be sailed; only inside the planner: a plan lists the class as rejected.

    `strait` is the narrowest gap that blocks its channel, if any does; `blocked` are the triangles
    of all gaps that block it, each with the triangles before and after it.
    """

    strait: Strait | None = None
    blocked: frozenset[tuple[int, int, int]] = frozenset()

    @classmethod
    def at_strait(
        cls, strait: Strait, blocked: Iterable[tuple[int, int, int]] = ()
    ) -> "InfeasibleError":
        """Return the error for one of all blocked gaps, with the width that its paddings take."""
        error = cls(
            "blocked at {0}, between {1} and {2}: the gap is {3} wide, and {4} are needed, with "
            "{5} on the left and {6} on the right bank for padding",
            strait.gap.mean(axis=0),
            *strait.gap,
            Length(strait.width, strait.gap),
            Length(strait.padding_left + strait.padding_right, strait.gap),
            Length(strait.padding_left),
            Length(strait.padding_right),
        )
        error.strait, error.blocked = strait, frozenset((strait.transition, *blocked))
        return error


class TooSharpError(InfeasibleError):
    """Corners of the class's path leave the vessel too little room to turn in.

    For each point (n,), `excess` is the share of a leg beside it that the arcs need: at most 1 if
    there is enough room.
    """

    excess: FloatArray

    @classmethod
    def at_points(cls, path: FloatArray, asked: FloatArray, length: FloatArray) -> "TooSharpError":
        """Return the error for the leg of a path (n, 2) that lacks most of the length asked, m."""
        worst = int((asked - length).argmax())
        error = cls(
            "the corners beside the leg at {0} need {1} to turn in; it has {2}",
            path[worst],
            Length(float(asked[worst])),
            Length(float(length[worst])),
        )
        by_leg = asked / np.maximum(length, 1e-300)
        error.excess = np.maximum(np.append(by_leg, 0.0), np.append(0.0, by_leg))
        return error


class TooLateError(InfeasibleError):
    """The class's path would arrive after the last time of the current."""


_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 100


def shown(value: object) -> str:
    """Return a value as Python writes it, on one line; a long value without its middle."""
    return " ".join(_SHORT.repr(value).split())


def is_number(value: object) -> TypeGuard[float]:
    """Whether a value is a real number; truth values and durations are not."""
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(
        value, bool | np.timedelta64
    )


def is_finite(value: object) -> TypeGuard[float]:
    """Whether a value is a number that is finite as a float."""
    try:
        return is_number(value) and math.isfinite(value)
    except OverflowError:  # an int too large for a float
        return False


def as_floats(name: str, value: object) -> FloatArray:
    """Return real numbers as floats; refuse text, complex numbers, dates and masked values."""
    try:
        array = np.asarray(value)
        if array.dtype.kind == "O":
            # NumPy would take None for NaN.
            array = np.array([float(one) for one in array.ravel()]).reshape(array.shape)
        if array.dtype.kind in "biuf" and not np.ma.is_masked(value):
            return np.asarray(array, dtype=float)
    except (TypeError, ValueError, OverflowError):
        pass
    raise ParameterError(f"{name} = {shown(value)} must be real numbers")


def check_kind(name: str, value: object, kind: type) -> None:
    """Refuse an object that is not of a given class of this package."""
    if not isinstance(value, kind):
        raise ParameterError(f"{name} = {shown(value)} must be a renew.{kind.__name__}")
