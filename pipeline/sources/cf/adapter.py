"""Currents from the user's own files: NetCDF or Zarr by the CF conventions, and GRIB.

Only the region's part of the steps needed is read. Each field is checked (speeds, directions, gaps,
position) in a wider window than the planner is given, as faults are easier to detect there. The
fields are read one after the other, as all of them would not fit in memory.
"""

import hashlib
import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from shapely.geometry import Polygon

from pipeline._types import BoolArray
from pipeline.errors import RequestError
from pipeline.geo.lonlat import MARGIN_CELLS, Bounds, widened
from pipeline.machine.paths import require_readable
from pipeline.machine.store import file_hash
from pipeline.model import Credit, CurrentGrid, Land, Note
from pipeline.model.inputs import CurrentSource, Issue
from pipeline.scenario.season import Season
from pipeline.sources.cf.contents import Contents, find_files, name_of, read_contents
from pipeline.sources.cf.dataset import is_zarr
from pipeline.sources.cf.fields import (
    FieldReader,
    SelectedSteps,
    coverage_faults,
    covered_bounds,
    find_window,
    steps_of_season,
    stream_steps,
    weak_cells,
)
from pipeline.sources.current_field import Field, LandMask, water_without_data
from pipeline.sources.plausibility import (
    OFFSHORE_CELLS,
    Assessment,
    assess_series,
    count_misplaced,
    dilated,
)

# Half the size of the window, in cells, in which a file is checked around the region's middle.
_CHECK_CELLS = 240
# Largest half of that window, degrees.
_MAX_CHECK_DEG = 75.0
# Latitude at which that window ends, degrees.
_MAX_CHECK_LATITUDE = 80.0
_DOI = re.compile(r"\b10\.\d{4,9}/[^\s,;\"'<>]+[\w/]")
# Length to which a title is cut, characters.
_MAX_NAME_LENGTH = 100
# Names of a Zarr store's metadata files.
_ZARR_METADATA = {"zarr.json", ".zgroup", ".zarray", ".zattrs", ".zmetadata"}


@dataclass(frozen=True)
class CfFiles(CurrentSource):
    """Files that belong together, given by paths and patterns.

    They have the fields of time steps, or harmonic constants; `with_mean` adds the mean of these.
    Of a further dimension, only one `index` is read: its name, and the place along it.
    """

    paths: tuple[str, ...]
    with_mean: bool = True
    index: tuple[str, int] | None = None

    def identity(self, season: Season) -> tuple[str, ...]:
        """Return hashes of the files that contain the season's steps; "nothing" without any."""
        try:
            contents, selected = self._selected(season)
        except (RequestError, ValueError):
            return ("nothing", *self.paths)
        hashes = (digest for _, digest in _file_hashes(contents, selected))
        about = f"{season.period.begin}" if season.is_changing else season.resolved_time_method
        mean = f"{self.with_mean}" if contents.constituents else ""
        at = "" if self.index is None else "{} {}".format(*self.index)
        return ("cf", *hashes, season.valid, about, selected.valid, mean + at)

    def uncovered_reason(self, region: Polygon, season: Season) -> str:
        """Say why the files can't give the season's current; empty when they can."""
        try:
            contents = self.contents()
        except RequestError as error:
            return "; ".join(error.faults)
        faults = coverage_faults(contents, region.bounds)
        try:
            steps_of_season(contents, season)
        except ValueError as error:
            faults.append(str(error))
        return f"{name_of(contents.files)}: {'; '.join(faults)}" if faults else ""

    def covered_bounds(self, region: Polygon, season: Season) -> Bounds | None:
        """Return the part that the files' grid covers."""
        del season
        try:
            return covered_bounds(self.contents(), region.bounds)
        except RequestError:
            return None

    def issue(self, season: Season) -> Issue:
        """Return the files' reference time, their first and last time step, and their hash."""
        del season
        contents = self.contents()
        moments = contents.steps.moments
        hashes = "".join(_hash(file, _stamp(file)) for file in contents.files)
        return Issue(
            contents.reference_time,
            moments[0] if moments else None,
            moments[-1] if moments else None,
            hashlib.sha256(hashes.encode()).hexdigest(),
        )

    def current(self, region: Polygon, season: Season, land: Land, folder: Path) -> CurrentGrid:
        """Read the region's part, checked against the land of the world in a wider window."""
        del land, folder
        try:
            contents, selected = self._selected(season)
        except ValueError as error:
            raise RequestError(f"{name_of(find_files(self.paths))}: {error}") from None
        lon_deg, lat_deg = contents.largest_cell
        bounds = widened(region.bounds, MARGIN_CELLS * lon_deg, MARGIN_CELLS * lat_deg)
        if contents.constituents:
            selected = stream_steps(contents, season, bounds, with_mean=self.with_mean)
        field, notes = read_checked_fields(contents, selected, bounds, region)
        current = CurrentGrid(
            case=season.name,
            lon=field.lon,
            lat=field.lat,
            u=field.u,
            v=field.v,
            times_s=np.array(selected.times_s),
            weak=weak_cells(contents, bounds) if contents.constituents else None,
            valid=selected.valid,
            credit=_credit(contents),
            notes=(*contents.notes, *selected.notes, *notes),
            files=_file_hashes(contents, selected),
            climatology_for=season.valid if selected.is_climatology else "",
        )
        # Only a climatology is noted here: which sources were passed over is not known yet.
        return replace(current, notes=(*current.notes, *current.stand_in_notes))

    def _selected(self, season: Season) -> tuple[Contents, SelectedSteps]:
        """Read the files' contents, and select the steps of the season's fields."""
        contents = self.contents()
        return contents, steps_of_season(contents, season, with_mean=self.with_mean)

    def contents(self) -> Contents:
        """Read the files' contents, again only when the files have changed."""
        files = find_files(self.paths)
        return _read_version(files, tuple(_stamp(file) for file in files), self.index)


