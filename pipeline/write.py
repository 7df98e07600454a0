"""Last stage: write all files of a run, or leave the earlier files unchanged.

The files are written to a temporary folder, which then replaces the earlier one in a single step
(:mod:`pipeline.machine.files`).
"""

import errno
import importlib
import json
import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from pipeline.errors import LateFaults, StageError
from pipeline.findings.names import MANIFEST, season_stem
from pipeline.findings.result import RunResult
from pipeline.machine.files import replacing
from pipeline.machine.interpreters import seldom_collecting
from pipeline.model import CurrentGrid
from pipeline.scenario.season import Season

Format = Callable[[RunResult, Path], None]

_ELSEWHERE = "or choose another folder with --output"
_REMEDIES = {
    errno.ENOSPC: "the disk is full: free some space",
    errno.EDQUOT: "the disk quota is used up: free some space",
    errno.EFBIG: "a file would be larger than the system allows: raise the limit (ulimit -f)",
    errno.EACCES: "no permission: change the folder's owner or mode",
    errno.EPERM: "no permission: change the folder's owner or mode",
    errno.EROFS: "the file system is read-only: mount it for writing",
    errno.EEXIST: "a file is in the place of a folder: move it away",
    errno.ENOTDIR: "a file is in the place of a folder: move it away",
    errno.EISDIR: "a folder is in the place of a file: move it away",
    errno.ENAMETOOLONG: "the path is too long: choose a shorter one",
}


def write(
    result: RunResult,
    directory: Path,
    on_file: Callable[[str], None] | None = None,
    late: LateFaults | None = None,
) -> tuple[Path, ...]:
    """Write all output files of a run into `directory`, which is created if needed.

    A file that is in an earlier run's manifest and is not written by this run is removed, so that
    nobody sails an outdated route.

    Parameters
    ----------
    result
        The planned and evaluated run.
    directory
        The run's own folder; see `output_directory`.
    on_file
        Called before each file is written, with its name and number: "report.html (3 of 12)".
    late
        Takes the unexpected errors of single files, which are left out; by default they are raised.

    Returns
    -------
    tuple of Path
        The files, the manifest last.

    Raises
    ------
    StageError
        The files can't be written; earlier files are unchanged. The message has the remedy.
    """
    from pipeline.formats.records import write_manifest

    try:
        formats = formats_of(result)
        _check_target(directory, [*formats, MANIFEST])
        with (
            seldom_collecting(),
            replacing(directory, lambda: _earlier_results(directory)) as staging,
        ):
            written = []
            for number, (name, writer) in enumerate(formats.items(), start=1):
                if on_file is not None:
                    on_file(f"{name} ({number} of {len(formats)})")
                make = partial(_made, writer, result, staging / name)
                if (
                    make()
                    if late is None
                    else late.attempt(f"writing {name}", make, otherwise=False)
                ):
                    written.append(staging / name)
                else:
                    (staging / name).unlink(missing_ok=True)
            write_manifest(result, staging / MANIFEST, written)
    except OSError as error:
        remedy = _REMEDIES.get(error.errno or 0) or f"{error.strerror or error}: resolve this"
        raise StageError(
            f"write: cannot write the results to {directory}: {remedy}, {_ELSEWHERE}"
        ) from error
    return (*(directory / path.name for path in written), directory / MANIFEST)


def _made(writer: Format, result: RunResult, path: Path) -> bool:
    """Write a file; it is there then."""
    writer(result, path)
    return True


def load_libraries() -> None:
    """Import what writes files, and its libraries; it takes a second: call it before planning."""
    for name in ("gis.geopackage", "passage_plan", "passage.routes", "report.page"):
        importlib.import_module(f"pipeline.formats.{name}")
    importlib.import_module("geopandas")


def formats_of(result: RunResult) -> dict[str, Format]:
    """Return the function that writes each file of a run, keyed by file name."""
    from pipeline.findings.departures_and_speeds import trade_offs
    from pipeline.findings.ensembles import has_ensembles
    from pipeline.formats import tables
    from pipeline.formats.gis.geopackage import write_geopackage
    from pipeline.formats.haven_table import write_havens
    from pipeline.formats.passage_plan import write_passage_plan
    from pipeline.formats.report.page import write_report

    formats: dict[str, Format] = {
        "routes.gpkg": write_geopackage,
        "metrics.csv": tables.write_metrics,
        "scenario.toml": tables.write_scenario,
    }
    if result.departures:
        formats["departures.csv"] = tables.write_departures_csv
    if has_ensembles(result):
        formats["ensemble.csv"] = tables.write_ensemble_csv
    if result.coverages:
        formats["havens.csv"] = write_havens
    if trade_offs(result):
        formats["trade-off.csv"] = tables.write_trade_off_csv
    for grid in result.fetched.currents:  # a planar scenario has none: its current is a formula
        formats |= _current_formats(result, grid)
    if not result.scenario.is_planar:  # a plane lies nowhere on earth: nobody can navigate by it
        if result.routes:
            formats["passage-plan.pdf"] = write_passage_plan
        for season in result.scenario.seasons:
            if result.season_routes(season.name):
                formats |= _season_formats(result, season)
                formats |= _haven_formats(result, season.name)
    # Last, because it waits for the bounds on other sides.
    return {**formats, "report.html": write_report}


