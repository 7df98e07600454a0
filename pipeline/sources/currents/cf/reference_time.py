"""The reference time of a forecast in files, where they say it.

CF has a variable for it, of the standard name `forecast_reference_time`; others write it into a
global attribute.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from pipeline.sources.currents.cf.dataset import coordinate_values
from pipeline.sources.currents.cf.time import decoded_times

if TYPE_CHECKING:
    import xarray as xr

_STANDARD_NAME = "forecast_reference_time"
# Global attributes that hold it: of CF's own name, of Copernicus Marine's files, of others.
_ATTRIBUTES = ("forecast_reference_time", "bulletin_date", "forecast_reference", "reference_time")
_DIGITS = re.compile(r"(\d{4})-?(\d{2})-?(\d{2})(?:[T ]?(\d{2}):?(\d{2})?)?")


def reference_time(datasets: Iterable[xr.Dataset]) -> datetime | None:
    """Return the newest reference time (aware, UTC) of open files; None where one says none."""
    times = [_from_variable(dataset) or _from_attributes(dataset) for dataset in datasets]
    known = [time for time in times if time is not None]
    return max(known) if known and len(known) == len(times) else None


def _from_variable(dataset: xr.Dataset) -> datetime | None:
    """Read the variable of CF; None where there is none that can be read."""
    for name, variable in dataset.variables.items():
        if variable.attrs.get("standard_name") == _STANDARD_NAME:
            try:
                values = coordinate_values(dataset, str(name)).reshape(-1)
                times = decoded_times(dataset[name], values, str(variable.attrs.get("units", "")))
            except ValueError:
                return None
            return max(times, default=None)
    return None


def _from_attributes(dataset: xr.Dataset) -> datetime | None:
    """Read a global attribute; None where none holds a time."""
    for name in _ATTRIBUTES:
        found = _DIGITS.search(str(dataset.attrs.get(name, "")))
        if found:
            year, month, day, hour, minute = (int(digits or 0) for digits in found.groups())
            try:
                return datetime(year, month, day, hour, minute, tzinfo=UTC)
            except ValueError:
                continue
    return None