def _file_hashes(contents: Contents, selected: SelectedSteps) -> tuple[tuple[str, str], ...]:
    """Return the name and hash of each file that contains selected steps."""
    steps = {step for weights in selected.weights for step in weights}
    used = sorted({series[step][0].file for series in (contents.u, contents.v) for step in steps})
    return tuple((file.name, _hash(file, _stamp(file))) for file in used)


@lru_cache(maxsize=4)
def _read_version(
    files: tuple[Path, ...], stamps: tuple[str, ...], index: tuple[str, int] | None
) -> Contents:
    """Read the contents of files with these stamps."""
    del stamps
    return read_contents(files, index)


def _stamp(file: Path) -> str:
    """Return the size and time of change; for a Zarr store, of each of its files.

    Any other folder is not looked through, and is refused when it is opened.
    """
    parts = [file]
    if is_zarr(file):
        parts = sorted(part for part in file.rglob("*") if not part.is_dir())
        require_readable((part for part in parts if not part.is_file()), file.name)
    return "\n".join(
        f"{part.relative_to(file)} {part.stat().st_size} {part.stat().st_mtime_ns}"
        for part in parts
    )


@lru_cache(maxsize=512)
def _hash(file: Path, stamp: str) -> str:
    """Return the SHA-256 of a file; for a Zarr store, of its stamp and its metadata.

    Of its chunks only name, size and time of change are hashed: a store may have terabytes.
    """
    if not file.is_dir():
        return file_hash(file)
    digest = hashlib.sha256(stamp.encode())
    for part in sorted(file.rglob("*")):
        if part.name in _ZARR_METADATA:
            digest.update(part.read_bytes())
    return digest.hexdigest()


def _check_bounds(contents: Contents, bounds: Bounds) -> Bounds:
    """Return bounds of the window in which a file is checked; they contain the bounds given."""
    west, south, east, north = bounds
    lon_half, lat_half = (
        min(_MAX_CHECK_DEG, _CHECK_CELLS * float(np.median(np.abs(np.diff(axis)))))
        for axis in (contents.lon, contents.lat)
    )
    lon, lat = (west + east) / 2, (south + north) / 2
    return (
        min(west, lon - lon_half),
        min(south, max(lat - lat_half, -_MAX_CHECK_LATITUDE)),
        max(east, lon + lon_half),
        max(north, min(lat + lat_half, _MAX_CHECK_LATITUDE)),
    )


def _credit(contents: Contents) -> Credit:
    """Return the credit from the files' global attributes."""
    given = {key.lower(): value for key, value in contents.attributes.items()}
    name = given.get("title") or f"{name_of(contents.files)}, user's file"
    text = [given[key] for key in ("title", "institution", "credit", "source") if given.get(key)]
    doi = _DOI.search(" ".join(given.get(k, "") for k in ("doi", "id", "references", "license")))
    references = given.get("references", "")
    address = references if references.startswith("http") else ""
    return Credit(
        name=name[:_MAX_NAME_LENGTH],
        kind="current",
        text="; ".join(dict.fromkeys(text)) or name,
        licence=given.get("license") or given.get("licence") or "",
        url=f"https://doi.org/{doi[0]}" if doi else address,
    )