def _current_formats(result: RunResult, grid: CurrentGrid) -> dict[str, Format]:
    """Return the files of a season's current; for a plotter only where its time is known."""
    from pipeline.formats.grib import fields_from, write_grib
    from pipeline.formats.records import write_currents

    stem = f"{season_stem(result.scenario.name, grid.season)}-currents"
    found: dict[str, Format] = {
        f"{stem}.nc": lambda result, path: write_currents(result, grid.season, path)
    }
    if fields_from(result, grid) is not None:
        found[f"{stem}.grb"] = lambda result, path: write_grib(result, grid.season, path)
    return found


def _season_formats(result: RunResult, season: Season) -> dict[str, Format]:
    """Return the files of one season for navigation devices, with the function that writes each."""
    from pipeline.formats.gis.geopackage import write_geojson
    from pipeline.formats.passage import missions, routes, rtz

    def of_season(writer: Callable[..., None], **options: object) -> Format:
        return lambda result, path: writer(result, season.name, path, **options)

    scenario, timed = result.scenario, {"departure": season.departure}
    stem = season_stem(scenario.name, season.name)
    sides = [one.metrics.main_passage for one in result.season_routes(season.name)]
    others: dict[str, Format] = {}
    if len(sides) > min(2, len(set(sides))):  # else the other file has every route
        others = {f"{stem}-all.gpx": of_season(routes.write_gpx, every=True, **timed)}
    return others | {
        f"{stem}.rtz": of_season(rtz.write_rtz, version=scenario.outputs.rtz_version, **timed),
        f"{stem}.gpx": of_season(routes.write_gpx, **timed),
        f"{stem}.geojson": of_season(write_geojson),
        f"{stem}.kml": of_season(routes.write_kml, **timed),
        f"{stem}.plan": of_season(missions.write_plan),
        f"{stem}.waypoints": of_season(missions.write_mission),
    }


def _haven_formats(result: RunResult, season: str) -> dict[str, Format]:
    """Return the files of a season's ways to havens; none without havens, or without a way."""
    from pipeline.findings.haven_rows import main_ways
    from pipeline.formats.passage import haven_routes

    coverage = result.coverages.get(season)
    if coverage is None or not coverage.diversions:
        return {}
    stem = f"{season_stem(result.scenario.name, season)}-haven"
    version = result.scenario.outputs.rtz_version

    def rtz(number: int) -> Format:
        return lambda result, path: haven_routes.write_haven_rtz(
            result, season, path, number=number, version=version
        )

    count = len(coverage.diversions)
    digits = len(str(count))
    names = [f"{stem}-{number:0{digits}d}" for number in range(1, count + 1)]
    return {
        f"{stem}s.gpx": lambda result, path: haven_routes.write_haven_gpx(result, season, path),
        f"{stem}s-missions.zip": lambda result, path: haven_routes.write_haven_missions(
            result, season, path, names=names
        ),
        **{f"{names[way.number - 1]}.rtz": rtz(way.number) for way in main_ways(result, season)},
    }


def _check_target(directory: Path, names: Sequence[str]) -> None:
    """Raise an error if the target is a file, has a folder in a file's place, or is in use.

    QGIS writes changes of an open GeoPackage to a journal beside it; SQLite would apply this
    journal to the new file.
    """
    if directory.exists() and not directory.is_dir():
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(directory))
    for name in names:
        if (directory / name).is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(directory / name))
    for journal in directory.glob("*.gpkg-wal"):
        if journal.stat().st_size:
            package = directory / journal.name.removesuffix("-wal")
            raise StageError(
                f"write: {package} is open in another program ({journal.name} lies beside it): "
                f"close it there, {_ELSEWHERE}"
            )


def _earlier_results(directory: Path) -> set[str]:
    """Return the names of an earlier run's files according to its manifest."""
    try:
        named = json.loads((directory / MANIFEST).read_bytes())["outputs"]
    except (OSError, ValueError, KeyError, TypeError):
        named = ()
    return {MANIFEST, *named}
