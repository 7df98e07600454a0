"""The commands `renew tide show | fit`: high and low waters; constants of a user's own currents."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from pipeline.cli import options
from pipeline.errors import Faults, RequestError, StageError, naming
from pipeline.machine.paths import NOT_THERE, folder_to_write, shown, unreadable_reason

if TYPE_CHECKING:
    from pipeline.sources.tide_stations import Station

app = options.group(help="Heights of the tide at a station, and constants of tidal streams.")
# Number of days listed by default.
_DAYS = 7
# Largest number of days: ten years are a long list.
_MOST_DAYS = 3660


@options.command(app, "tide show")
def show(
    station: str, *, begin: str | None = None, end: str | None = None, as_json: bool = False
) -> None:
    """List high and low waters at a station, as an almanac does, in UTC."""
    from pipeline.sources.tide_stations import find_station

    faults = Faults()
    span = faults.collect(lambda: _span(begin, end))
    tide_station = faults.collect(lambda: find_station(station))
    if span is None or tide_station is None:
        raise RequestError(faults.lines)
    typer.echo(_listed(tide_station, *span, as_json=as_json))


@options.command(app, "tide fit")
def fit(series: list[str], *, out: Path) -> None:
    """Fit harmonic constants to the user's own hourly currents, at each of their nodes."""
    import numpy as np

    from pipeline.findings.note_words import note_texts
    from pipeline.machine.files import whole_file
    from pipeline.sources.cf.contents import find_files, read_contents
    from pipeline.sources.cf.fields import WEAK_SHARE
    from pipeline.sources.cf.harmonic_fit import fit_files

    folder = folder_to_write(out.parent, "--out")
    if (reason := unreadable_reason(folder / out.name)) not in {"", NOT_THERE}:
        raise RequestError(f"--out: {shown(out)} {reason}")
    if not folder.is_dir() or (folder / out.name).is_dir():
        raise RequestError(f"--out: {shown(out)} can't be a file; name one in a folder")
    constants = fit_files(series)
    contents = read_contents(find_files(series))
    for text in note_texts([*contents.notes, *contents.steps.notes]):
        typer.echo(f"note: {text}", err=True)
    try:
        with whole_file(folder / out.name) as file:
            # Names are written as characters: if a file with strings is opened twice at a time,
            # the NetCDF library frees the type of strings at the first close, and crashes at
            # the second.
            names_as = {"constituent": {"dtype": "S1"}}
            constants.to_netcdf(file.name, engine="netcdf4", encoding=names_as)
    except (OSError, RuntimeError) as error:
        raise StageError(f"--out: {shown(out)} can't be written: {error}") from None
    share, rms = constants["variance_share"].values, constants["residual_rms"].values
    is_fitted = np.isfinite(rms)
    weak = int((share[is_fitted] < WEAK_SHARE).sum())
    names = constants["constituent"].values.tolist()
    typer.echo(
        f"{shown(out)}: {len(names)} constituents at {is_fitted.sum():,} nodes: {', '.join(names)}"
    )
    if is_fitted.any():
        typer.echo(
            f"Medians: {np.median(share[is_fitted]):.0%} of the variance, residual "
            f"{np.median(rms[is_fitted]):.2f} m/s rms. {weak:,} nodes have less than "
            f"{WEAK_SHARE:.0%} of the variance, and {(~is_fitted).sum():,} have an incomplete "
            "series."
        )


def _span(begin: str | None, end: str | None) -> tuple[datetime, datetime]:
    faults = Faults()
    today = f"{datetime.now(UTC):%Y-%m-%d}"
    first = faults.collect(lambda: _moment("--from", begin or today, at_end=False))
    last = faults.collect(lambda: _moment("--to", end, at_end=True)) if end else None
    if faults.lines or first is None:
        raise RequestError(faults.lines)
    last = last or first + timedelta(days=_DAYS)
    if not first < last <= first + timedelta(days=_MOST_DAYS):
        raise RequestError(
            f"--from {begin or today} --to {end}: give an end after the beginning, by at most "
            f"{_MOST_DAYS:,} days"
        )
    return first, last


def _moment(option: str, text: str, *, at_end: bool) -> datetime:
    """Read a moment; of a day its beginning or its end."""
    from pipeline.scenario.season import period

    with naming(option):
        named = period(text)
    return named.end if at_end else named.begin


def _listed(station: "Station", first: datetime, last: datetime, *, as_json: bool) -> str:
    """Write a station's high and low waters between two moments."""
    from pipeline.findings.text import to_minute

    waters = [
        (to_minute(first + timedelta(seconds=time)), height, "high" if is_high else "low")
        for time, height, is_high in zip(
            *(
                column.tolist()
                for column in station.tide(first).high_and_low(0, (last - first).total_seconds())
            ),
            strict=True,
        )
    ]
    # A place that follows a station has the station's mean level, times the height ratio.
    mean_level_m = station.ratio * station.mean_level_m
    if as_json:
        return json.dumps(
            {
                "station": station.name,
                "datum": station.datum,
                "mean_level_m": round(mean_level_m, 3),
                "credit": station.credit,
                "waters": [
                    {"time": f"{at:%Y-%m-%dT%H:%MZ}", "height_m": round(height, 3), "kind": kind}
                    for at, height, kind in waters
                ],
            },
            ensure_ascii=False,
        )
    head = f"{station.name}: predicted heights over {station.datum}, without weather; times are UTC"
    lines = [f"{at:%Y-%m-%d  %H:%M}  {height:6.2f} m  {kind}" for at, height, kind in waters]
    lines.append(f"Mean sea level is {mean_level_m:.2f} m over {station.datum}.")
    if station.credit:
        lines.append(f"Constants: {station.credit}.")
    return "\n".join([head, *lines])
