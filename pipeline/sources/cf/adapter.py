"""Currents, wind and waves from the user's own files: NetCDF or Zarr by the CF conventions, GRIB.

Only the steps that are needed are read, and only in the region. Each field is checked (speeds,
directions, gaps, position) in a wider window than the planner is given, as faults are easier to
detect there. The fields are read one after the other, as all of them would not fit in memory.

Two kinds of current are made of several: the mean of a forecast's members (files, folders, or
places along a dimension of them), and tidal streams by harmonic constants plus a residual current.
"""

import hashlib
import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from functools import lru_cache
from pathlib import Path
from typing import Self

import numpy as np
from shapely.geometry import Polygon

from pipeline._types import BoolArray
from pipeline.errors import RequestError, naming, refuse_any
from pipeline.geo.projection import MARGIN_CELLS, Bounds, common_bounds, widened
from pipeline.machine.paths import require_readable
from pipeline.machine.store import file_hash
from pipeline.model import Credit, CurrentGrid, Land, MemberGrid, Note
from pipeline.model.inputs import CurrentSource, Issue, bilinear
from pipeline.scenario.season import FILES, STILL, MembersSpec, Season, StreamConstants
from pipeline.sources import plausibility
from pipeline.sources.cf.contents import Contents, find_files, name_of, read_contents
from pipeline.sources.cf.dataset import fatal_files, is_zarr, open_dataset
from pipeline.sources.cf.fields import (
    FieldReader,
    Fills,
    SelectedSteps,
    coverage_faults,
    covered_bounds,
    filled_in_time,
    find_window,
    steps_of_season,
    stream_steps,
    weak_cells,
)
from pipeline.sources.current_field import Field, LandMask, water_without_data
from pipeline.sources.quantities import CURRENT, Quantity
from renew.vary.ensemble import FEWEST, QUANTILES

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

    They have the fields of time steps, or harmonic constants; `with_mean` adds the mean that the
    file of constants has. `index` is the name of a further dimension, and the only place along it
    that is read. `pair` names the variables that are the current; by default they are found. A
    `quantity` without a direction is the first component of what `current` returns.
    """

    paths: tuple[str, ...]
    with_mean: bool = True
    index: tuple[str, int] | None = None
    pair: tuple[str, str] | None = None
    quantity: Quantity = CURRENT

    def identity(self, case: Season) -> tuple[str, ...]:
        """Return hashes of the files that contain the case's steps; "nothing" without any."""
        try:
            contents, selected = self._selected(case)
        except (RequestError, ValueError):
            return ("nothing", *self.paths)
        hashes = (digest for _, digest in _file_hashes(contents, selected))
        about = f"{case.period.begin}" if case.is_changing else case.resolved_time_method
        mean = f"{self.with_mean}" if contents.constituents else ""
        at = "" if self.index is None else "{} {}".format(*self.index)
        pair = self.pair or (() if self.quantity.is_current else (self.quantity.name,))
        return ("cf", *hashes, case.valid, about, selected.valid, mean + at, *pair)

    def uncovered_reason(self, region: Polygon, case: Season) -> str:
        """Say why the files can't give the case's current; empty when they can."""
        try:
            contents = self.contents().on_axes(region.bounds)
        except RequestError as error:
            return "; ".join(error.faults)
        faults = coverage_faults(contents, region.bounds)
        try:
            steps_of_season(contents, case)
        except ValueError as error:
            faults.append(str(error))
        return f"{name_of(contents.files)}: {'; '.join(faults)}" if faults else ""

    def covered_bounds(self, region: Polygon, case: Season) -> Bounds | None:
        """Return the part that the files' grid covers."""
        del case
        try:
            return covered_bounds(self.contents().on_axes(region.bounds), region.bounds)
        except RequestError:
            return None

    def issue(self, case: Season) -> Issue:
        """Return the files' reference time, their first and last time step, and their hash."""
        del case
        contents = self.contents()
        moments = contents.steps.moments
        hashes = "".join(_hash(file, _stamp(file)) for file in contents.files)
        return Issue(
            contents.reference_time,
            moments[0] if moments else None,
            moments[-1] if moments else None,
            hashlib.sha256(hashes.encode()).hexdigest(),
        )

    def current(self, region: Polygon, case: Season, land: Land, folder: Path) -> CurrentGrid:
        """Read the region's part, checked against the land of the world in a wider window."""
        del land, folder
        try:
            contents, selected = self._selected(case)
        except ValueError as error:
            raise RequestError(f"{name_of(find_files(self.paths))}: {error}") from None
        contents = contents.on_axes(region.bounds)
        lon_deg, lat_deg = contents.largest_cell
        bounds = widened(region.bounds, MARGIN_CELLS * lon_deg, MARGIN_CELLS * lat_deg)
        if contents.constituents:
            selected = stream_steps(contents, case, bounds, with_mean=self.with_mean)
        field, notes = read_checked_fields(contents, selected, bounds, region)
        current = CurrentGrid(
            case=case.name,
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
            climatology_for=case.valid if selected.is_climatology else "",
        )
        # Only a climatology is noted here: which sources were passed over is not known yet.
        return replace(current, notes=(*current.notes, *current.stand_in_notes))

    def _selected(self, case: Season) -> tuple[Contents, SelectedSteps]:
        """Read the files' contents, and select the steps of the case's fields."""
        contents = self.contents()
        return contents, steps_of_season(contents, case, with_mean=self.with_mean)

    def contents(self) -> Contents:
        """Read the files' contents, again only when the files have changed."""
        files = find_files(self.paths)
        stamps = tuple(_stamp(file) for file in files)
        return _read_version(self, files, stamps)


