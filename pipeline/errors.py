"""The errors that end a run, and limits on the length of their messages."""

import contextlib
import re
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Self, TypeVar

from pipeline.texts import clean

# Largest number of faults in a message: a person mends some dozens, and then asks again.
_MAX_FAULTS = 40
# Largest number of characters in a fault, and in one of its words, such as a path.
_MAX_FAULT = 800
_MAX_WORD = 200
# From this number of faults that are equal except for their place, only the first is reported.
_MIN_ALIKE = 4
# Largest number of other places that are named with it.
_MAX_PLACES = 3
_LONG_WORD = re.compile(rf"\S{{{_MAX_WORD + 1},}}")
_Value = TypeVar("_Value")


def shortened(text: str) -> str:
    """Shorten a message's long words and, if it is still too long, its middle; the end stays."""
    words = _LONG_WORD.sub(lambda word: _without_middle(word[0], _MAX_WORD), text)
    return _without_middle(words, _MAX_FAULT)


def _without_middle(text: str, size: int) -> str:
    """Replace the middle of a text that is too long by "…"."""
    return text if len(text) <= size else f"{text[: size // 2]}…{text[1 - size // 2 :]}"


class Fault(str):
    """A fault at a place, such as `seasons[3].name` or `row 7`, and the words around the place."""

    __slots__ = ("around", "place")
    place: str
    around: tuple[str, str]

    def __new__(cls, place: str, after: str, before: str = "") -> Self:
        """Spell a fault; `after` begins with its space or colon."""
        fault = super().__new__(cls, f"{before}{place}{after}")
        fault.place, fault.around = place, (before, after)
        return fault

    def behind(self, words: str) -> "Fault":
        """Return the fault with more words before it."""
        before, after = self.around
        return Fault(self.place, after, f"{words}{before}")


def condensed(faults: Iterable[str]) -> tuple[str, ...]:
    """Put each fault into a line; report similar faults once, and count those beyond a limit."""
    alike: dict[tuple[str, ...], list[str]] = {}
    for fault in faults:
        kind = fault.around if isinstance(fault, Fault) else (fault,)
        alike.setdefault(kind, []).append(fault)
    lines = []
    for group in alike.values():
        different = list(dict.fromkeys(group))
        lines += different if len(different) < _MIN_ALIKE else [_once(different)]
    if len(lines) > _MAX_FAULTS:
        more = len(lines) - (_MAX_FAULTS - 1)
        lines[_MAX_FAULTS - 1 :] = [f"and {more:,} more faults; mend these first"]
    return tuple(clean(shortened(line)) for line in lines)


def _once(faults: Sequence[str]) -> str:
    """Return the first of several similar faults, with the places of the others."""
    named = [fault.place for fault in faults[1 : _MAX_PLACES + 1] if isinstance(fault, Fault)]
    more = len(faults) - 1 - len(named)
    rest = f" and {more:,} more" if more else ""
    return f"{faults[0]} (the same in {', '.join(named)}{rest})"


class PipelineError(Exception):
    """An expected error, whose text is written for the user."""

    exit_code = 1

    def __init__(self, text: str = "") -> None:
        super().__init__("\n".join(clean(shortened(line)) for line in text.split("\n") if line))


class RequestError(PipelineError):
    """The request is wrong: exit code 2, nothing is written.

    Each of the `faults`, one or several, has the value, the limit and the remedy. Those that are
    equal except for their place are reported once.
    """

    exit_code = 2

    def __init__(self, faults: str | Sequence[str]) -> None:
        self.faults = condensed([faults] if isinstance(faults, str) else faults)
        super().__init__("\n".join(self.faults))

    def __reduce__(self) -> "tuple[type[RequestError], tuple[tuple[str, ...]]]":
        """Keep the faults when the error is pickled by a worker process."""
        return type(self), (self.faults,)


def refuse_any(faults: Sequence[str]) -> None:
    """Raise RequestError with the faults of a request, unless there are none."""
    if faults:
        raise RequestError(faults)


class Faults:
    """The faults of all parts of a request, or of the work after a plan, reported together."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def collect(self, read: Callable[[], _Value]) -> _Value | None:
        """Read one part of a request; if it has faults, keep their lines and return None."""
        try:
            return read()
        except RequestError as error:
            self.lines += error.faults
            return None

    @contextlib.contextmanager
    def kept(self, what: str) -> Iterator[None]:
        """Do a part of the work, named `what`; an unexpected error only ends it, and is kept.

        Errors of the disk and expected ones pass.
        """
        try:
            yield
        except (PipelineError, OSError):
            raise
        except Exception as error:  # noqa: BLE001 - whatever it is, the plan is worth its files
            line = f"{what} failed, and the rest is written; please report this: {one_line(error)}"
            self.lines += [line] * (line not in self.lines)


@contextlib.contextmanager
def naming(place: str, kind: type[Exception] = RequestError) -> Iterator[None]:
    """Turn a ValueError into an error of a kind that names the place, such as a file, first."""
    try:
        yield
    except ValueError as error:
        raise kind(f"{place}: {error}") from None


class NoPlanError(RequestError):
    """No case could be planned as asked."""


class NoWayError(NoPlanError):
    """No case has a way from start to goal in the region; a wider region may have one."""


class StageError(PipelineError):
    """A stage failed though the request is valid: exit code 1, finished stages are kept."""


class MachineError(StageError):
    """The machine failed, as by a full disk: no other source of data does better."""


def one_line(error: BaseException) -> str:
    """Return an error's text in one line, for an unexpected error with its type and place."""
    text = clean(str(error))
    if isinstance(error, PipelineError):
        return text
    frames = traceback.extract_tb(error.__traceback__)
    where = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {text}{where}"
