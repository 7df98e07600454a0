"""Tidal streams from harmonic constants: the time between their fields, and where they are weak."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np

from pipeline._types import BoolArray
from pipeline.geo.lonlat import Bounds
from pipeline.model import Note
from pipeline.scenario.season import Season
from pipeline.sources.cf.contents import Contents
from pipeline.sources.cf.dataset import open_dataset, reading
from pipeline.sources.cf.grid import FieldReader, Window, find_window, read_window
from pipeline.sources.cf.slices import LONGEST_STEP, SelectedSlices, select_slices
from renew.inputs.tide import arguments, speeds

WEAK_SHARE = 0.7
"""Share of the variance below which the constants of a node count as unreliable."""
# Largest difference between the streams and straight lines in time between their fields, m/s.
_ERROR_M_S = 0.03
# Times between fields, minutes: parts of an hour, so that the hours of other currents are kept.
_STEPS_MIN = (60, 30, 20, 15, 12, 10, 6, 5)
# Number of values of all fields above which the time between them is longer: 160 MB a component.
_MAX_VALUES = 20_000_000
# Years beyond the series of a fit after which its constants are called old.
_OLD_YEARS, _YEAR = 5.0, timedelta(days=365.25)


def stream_slices(
    contents: Contents, season: Season, bounds: Bounds, *, with_mean: bool
) -> SelectedSlices:
    """Return the fields of a season inside bounds, with notes on them.

    Raises
    ------
    ValueError
        The file is damaged.
    """
    window = find_window(contents.lon, contents.lat, bounds)
    step, error_m_s = _time_step(contents, window, season)
    found = select_slices(contents, season, step, with_mean=with_mean)
    notes = [
        Note.of(
            "tidal-streams",
            names=contents.constituents,
            step_min=step / timedelta(minutes=1),
            error_m_s=error_m_s,
            has_mean=contents.has_mean and with_mean,
        ),
        *_age_notes(contents, season.period.begin),
    ]
    return replace(found, notes=tuple(notes))


def _time_step(contents: Contents, window: Window, season: Season) -> tuple[timedelta, float]:
    """Return the time between fields, and the largest error of interpolation between them, m/s.

    A constituent of amplitude A is too large by A (ω h)² / 12 in its fields, which
    :func:`select_slices` enlarges, and too small by half of that midway between two fields. A is
    bounded by the largest of its parts at any node.
    """
    names, count = contents.constituents, len(contents.constituents)
    peaks = np.zeros((2, len(contents.u_index)))
    with FieldReader(contents, window) as reader:
        for row, (files, index) in enumerate(
            ((contents.u, contents.u_index), (contents.v, contents.v_index))
        ):
            for steps, values in reader.blocks(files, index, range(2 * count)):
                sizes = np.where(np.isfinite(values), np.abs(values), 0.0)
                peaks[row, steps] = sizes.max(axis=(1, 2), initial=0.0)
    amplitudes = np.sqrt((peaks[:, : 2 * count] ** 2).reshape(2, 2, count).sum(axis=(0, 1)))
    at = np.array([season.period.begin.replace(tzinfo=None)], "datetime64[us]")
    factors, _ = arguments(names, at)
    turns_h = np.radians(speeds(names))
    bend = float((factors[:, 0] * amplitudes * turns_h**2).sum()) / 12  # m/s for an hour's step

    hours = (season.period.end - season.period.begin + LONGEST_STEP) / timedelta(hours=1)
    nodes = window.lon.size * window.lat.size
    fitting = [
        minutes
        for minutes in _STEPS_MIN
        if bend * (minutes / 60) ** 2 <= _ERROR_M_S or minutes == _STEPS_MIN[-1]
    ]
    small = [minutes for minutes in _STEPS_MIN if nodes * hours * 60 / minutes <= _MAX_VALUES]
    minutes = max(fitting[0], small[-1] if small else _STEPS_MIN[0])
    return timedelta(minutes=minutes), bend * (minutes / 60) ** 2


def _age_notes(contents: Contents, departure: datetime) -> list[Note]:
    """Return a note where the departure is years from the series that gave the constants."""
    series = []
    for side in ("start", "end"):
        try:
            found = datetime.fromisoformat(contents.attributes[f"time_coverage_{side}"])
        except (KeyError, ValueError):
            return []
        series.append(found if found.tzinfo else found.replace(tzinfo=UTC))
    years = max(series[0] - departure, departure - series[1]) / _YEAR
    if years <= _OLD_YEARS:
        return []
    return [Note.of("constants-old", begin=series[0], end=series[1], years=years)]


def weak_cells(contents: Contents, bounds: Bounds) -> BoolArray | None:
    """Return where constants explain too little variance (ny, nx); None if the file doesn't say.

    Raises
    ------
    ValueError
        The file is damaged.
    """
    part = contents.u[0]
    window = find_window(contents.lon, contents.lat, bounds)
    with open_dataset(part.file) as dataset:
        share = dataset.variables.get("variance_share")
        if share is None or share.dims != (part.lat, part.lon):
            return None
        with reading():
            return np.asarray(read_window(share, (part.lat, part.lon), window) < WEAK_SHARE)
