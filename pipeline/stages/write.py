"""The last stage: all files of a run appear together, or the earlier ones stay as they were.

Everything is written into a hidden folder beside the target, on the same disk. Only when all of
it is complete do the files take their places, one atomic rename each, the manifest last; should
one rename fail, those before it are taken back.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import re
import shutil
import tempfile
import time
import unicodedata
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.errors import StageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from pipeline.formats.shared.result import RunResult
    from pipeline.scenario.model import OutputOptions, Season

    Format = Callable[[RunResult, Path], None]

MANIFEST = "manifest.json"
_LONGEST_NAME = 80
_DEVICES = r"con|prn|aux|nul|com\d|lpt\d"
# A folder of a run that was killed; no run takes a day to write.
_LEFTOVER_AGE_S = 24 * 3600.0
_ELSEWHERE = "or choose another place with --output"
_REMEDIES = {
    errno.ENOSPC: "the disk is full: free some space",
    errno.EDQUOT: "the disk quota is used up: free some space",
    errno.EFBIG: "a file would be larger than the system allows: raise the limit (ulimit -f)",
    errno.EACCES: "no permission: change the folder's owner or mode",
    errno.EPERM: "no permission: change the folder's owner or mode",
    errno.EROFS: "the file system is read-only: mount it for writing",
    errno.EEXIST: "a file stands where a folder should: move it away",
    errno.ENOTDIR: "a file stands where a folder should: move it away",
    errno.EISDIR: "a folder stands where a file should: move it away",
    errno.ENAMETOOLONG: "the path is too long: choose a shorter one",
}


def write(result: RunResult, directory: Path) -> tuple[Path, ...]:
    """Write all output files of a run into `directory`, which is made where it is missing.

    Files that the manifest of an earlier run names, and this one doesn't write, are taken away:
    nobody should sail a route that is no longer planned.

    Parameters
    ----------
    result
        The run, planned and evaluated.
    directory
        The run's own folder; see `output_directory`.

    Returns
    -------
    tuple of Path
        The files, the manifest last.

    Raises
    ------
    StageError
        The files can't be written; the message names the place and the remedy, and the earlier
        files are whole.
    """
    from pipeline.formats.tables.manifest import write_manifest

    try:
        directory.mkdir(parents=True, exist_ok=True)
        _refuse_open_database(directory)
        _sweep(directory)
        with _workshop(directory) as workshop:
            fresh = []
            for name, writer in _formats(result).items():
                writer(result, workshop / name)
                fresh.append(workshop / name)
            write_manifest(result, workshop / MANIFEST, fresh)
            fresh.append(workshop / MANIFEST)
            _put_in_place(fresh, directory, workshop)
    except OSError as error:
        remedy = _REMEDIES.get(error.errno or 0) or f"{error.strerror or error}: see to it"
        raise StageError(
            f"write: cannot write the results to {directory}: {remedy}, {_ELSEWHERE}"
        ) from error
    return tuple(directory / path.name for path in fresh)


def output_directory(root: Path, name: str) -> Path:
    """Where the files of the scenario called `name` belong: one folder straight below `root`."""
    return root / safe_name(name)


def safe_name(name: str) -> str:
    """Turn any text into a file name that every system takes, different for different texts.

    Letters, digits, `.`, `_` and `-` stay, of any script; what had to change, or names a device on
    Windows, is told apart by a short hash. The result is at most 80 characters and 240 bytes.
    """
    normal = unicodedata.normalize("NFC", name)
    plain = re.sub(r"[^\w.-]+", "-", normal).strip("-.")[:_LONGEST_NAME]
    is_device = re.fullmatch(_DEVICES, plain.partition(".")[0], re.IGNORECASE)
    if plain and plain == name and len(plain.encode()) <= 240 and not is_device:
        return plain
    digest = hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()[:8]
    short = plain.encode()[:64].decode(errors="ignore").strip("-.")
    if is_device:
        return f"{digest}-{short}"
    return f"{short}-{digest}" if short else digest


def _formats(result: RunResult) -> dict[str, Format]:
    """The files of a run by name; what a format needs is imported only now."""
    from pipeline.formats import exchange
    from pipeline.formats.gis.geopackage import write_geopackage
    from pipeline.formats.report.page import write_report
    from pipeline.formats.tables.metrics import write_metrics
    from pipeline.formats.tables.netcdf import has_currents, write_currents

    formats: dict[str, Format] = {
        "routes.gpkg": write_geopackage,
        "metrics.csv": write_metrics,
        "report.html": write_report,
    }
    if has_currents(result):
        formats["currents.nc"] = write_currents
    if exchange.can_write(result):
        for season in result.scenario.seasons:
            if result.season_routes(season.name):
                formats |= _season_formats(season, result.scenario.outputs)
    return formats


def _season_formats(season: Season, options: OutputOptions) -> dict[str, Format]:
    """The files of a season that has routes, for chart plotters and the like."""
    from pipeline.formats.exchange.geojson import write_geojson
    from pipeline.formats.exchange.gpx import write_gpx
    from pipeline.formats.exchange.rtz import write_rtz

    name, departure, version = season.name, season.departure, options.rtz

    def rtz(result: RunResult, path: Path) -> None:
        write_rtz(result, name, path, version=version, departure=departure)

    def gpx(result: RunResult, path: Path) -> None:
        write_gpx(result, name, path, departure=departure)

    def geojson(result: RunResult, path: Path) -> None:
        write_geojson(result, name, path)

    stem = safe_name(name)
    return {f"{stem}.rtz": rtz, f"{stem}.gpx": gpx, f"{stem}.geojson": geojson}


def _refuse_open_database(directory: Path) -> None:
    """Refuse to slip a new GeoPackage under another program's journal.

    QGIS keeps changes beside the file until it closes it; SQLite would play them back into the
    new one.
    """
    for journal in directory.glob("*.gpkg-wal"):
        if journal.stat().st_size:
            package = directory / journal.name.removesuffix("-wal")
            raise StageError(
                f"write: {package} is open in another program ({journal.name} lies beside it): "
                "close it there, or choose another place with --output"
            )


def _sweep(directory: Path) -> None:
    """Remove what killed runs left behind, a day after."""
    for leftover in directory.parent.glob(f".{directory.name}.*.partial"):
        with contextlib.suppress(OSError):
            if time.time() - leftover.stat().st_mtime > _LEFTOVER_AGE_S:
                shutil.rmtree(leftover)


@contextlib.contextmanager
def _workshop(directory: Path) -> Iterator[Path]:
    """Make a hidden folder beside the target, on the same disk; it is gone at the end."""
    place = tempfile.mkdtemp(prefix=f".{directory.name}.", suffix=".partial", dir=directory.parent)
    try:
        yield Path(place)
    finally:
        shutil.rmtree(place, ignore_errors=True)


def _put_in_place(fresh: Sequence[Path], directory: Path, workshop: Path) -> None:
    """Move complete files into the directory, and stale ones out; on failure put back what was."""
    for path in fresh:
        _flush(path)
    kept = workshop / "earlier"
    kept.mkdir()
    stale = _stale({path.name for path in fresh}, directory)
    for name in [*(path.name for path in fresh), *stale]:
        if (directory / name).exists():
            _keep(directory / name, kept / name)
    changed: list[str] = []
    try:
        for path in fresh:
            path.replace(directory / path.name)
            changed.append(path.name)
        for name in stale:
            (directory / name).unlink()
            changed.append(name)
    except BaseException:
        for name in changed:
            if (kept / name).exists():
                (kept / name).replace(directory / name)
            else:
                (directory / name).unlink()
        raise


def _stale(fresh: set[str], directory: Path) -> list[str]:
    """Files in the directory that its manifest names as a run's own, and that have no successor."""
    try:
        named = json.loads((directory / MANIFEST).read_bytes())["outputs"]
    except (OSError, ValueError, KeyError, TypeError):
        return []
    return [
        path.name
        for path in directory.iterdir()
        if path.name in named and path.name not in fresh and path.is_file()
    ]


def _keep(earlier: Path, copy: Path) -> None:
    """Give an earlier file a second name, so that its first is never without a file."""
    try:
        os.link(earlier, copy)
    except OSError as error:
        if earlier.is_dir():
            raise IsADirectoryError(
                errno.EISDIR, os.strerror(errno.EISDIR), str(earlier)
            ) from error
        shutil.copy2(earlier, copy)


def _flush(path: Path) -> None:
    """Wait until a file is on the disk, so that its new name can't outlive its content."""
    with path.open("rb") as file:
        os.fsync(file.fileno())