def _file_hashes(contents: Contents, selected: SelectedSteps) -> tuple[tuple[str, str], ...]:
    """Return the name and hash of each file that contains selected steps."""
    steps = {step for weights in selected.weights for step in weights}
    components = {series[step][0] for series in (contents.u, contents.v) for step in steps}
    used = sorted({file for part in components for file in (part.file, *part.beside)})
    return tuple((file.name, _hash(file, _stamp(file))) for file in used)


@lru_cache(maxsize=4)
def _read_version(source: CfFiles, files: tuple[Path, ...], stamps: tuple[str, ...]) -> Contents:
    """Read the contents of a source's files with these stamps."""
    del stamps
    return read_contents(files, source.index, source.pair, source.quantity)


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


# Share of the region's open water without data above which a file is refused; smaller gaps are
# filled from the water around.
_GAP_FAULT_SHARE = 0.2
# Share of the cells far inland with data above which a shift of the field can't be detected.
_FILLED_LAND_SHARE = 0.5
# No current means "no data" if at least this share of the land has none,
_MIN_STILL_LAND_SHARE = 0.9
# and no more than this share of the open water: it may stand still.
_MAX_STILL_WATER_SHARE = 0.01


def read_checked_fields(
    contents: Contents,
    selected: SelectedSteps,
    bounds: Bounds,
    region: Polygon,
    fills: Fills | None = None,
) -> tuple[Field, tuple[Note, ...]]:
    """Read the fields of selected steps, check each in a wide window, and keep its part in bounds.

    Returns the fields of all times, and notes on them. Raises RequestError if the file is damaged,
    or its fields can't be currents of the region. `fills` are values that mean "no data".
    """
    name = name_of(contents.files)
    window = find_window(contents.lon, contents.lat, _check_bounds(contents, bounds))
    inside_x = (window.lon >= bounds[0]) & (window.lon <= bounds[2])
    inside_y = (window.lat >= bounds[1]) & (window.lat <= bounds[3])
    lon, lat = window.lon[inside_x], window.lat[inside_y]
    mask = LandMask.world()
    is_land = mask.on_grid(window.lon, window.lat)
    shores = (is_land, ~plausibility.dilated(is_land, plausibility.OFFSHORE_CELLS))
    kept: list[Field] = []
    try:
        with FieldReader(contents, window, shores, fills) as reader:
            first = reader.field(selected.weights[0])
            last = reader.field(selected.weights[-1]) if len(selected.weights) > 1 else first
            still, still_notes = _still_land((first, last), *shores)
            first = _without(first, still)

            def fields() -> Iterator[Field]:
                others = (_without(wide, still) for wide in reader.fields(selected.weights[1:]))
                for wide in itertools.chain([first], others):
                    part = np.ix_(inside_y, inside_x)
                    kept.append(Field(lon, lat, wide.u[part], wide.v[part]))
                    yield wide

            if contents.quantity.is_current:
                assessment = plausibility.assess_series(
                    fields(), selected.labels, mask, CURRENT.most
                )
            else:
                assessment = plausibility.assess_sizes(fields(), selected.labels, contents.quantity)
    except ValueError as error:
        raise RequestError(str(error)) from None
    # A value that was found late means no data at earlier steps, too.
    if len(reader.fills) > len(fills or {}):
        return read_checked_fields(contents, selected, bounds, region, reader.fills)
    u, v = (np.stack([getattr(field, part) for field in kept]) for part in "uv")
    fill_notes = [
        Note.of("fill-value", name=name, value=value, share=share)
        for (name, value), share in reader.fills.items()
    ]
    if not contents.quantity.is_current:
        return _weather(Field(lon, lat, u, v), assessment, name), (*still_notes, *fill_notes)
    field, gap_notes = filled_in_time(Field(lon, lat, u, v), selected.times_s)
    if reader.partly:
        gap_notes += (Note.of("current-means-lack", share=reader.partly),)
    # The gaps that count are those that are left.
    first = replace(first, u=first.u.copy(), v=first.v.copy())
    inside = np.ix_(inside_y, inside_x)
    first.u[inside], first.v[inside] = field.u[0], field.v[0]
    assessment += _assess_gaps(first, mask, region.bounds)
    if field.gap.all():
        assessment += plausibility.Assessment(("it has no data in the region",))
    if assessment.faults:
        reason = "; ".join(assessment.faults)
        raise RequestError(f"{name} is refused: {reason}; correct it, or give another file")
    notes = (
        *still_notes,
        *fill_notes,
        *gap_notes,
        *water_without_data(first, mask, region),
        *assessment.doubts(name),
    )
    return field, notes


