"""Last stage: write all files of a run, or leave the earlier files unchanged.

The files are written to a temporary folder, which then replaces the earlier one in a single step
(:mod:`pipeline.machine.files`).
"""

import contextlib
import errno
import importlib
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path

from pipeline.errors import Faults, StageError
from pipeline.findings.names import MANIFEST
from pipeline.findings.result import RunCase, RunResult
from pipeline.machine.files import replacing
from pipeline.machine.interpreters import seldom_collecting

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
    late: Faults | None = None,
) -> tuple[Path, ...]:
    """Write all output files of a run into `directory`, which is created if needed.

    A file that is in an earlier run's manifest and is not written by this run is removed, so that
    nobody sails an outdated route. Returns the files, the manifest last. Raises StageError if the
    files can't be written; earlier files are unchanged. The message has the remedy.

    `on_file` is called before each file is written, with its name and number: "report.html (3 of
    12)". `late` takes the unexpected errors of single files, which are left out; by default they
    are raised.
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
                with contextlib.nullcontext() if late is None else late.kept(f"writing {name}"):
                    writer(result, staging / name)
                    written.append(staging / name)
                if staging / name not in written:
                    (staging / name).unlink(missing_ok=True)
            write_manifest(result, staging / MANIFEST, written)
    except OSError as error:
        remedy = _REMEDIES.get(error.errno or 0) or f"{error.strerror or error}: resolve this"
        raise StageError(
            f"write: cannot write the results to {directory}: {remedy}, {_ELSEWHERE}"
        ) from error
    return (*(directory / path.name for path in written), directory / MANIFEST)


def load_libraries() -> None:
    """Import what writes files, and its libraries; it takes a second: call it before planning."""
    for name in ("gis.geopackage", "passage.routes", "report.page"):
        importlib.import_module(f"pipeline.formats.{name}")
    for name in ("geopandas", "netCDF4", "pyogrio"):
        importlib.import_module(name)


def formats_of(result: RunResult) -> dict[str, Format]:
    """Return the function that writes each file of a run, keyed by file name."""
    from pipeline.findings.choices import trade_offs
    from pipeline.formats import tables
    from pipeline.formats.gis.geopackage import write_geopackage
    from pipeline.formats.records import write_currents
    from pipeline.formats.report.page import write_report

    is_there = {
        "departures.csv": bool(result.departures),
        "ensemble.csv": any(one.ensemble for one in result.results),
        "havens.csv": bool(result.coverages),
        "trade-off.csv": bool(trade_offs(result)),
    }
    formats: dict[str, Format] = {
        "routes.gpkg": write_geopackage,
        "metrics.csv": tables.write_metrics,
        "scenario.toml": tables.write_scenario,
        **{name: tables.write_table for name, there in is_there.items() if there},
    }
    for case in result.cases:
        if case.grid is not None:  # a planar scenario has none: its current is a formula
            formats[f"{case.stem}-currents.nc"] = _of(write_currents, case)
        # A plane lies nowhere on earth: nobody can navigate by it.
        if case.routes and not result.scenario.is_planar:
            formats |= _case_formats(case) | _haven_formats(case)
    # Last, because it waits for the bounds on other sides.
    return {**formats, "report.html": write_report}


def _case_formats(case: RunCase) -> dict[str, Format]:
    """Return the files of one case for navigation devices, with the function that writes each."""
    from pipeline.formats.gis.geopackage import write_geojson
    from pipeline.formats.passage import missions, routes

    timed, stem = {"departure": case.spec.departure}, case.stem
    sides = [one.metrics.main_passage for one in case.followed]
    others: dict[str, Format] = {}
    if len(sides) > min(2, len(set(sides))):  # else the other file has all of them
        others = {f"{stem}-all.gpx": _of(routes.write_gpx, case, every=True, **timed)}
    return others | {
        f"{stem}.rtz": _of(routes.write_rtz, case, **timed),
        f"{stem}.gpx": _of(routes.write_gpx, case, **timed),
        f"{stem}.geojson": _of(write_geojson, case),
        f"{stem}.plan": _of(missions.write_plan, case),
        f"{stem}.waypoints": _of(missions.write_mission, case),
    }


def _haven_formats(case: RunCase) -> dict[str, Format]:
    """Return the files of a case's ways to havens; none without havens, or without a way."""
    from pipeline.formats.passage.missions import write_haven_gpx

    if case.coverage is None or not case.coverage.diversions:
        return {}
    return {f"{case.stem}-havens.gpx": _of(write_haven_gpx, case)}


def _of(writer: Callable[..., None], case: RunCase, **options: object) -> Format:
    """Return what writes a file of a case, by the case's name in the run that is written."""
    return lambda result, path: writer(result.case(case.name), path, **options)


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