# Speed limit, m/s: tides in the narrowest straits come near it, no water is faster.
_SPEED_LIMIT_M_S = 10.0
# Share of the region's open water without data above which a file is refused; smaller gaps are
# filled from the water around.
_GAP_FAULT_SHARE = 0.2
# If at least this share of the cells far inland has data, a shift of the field can't be detected.
_FILLED_LAND_SHARE = 0.5
# Zeros mean "no data" where at least this share of land is zero,
_MIN_ZERO_LAND_SHARE = 0.9
# and at most this share of water.
_MAX_ZERO_WATER_SHARE = 0.01


def read_checked_fields(
    contents: Contents, selected: SelectedSteps, bounds: Bounds, region: Polygon
) -> tuple[Field, tuple[Note, ...]]:
    """Read the fields of selected steps, check each in a wide window, and keep its part in bounds.

    Returns the fields of all times, and notes on them.

    Raises
    ------
    RequestError
        The file is damaged, or its fields can't be currents of the region.
    """
    name = name_of(contents.files)
    window = find_window(contents.lon, contents.lat, _check_bounds(contents, bounds))
    mask = LandMask.world()
    kept: list[Field] = []
    try:
        with FieldReader(contents, window) as reader:
            first = reader.field(selected.weights[0])
            last = reader.field(selected.weights[-1]) if len(selected.weights) > 1 else first
            zeros, zero_notes = _zeros_on_land((first, last), mask)
            first = _without(first, zeros)

            def fields() -> Iterator[Field]:
                others = (_without(wide, zeros) for wide in reader.fields(selected.weights[1:]))
                for wide in itertools.chain([first], others):
                    kept.append(_cropped(wide, bounds))
                    yield wide

            assessment = assess_series(fields(), selected.labels, mask, _SPEED_LIMIT_M_S)
    except ValueError as error:
        raise RequestError(str(error)) from None
    assessment += _assess_gaps(first, mask, region.bounds)
    if kept[0].gap.all():
        assessment += Assessment(("it has no data in the region",))
    if assessment.faults:
        reason = "; ".join(assessment.faults)
        raise RequestError(f"{name} is refused: {reason}; correct it, or give another file")
    u, v = (np.stack([getattr(field, part) for field in kept]) for part in "uv")
    notes = (
        *zero_notes,
        *water_without_data(first, mask, region),
        *assessment.doubts(name),
    )
    return Field(kept[0].lon, kept[0].lat, u, v), notes


def _cropped(field: Field, bounds: Bounds) -> Field:
    """Return the part of a field inside bounds."""
    west, south, east, north = bounds
    x = (field.lon >= west) & (field.lon <= east)
    y = (field.lat >= south) & (field.lat <= north)
    return Field(field.lon[x], field.lat[y], field.u[np.ix_(y, x)], field.v[np.ix_(y, x)])


def _zeros_on_land(
    fields: Sequence[Field], mask: LandMask
) -> tuple[BoolArray | None, tuple[Note, ...]]:
    """Return the cells (ny, nx) whose zeros stand for land, with a note; else None.

    As currents, these zeros would slow the water beside the land. A cell must be zero in several
    fields, because turning water stands still for a while.
    """
    zero = np.logical_and.reduce([(field.u == 0) & (field.v == 0) for field in fields])
    if not zero.any():
        return None, ()
    is_land = mask.on_grid(fields[0].lon, fields[0].lat)
    water = ~dilated(is_land, OFFSHORE_CELLS)
    if not is_land.any() or zero[is_land].mean() < _MIN_ZERO_LAND_SHARE or not water.any():
        return None, ()
    if zero[water].mean() > _MAX_ZERO_WATER_SHARE:
        return None, ()
    return zero, (Note.of("zeros-are-land"),)


def _without(field: Field, cells: BoolArray | None) -> Field:
    """Return a field with gaps in place of some cells (ny, nx)."""
    if cells is None:
        return field
    u, v = (np.where(cells, np.nan, part) for part in (field.u, field.v))
    return Field(field.lon, field.lat, u, v)


def _assess_gaps(field: Field, mask: LandMask, region: Bounds) -> Assessment:
    """Assess whether the region's open water has data, and its land has none."""
    (gaps, water), (inland, dry) = count_misplaced(field, mask, region)
    warnings: tuple[str, ...] = ()
    if inland > _FILLED_LAND_SHARE * max(dry, 1):
        warnings = ("it has data on land, so that a shift can't be detected",)
    share = gaps / max(water, 1)
    if share <= _GAP_FAULT_SHARE:
        return Assessment((), warnings)
    message = f"{share:.0%} of the region's open water has no data, which is too much to fill"
    return Assessment((message,), warnings)