def _weather(field: Field, assessment: plausibility.Assessment, name: str) -> Field:
    """Return a field (nt, ny, nx) of wind or waves without gaps; RequestError if it is refused.

    A gap, as on land, gets the largest values around it, ring by ring: a limit is not exceeded
    unseen beside it.
    """
    from scipy import ndimage

    if not assessment.faults and field.gap.all(axis=(1, 2)).any():
        assessment = plausibility.Assessment(("it has no data in the region at some of its times",))
    if assessment.faults:
        reason = "; ".join(assessment.faults)
        raise RequestError(f"{name} is refused: {reason}; correct it, or give another file")
    size, u, v = np.hypot(field.u, field.v), field.u.copy(), field.v.copy()
    while (gap := np.isnan(size)).any():
        known = np.where(gap, -1.0, size)
        around = ndimage.maximum_filter(known, size=(1, 3, 3), mode="nearest")
        ring = gap & (around >= 0)
        # Of the neighbours that hold the largest size, each has the components that go with it.
        for up, right in itertools.product((-1, 0, 1), repeat=2):
            there = np.roll(known, (up, right), (1, 2)) == around
            u[ring & there] = np.roll(u, (up, right), (1, 2))[ring & there]
            v[ring & there] = np.roll(v, (up, right), (1, 2))[ring & there]
        size = np.where(ring, around, size)
    return replace(field, u=u, v=v)


def _still_land(
    fields: Sequence[Field], is_land: BoolArray, water: BoolArray
) -> tuple[BoolArray, tuple[Note, ...]]:
    """Return the cells (ny, nx) without current in all fields, with a note, if they mean "no data".

    Then nearly all land has none. Turning water stands still in some fields only.
    """
    still = np.all([(field.u == 0) & (field.v == 0) for field in fields], axis=0)
    if (
        not (is_land.any() and water.any())
        or still[is_land].mean() < _MIN_STILL_LAND_SHARE
        or still[water].mean() > _MAX_STILL_WATER_SHARE
    ):
        return np.zeros_like(still), ()
    return still, (Note.of("filler-is-land"),)


