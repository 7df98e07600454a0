"""Intervals of time as a scenario or a night writes them: '30min', '6h', '1d'."""

import re
from datetime import timedelta
from typing import Annotated

from pydantic import AfterValidator

_INTERVAL = re.compile(r"(\d{1,4})(min|h|d)", re.ASCII)
_UNITS = {"min": timedelta(minutes=1), "h": timedelta(hours=1), "d": timedelta(days=1)}


def interval(text: str) -> timedelta:
    """Read an interval.

    Raises
    ------
    ValueError
        The text is no interval, or 0.
    """
    found = _INTERVAL.fullmatch(text)
    if not found:
        raise ValueError(f"= {text!r} is not an interval; give it as '30min', '6h' or '1d'")
    if not int(found[1]):
        raise ValueError(f"= {text!r} is no time at all; give one above 0, such as '6h'")
    return int(found[1]) * _UNITS[found[2]]


def _checked(text: str) -> str:
    """Refuse what is no interval."""
    interval(text)
    return text


Interval = Annotated[str, AfterValidator(_checked)]