def _without(field: Field, cells: BoolArray) -> Field:
    """Return a field with gaps in place of some cells (ny, nx)."""
    u, v = (np.where(cells, np.nan, part) for part in (field.u, field.v))
    return replace(field, u=u, v=v)


def _assess_gaps(field: Field, mask: LandMask, region: Bounds) -> plausibility.Assessment:
    """Assess whether the region's open water has data, and its land has none."""
    (gaps, water), (inland, dry) = plausibility.count_misplaced(field, mask, region)
    warnings: tuple[str, ...] = ()
    if inland > _FILLED_LAND_SHARE * max(dry, 1):
        warnings = ("it has data on land, so that a shift can't be detected",)
    share = gaps / max(water, 1)
    if share <= _GAP_FAULT_SHARE:
        return plausibility.Assessment((), warnings)
    message = f"{share:.0%} of the region's open water has no data, which is too much to fill"
    return plausibility.Assessment((message,), warnings)


# Least number of members that have a mean.
_LEAST = 2
# Largest number of members that are read.
_MOST = 200


@dataclass(frozen=True)
class CfMembers(CurrentSource):
    """Files whose fields are members; the case's current is their mean."""

    paths: tuple[str, ...]
    spec: MembersSpec
    pair: tuple[str, str] | None = None

    def identity(self, case: Season) -> tuple[str, ...]:
        """Return what each member depends on, and the weights."""
        try:
            members = self._members()
        except RequestError:
            return ("nothing", *self.paths)
        each = [part for _, source in members for part in source.identity(case)]
        return ("members", self.spec.along, str(self.spec.weights), *each)

    def uncovered_reason(self, region: Polygon, case: Season) -> str:
        """Say why the first member can't be used, or why there are no members."""
        try:
            return self._members()[0][1].uncovered_reason(region, case)
        except RequestError as error:
            return "; ".join(error.faults)

    def covered_bounds(self, region: Polygon, case: Season) -> Bounds | None:
        """Return the part that the first member covers."""
        try:
            return self._members()[0][1].covered_bounds(region, case)
        except RequestError:
            return None

    def issue(self, case: Season) -> Issue:
        """Return the first member's issue, with the hashes of all."""
        issues = [source.issue(case) for _, source in self._members()]
        return replace(issues[0], digest="".join(issue.digest for issue in issues))

    def current(self, region: Polygon, case: Season, land: Land, folder: Path) -> CurrentGrid:
        """Read each member, checked like any current, and take their mean.

        A member that is refused, or on other nodes or at other times than the first one that can be
        used, is left out, and a note names it.
        """
        used: list[tuple[str, CurrentGrid, float]] = []
        reasons: list[str] = []
        members = self._members()
        for (name, source), weight in zip(members, self._weights(len(members)), strict=True):
            try:
                grid = source.current(region, case, land, folder)
            except RequestError as error:
                reasons.append(f"{name}: {'; '.join(str(error).splitlines())}")
                continue
            if used and (differs := _difference(grid, used[0][1])):
                reasons.append(f"{name} has {differs} than {used[0][0]}")
                continue
            used.append((name, grid, weight))
        left_out = [Note.of("member-left-out", reason=reason) for reason in reasons]
        choose = self.spec.choose
        needed = FEWEST if choose in QUANTILES else _LEAST
        whose, remedy = "an ensemble has", "leave 'members' out"
        if choose in QUANTILES:
            whose, remedy = f"members.choose = {choose!r} needs", "choose by the mean"
        if len(used) < needed:
            few = f"{len(used)} of {len(members)} members can be used, and {whose} {needed}"
            raise RequestError("; ".join([*reasons, f"{few}; give more, or {remedy}"]))
        weights = np.array([weight for *_, weight in used])
        if (weights > 0).sum() < _LEAST:
            raise RequestError("members.weights leave less than two members; raise them")
        weights /= weights.sum()
        notes = dict.fromkeys(note for _, grid, _ in used for note in grid.notes)
        # A mean has no value where any member has none.
        return replace(
            used[0][1],
            u=np.tensordot(weights, np.array([grid.u for _, grid, _ in used]), axes=1),
            v=np.tensordot(weights, np.array([grid.v for _, grid, _ in used]), axes=1),
            members=tuple(
                MemberGrid(name, grid.u, grid.v, float(weight))
                for (name, grid, _), weight in zip(used, weights, strict=True)
            ),
            files=tuple(dict.fromkeys(file for _, grid, _ in used for file in grid.files)),
            notes=(*notes, *left_out),
        )

    def _members(self) -> list[tuple[str, CfFiles]]:
        """Return each member's name and source; RequestError where there are too few or many."""
        files = find_files(self.paths)
        if self.spec.along == FILES:
            differ = len({file.stem for file in files}) == len(files)
            members = [
                (file.stem if differ else file.name, CfFiles((str(file),), pair=self.pair))
                for file in files
            ]
            what = f"{len(members)} file{'s' * (len(members) != 1)}"
        else:
            along, size = self.spec.along, _size_along(files, self.spec.along)
            members = [
                (f"{along} {at}", CfFiles(self.paths, index=(along, at), pair=self.pair))
                for at in range(size)
            ]
            what = f"{size} along {along}"
        if not _LEAST <= len(members) <= _MOST:
            raise RequestError(f"members: {what}; there must be {_LEAST} to {_MOST}")
        return members

    def _weights(self, count: int) -> Sequence[float]:
        """Return a weight for each member; RequestError for another number of weights."""
        if not self.spec.weights:
            return [1.0] * count
        if len(self.spec.weights) != count:
            raise RequestError(
                f"members.weights has {len(self.spec.weights)} numbers for {count} members; give "
                "one for each, or leave them out"
            )
        return self.spec.weights


def _size_along(files: Sequence[Path], along: str) -> int:
    """Return the number of members along a dimension of the first file."""
    refuse_any([f"{file.name}: {fault}" for file, fault in fatal_files(files[:1]).items()])
    with naming(files[0].name), open_dataset(files[0]) as dataset:
        if along in dataset.sizes:
            return int(dataset.sizes[along])
        there = ", ".join(map(str, dataset.sizes))
    raise RequestError(
        f"{files[0].name} has no dimension {along!r} for members.along; it has {there}"
    )


def _difference(grid: CurrentGrid, first: CurrentGrid) -> str:
    """Say in what a member differs from the first one, so that they have no mean; or ""."""
    for name, what in (("lon", "other longitudes"), ("lat", "other latitudes")):
        if not np.array_equal(getattr(grid, name), getattr(first, name)):
            return what
    if not np.array_equal(grid.times_s, first.times_s):
        return "other times"
    return "" if grid.valid == first.valid else f"another time ({grid.valid}, not {first.valid})"


# Least time between a residual's steps: closer ones show the tide, which would count twice.
_LEAST_STEP = timedelta(hours=12)


@dataclass(frozen=True)
class TidalStreams(CfFiles):
    """Tidal streams of a file of harmonic constants, plus its mean, another current, or nothing."""

    residual: CfFiles | None = None

    @classmethod
    def of(cls, named: StreamConstants, pair: tuple[str, str] | None = None) -> Self:
        """Return the source that a scenario names; `pair` are the variables of the residual."""
        given = named.residual
        files = None if given is None or given == STILL else CfFiles(tuple(given), pair=pair)
        return cls((named.constants,), with_mean=given is None, residual=files)

    def identity(self, case: Season) -> tuple[str, ...]:
        """Return the hashes of the constants, and those of the residual."""
        own = super().identity(case)
        if self.residual is None:
            return own
        steady = self.residual.identity(_at_departure(case))
        return (*own, *self.residual.identity(case), *steady)

    def uncovered_reason(self, region: Polygon, case: Season) -> str:
        """Say why constants and residual can't give the case's current; empty when they can."""
        reasons = [super().uncovered_reason(region, case)]
        try:
            contents = self.contents()
            if not contents.constituents:
                lacking = "it has no harmonic constants (u_re, u_im, v_re, v_im)"
                remedy = "fit them with `renew tide fit`, or name the file itself in 'currents'"
                reasons = [f"{name_of(contents.files)}: {lacking}; {remedy}"]
            if self.residual is not None:
                reasons.append(_residual_fault(self.residual, region, case))
        except RequestError as error:
            reasons += error.faults
        return "; ".join(dict.fromkeys(filter(None, reasons)))

    def covered_bounds(self, region: Polygon, case: Season) -> Bounds | None:
        """Return the part that both the constants and the residual cover."""
        own = super().covered_bounds(region, case)
        if self.residual is None or own is None:
            return own
        other = self.residual.covered_bounds(region, case)
        return None if other is None else common_bounds(own, other)

    def issue(self, case: Season) -> Issue:
        """Return the issue of the residual, which is what changes, with both hashes."""
        own = super().issue(case)
        if self.residual is None:
            return own
        other = self.residual.issue(case)
        return replace(other, digest=f"{own.digest}{other.digest}")

    def current(self, region: Polygon, case: Season, land: Land, folder: Path) -> CurrentGrid:
        """Return the sum of both on the constants' grid, at the times of the streams' fields."""
        streams = super().current(region, case, land, folder)
        if self.residual is None:
            return streams
        if self.residual.uncovered_reason(region, case):
            case = _at_departure(case)
        return _sum(streams, self.residual.current(region, case, land, folder))


def _at_departure(case: Season) -> Season:
    """Return the case with the one field that is nearest to its departure."""
    valid = f"{case.first_departure:%Y-%m-%dT%H:%MZ}"
    return case.model_copy(update={"time_method": None, "valid": valid})


def _residual_fault(residual: CfFiles, region: Polygon, case: Season) -> str:
    """Say why files can't be a residual; empty when they can."""
    contents = residual.contents()
    name = f"residual {name_of(contents.files)}"
    if contents.constituents:
        return f"{name}: it has harmonic constants itself; give a current without tide"
    step = contents.steps.interval
    if step < _LEAST_STEP and "current-without-tide" not in {note.kind for note in contents.notes}:
        return (
            f"{name}: its steps are {step / timedelta(hours=1):g} hours apart and show the tide, "
            f"which would count twice; give daily means, residual = '{STILL}', or leave it out for "
            "the mean of the constants' file"
        )
    reason = residual.uncovered_reason(region, case)
    return reason and residual.uncovered_reason(region, _at_departure(case))


def _sum(streams: CurrentGrid, residual: CurrentGrid) -> CurrentGrid:
    """Add a residual, which is linear in time, to streams; the sum ends where the residual ends."""
    lonlat = np.stack(np.meshgrid(streams.lon, streams.lat), axis=-1)
    times = streams.times_s
    if residual.changes:
        times = times[: max(2, int(np.searchsorted(times, residual.times_s[-1], side="right")))]
    u, v = streams.u[: times.size].copy(), streams.v[: times.size].copy()
    # Each field of the residual has a weight in the time between the fields before and after it.
    for step, at_step in enumerate(np.eye(len(residual.times_s))):
        weight = np.interp(times, residual.times_s, at_step)
        flow = bilinear(residual, lonlat, step)
        for number in np.flatnonzero(weight):
            u[number] += weight[number] * flow[..., 0]
            v[number] += weight[number] * flow[..., 1]
    told = Note.of("streams-on-residual", source=residual.credit.name, valid=residual.valid)
    return replace(
        streams,
        u=u,
        v=v,
        times_s=times,
        credit=_both(streams.credit, residual.credit),
        notes=tuple(dict.fromkeys(itertools.chain(streams.notes, [told], residual.notes))),
        files=tuple(dict.fromkeys((*streams.files, *residual.files))),
    )


def _both(main: Credit, other: Credit) -> Credit:
    """Return the credit of two sources that are used together."""
    texts, licences = (
        "; ".join(dict.fromkeys(filter(None, pair)))
        for pair in ((main.text, other.text), (main.licence, other.licence))
    )
    return replace(main, text=texts, licence=licences)
