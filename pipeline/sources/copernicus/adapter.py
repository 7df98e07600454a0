"""Currents of the Copernicus Marine Service through its official client, unattended.

The client may hang, return None, leave partial files behind, put gaps in place of data that do not
arrive, and read naive times as local ones (all of this was seen). So a download is a subprocess
with a deadline, the whole call is repeated on failure, the request is strict and in UTC, and a file
is used only after an acceptance check.

A chunk that fails to download arrives as NaN without an error, a truncated file may still open, and
a field shifted by half a degree looks like any other. So the axes are compared with the request,
the speeds with the sea's, and the gaps with the land and between time steps.
"""

import contextlib
import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from shapely.geometry import Polygon

from pipeline._types import DataArray, Dataset, FloatArray
from pipeline.errors import StageError, naming
from pipeline.geo import projection
from pipeline.model import Credit, CurrentGrid, Land, Note
from pipeline.model.inputs import CurrentSource, Issue
from pipeline.scenario.catalogue import CopernicusSpec
from pipeline.scenario.season import Season
from pipeline.sources.cf.axes import SURFACE_DEPTH_M, TimeSteps, coordinate_axis, decoded_times
from pipeline.sources.cf.dataset import coordinate_values, open_dataset, reading
from pipeline.sources.cf.fields import SelectedSteps, Window, find_window
from pipeline.sources.copernicus import download
from pipeline.sources.copernicus.client import LOGIN, around_missing, has_account
from pipeline.sources.copernicus.download import SubsetRequest
from pipeline.sources.current_field import Field, LandMask, water_without_data
from pipeline.sources.plausibility import assess_series, count_misplaced, dilated


@dataclass(frozen=True)
class Copernicus(CurrentSource):
    """One dataset of the service."""

    spec: CopernicusSpec

    def needs_network(self, region: Polygon, case: Season, folder: Path) -> bool:
        """Whether the case's file is not in the cache."""
        asked = self.asked(region, case)
        return self._fresh_metadata(asked, self.cached_file(asked, case, folder)) is None

    def identity(self, case: Season) -> tuple[str, ...]:
        """Return dataset, version and time; and today's date while the data may still change."""
        now = datetime.now(UTC)
        try:
            is_settled = self._is_settled(self._select(case)[0], now)
        except ValueError:
            is_settled = True  # there are no data, as `uncovered_reason` says
        return (
            self.spec.name,
            self.spec.model_dump_json(),
            _asked_time(case),
            case.resolved_time_method,
            "" if is_settled else now.date().isoformat(),
        )

    def unavailable_reason(self) -> str:
        """Say that an account is missing, or return ""."""
        if has_account():
            return ""
        return f"{self.spec.name} needs a free Copernicus Marine account: set {LOGIN} once"

    def uncovered_reason(self, region: Polygon, case: Season) -> str:
        """Say which part of the region or of the time lies outside the dataset."""
        spec = self.spec
        remedy = "name another source in 'currents'"
        (west, south, east, north), (lowest, highest) = region.bounds, spec.latitudes
        if south < lowest or north > highest:
            return (
                f"{spec.name} covers {lowest:g} to {highest:g} degrees north, the region reaches "
                f"from {south:g} to {north:g}; shrink the region or {remedy}"
            )
        margin = projection.MARGIN_CELLS * spec.cell_deg
        if not spec.across_180 and (west - margin + 180) // 360 != (east + margin + 180) // 360:
            return (
                f"{spec.name} can't be requested across 180 degrees, and the region reaches from "
                f"{west:g} to {east:g}; move the region or {remedy}"
            )
        try:
            steps, _ = self._select(case)
        except ValueError as error:
            return f"{spec.name}, asked for {_asked_time(case)}, {error}; {remedy}"
        if not self._may_cover(steps, changes=case.is_changing):
            return f"{spec.name} covers {spec.covers}, not {_asked_time(case)}; {remedy}"
        return ""

    def covered_bounds(self, region: Polygon, case: Season) -> projection.Bounds | None:
        """Return the part between the dataset's southern and northern limit."""
        del case
        west, south, east, north = region.bounds
        lowest, highest = self.spec.latitudes
        return projection.common_bounds((west, south, east, north), (west, lowest, east, highest))

    def issue(self, case: Season) -> Issue:
        """Ask for the dataset's last step; the first of use is `days_ahead` days before it."""
        del case
        last, version_label = download.last_step(self.spec)
        first = last - timedelta(days=self.spec.days_ahead)
        digest = hashlib.sha256(f"{self.spec.dataset} {version_label} {last}".encode()).hexdigest()
        return Issue(None, first, last, digest)

    def current(self, region: Polygon, case: Season, land: Land, folder: Path) -> CurrentGrid:
        """Read the file from the cache, or download, check and cache it."""
        asked = self.asked(region, case)
        cached = self.cached_file(asked, case, folder)

        def check(file: Path, metadata: Mapping[str, Any]) -> Accepted:
            return accept(file, _obtained(asked, metadata), metadata["missing_boxes"], land)

        accepted, metadata = None, self._fresh_metadata(asked, cached)
        if metadata is not None:
            # A file from the cache may fail checks that were added since: it is downloaded again.
            with contextlib.suppress(StageError):
                accepted = check(cached, metadata)
        if accepted is None or metadata is None:
            with download.staging_folder(folder) as staging:
                staged = staging / cached.name

                def check_answer(answer: dict[str, Any]) -> tuple[Accepted, dict[str, Any]]:
                    metadata = self._metadata(asked, answer)
                    return check(staged, metadata), metadata

                accepted, metadata = download.download(asked, staged, check_answer)
                metadata = download.save(staged, cached, metadata)
        field, notes = accepted
        obtained = _obtained(asked, metadata)
        if obtained.changes and self.spec.kind == "mean" and self.spec.step in {"day", "month"}:
            # Steps so long can't show the tide.
            notes = (Note.of("steps-are-means", step=self.spec.step), *notes)
        labels, moments = obtained.steps.labels, obtained.steps.moments
        # A single step's own time may only be near the one asked for.
        valid = case.valid if len(labels) > 1 else labels[0]
        if obtained.changes:
            valid = f"{moments[0]:%Y-%m-%dT%H:%MZ}/{moments[-1]:%Y-%m-%dT%H:%MZ}"
        elif self.spec.kind == "climatology":
            valid = f"month {labels[0]} of the mean year"
        return CurrentGrid(
            case=case.name,
            lon=field.lon,
            lat=field.lat,
            u=field.u,
            v=field.v,
            times_s=np.array(obtained.selected.times_s),
            valid=valid,
            credit=Credit(
                name=f"{self.spec.product}, {self.spec.dataset} {metadata['version']}",
                kind="current",
                text=self.spec.credit,
                licence=self.spec.licence,
                url=self.spec.url,
                retrieved=metadata["retrieved_utc"],
            ),
            notes=notes,
            files=((cached.name, metadata["sha256"]),),
        )

    def asked(self, region: Polygon, case: Season) -> SubsetRequest:
        """Return the request for a case; ValueError where the dataset can't have its steps."""
        return SubsetRequest(self.spec, region, *self._select(case))

    def cached_file(self, asked: SubsetRequest, case: Season, folder: Path) -> Path:
        """Return the path of the case's file in the cache, whether it is there or not."""
        labels = asked.steps.labels
        valid = case.valid.replace(":", "") or f"{labels[0]}_{labels[-1]}"
        fingerprint = hashlib.sha256(json.dumps(asked.record).encode()).hexdigest()[:12]
        return folder / f"{self.spec.dataset}_{valid}_{fingerprint}.nc"

    def _select(self, case: Season) -> tuple[TimeSteps, SelectedSteps]:
        """Select the time steps of the case's fields; ValueError where there can be none."""
        method = "changing" if case.is_changing else case.resolved_time_method
        return download.select(self.spec, case.period, method)

    def _may_cover(self, steps: TimeSteps, *, changes: bool) -> bool:
        """Whether the dataset may have the steps; if in doubt, the service is asked."""
        if self.spec.kind == "climatology":
            return True
        today = datetime.now(UTC).replace(hour=0, minute=0, second=0, microsecond=0)
        last = today + timedelta(days=self.spec.days_ahead + 1)
        first = datetime.fromisoformat(self.spec.first_day).replace(tzinfo=UTC)
        begin, _ = download.step_ends(self.spec, steps.moments[0])
        # A current that changes must have the steps around the departure; a short voyage needs no
        # more.
        end = download.step_ends(self.spec, steps.moments[0 if changes else -1])[1]
        return first <= begin and end <= last

    def _is_settled(self, steps: TimeSteps, moment: datetime) -> bool:
        """Whether the data of some steps were final at a moment."""
        if self.spec.kind == "climatology":
            return True
        _, end = download.step_ends(self.spec, steps.moments[-1])
        return moment >= end + timedelta(days=self.spec.settles_after_days)

    def _fresh_metadata(self, asked: SubsetRequest, cached: Path) -> dict[str, Any] | None:
        """Return the sidecar of a cached file that is valid and not out of date; else None."""
        metadata = download.cached_metadata(cached, asked.record)
        if metadata is None:
            return None
        retrieved = datetime.fromisoformat(metadata["retrieved_utc"])
        is_of_today = retrieved.date() == datetime.now(UTC).date()
        return metadata if is_of_today or self._is_settled(asked.steps, retrieved) else None

    def _metadata(self, asked: SubsetRequest, answer: dict[str, Any]) -> dict[str, Any]:
        """Return what a file's sidecar says: its content and origin, but no credentials."""
        return {
            "source": self.spec.name,
            "product": self.spec.product,
            "dataset": self.spec.dataset,
            "version": answer["version"],
            "part": answer["part"],
            "doi": self.spec.doi,
            "credit": self.spec.credit,
            "client": f"copernicusmarine {version('copernicusmarine')}",
            "request": asked.record,
            "stamps_utc": answer["stamps"],
            "missing_boxes": answer["missing_boxes"],
        }


def _obtained(asked: SubsetRequest, metadata: Mapping[str, Any]) -> SubsetRequest:
    """Return the part of a request that a file has, by its sidecar."""
    return asked.until(datetime.fromisoformat(metadata["stamps_utc"][-1]))


def _asked_time(case: Season) -> str:
    """Spell the time that a case asks for: of its one field, or from its departure on."""
    if not case.is_changing:
        return case.valid
    ends = (f"{end:%Y-%m-%dT%H:%MZ}" for end in (case.period.begin, case.period.end))
    return "/".join(dict.fromkeys(ends))


_UNITS = {"m s-1", "m/s", "m.s-1", "m s**-1", "m s^-1", "meter second-1", "metre second-1"}
_STANDARD_NAMES = {
    "eastward": ("eastward", "_x_velocity"),
    "northward": ("northward", "_y_velocity"),
}
# Deviation of an axis's steps from the cell size, as a share of it, that rounding to float32 may
# cause: 6e-6 degrees at 122 degrees.
_STEP_TOLERANCE = 1e-3
# A cell is a spike, as by a flipped bit, if it differs from all its neighbours by more than this
# speed, and by more than _SPIKE_RATIO times the differences among them. None of 1.7 million cells
# of real fields (GLO12, DUACS, OCM at 1, 1/4 and 1/10 degree) is above both 0.2 m/s and 3 times.
_SPIKE_M_S = 0.3
# Multiple of the differences among the neighbours, see above.
_SPIKE_RATIO = 4.0
# Share of the speed limit by which a spike differs from all its neighbours whatever these are; no
# cell of the real fields differs by 0.6 m/s.
_SPIKE_SHARE = 0.25
# Least number of neighbours with data that a cell is compared with.
_MIN_NEIGHBOURS = 5
# Largest share of open water without data, and of cells far inland with data: models leave out
# straits and shallows.
_MAX_MISPLACED_SHARE = 0.02
# Dimensions of the service's files along the axes.
_DIMS = ("latitude", "longitude")
# Number of cells that are kept around the region.
_KEPT_CELLS = 5


Accepted: TypeAlias = tuple[Field, tuple[Note, ...]]
"""Fields of all times, with the same gaps, and suspicions that do not suffice to refuse them."""


def accept(
    path: Path, asked: SubsetRequest, missing_boxes: Sequence[projection.Bounds], land: Land
) -> Accepted:
    """Read a NetCDF file and return its fields, or refuse it with all reasons.

    `missing_boxes` hold the centres of the cells for which the service has no chunk, which should
    be land. Raises StageError if the file can't be read, or does not have the requested content.
    """
    with naming(path.name, StageError), open_dataset(path) as dataset, reading():
        faults, field = _read(dataset, asked)
    notes: tuple[Note, ...] = ()
    if field is not None:
        mask = LandMask.of(land.polygons, asked.region.bounds)
        each = [Field(field.lon, field.lat, u, v) for u, v in zip(field.u, field.v, strict=True)]
        missing = _missing_chunk_faults(each[0], asked, missing_boxes, mask)
        faults = missing + faults + _gap_faults(each[0], mask)
        if not faults:
            labels = asked.steps.labels[: len(each)]
            assessment = assess_series(each, labels, mask, asked.spec.speed_limit_m_s)
            faults = list(assessment.faults)
            notes = (
                *assessment.doubts(asked.spec.dataset),
                *water_without_data(each[0], mask, asked.region),
            )
    if faults or field is None:
        raise StageError(f"{path.name} is not what was requested: {'; '.join(faults)}")
    return field, notes


def _read(dataset: Dataset, asked: SubsetRequest) -> tuple[list[str], Field | None]:
    """Read axes and fields, with the faults of both; no fields where the axes are wrong."""
    wanted = {"eastward": asked.spec.eastward, "northward": asked.spec.northward}
    needed = (*wanted.values(), "longitude", "latitude", "time")
    if absent := [name for name in needed if name not in dataset.variables]:
        return [f"no variable {name!r}" for name in absent], None
    lon = coordinate_axis(dataset, "longitude", period=360.0)
    lat = coordinate_axis(dataset, "latitude")
    faults = [
        *(
            fault
            for direction, name in wanted.items()
            for fault in _variable_faults(dataset[name], direction)
        ),
        *_step_faults("longitude", lon, asked.spec.cell_deg),
        *_step_faults("latitude", lat, asked.spec.cell_deg),
        *_time_faults(dataset, asked),
        *_depth_faults(dataset),
    ]
    if faults:
        return faults, None
    margin = _KEPT_CELLS * asked.spec.cell_deg
    window = find_window(lon, lat, projection.widened(asked.region.bounds, margin, margin))
    if not (window.lon.size and window.lat.size):
        return ["it has no data in the region"], None
    faults, u, v = _read_fields(dataset, asked, window)
    cell_deg = asked.spec.cell_deg
    cells = projection.cell_bounds(window.lon, window.lat, (cell_deg, cell_deg))
    if lacking := projection.sides_beyond(asked.region.bounds, cells):
        faults.append(f"it has no data {' nor '.join(lacking)}")
    return faults, Field(window.lon, window.lat, u, v)


def _read_fields(
    dataset: Dataset, asked: SubsetRequest, window: Window
) -> tuple[list[str], FloatArray, FloatArray]:
    """Return the first faulty step's faults, and both components of the fields (nt, ny, nx).

    Steps are read one by one: a month of hours need not fit in memory if its mean is the field.
    """
    shape = (window.lat.size, window.lon.size)
    weights, labels = asked.selected.weights, asked.steps.labels
    u_fields, v_fields = (np.zeros((len(weights), *shape)) for _ in "uv")
    first_gap, fastest_m_s = None, asked.spec.speed_limit_m_s
    for step, label in enumerate(labels):
        u, v = (
            window.read(dataset.variables[name].isel(time=step), _DIMS).reshape(shape)
            for name in (asked.spec.eastward, asked.spec.northward)
        )
        gap = ~np.isfinite(u)
        first_gap = gap if first_gap is None else first_gap
        faults = []
        if (gap == np.isfinite(v)).any():
            faults.append("one component has gaps where the other has none")
        if not asked.spec.gaps_vary and (changed := int((gap != first_gap).sum())):
            faults.append(
                f"{changed} cells have gaps either at {label} or at {labels[0]}, not at "
                "both: a part was not delivered"
            )
        strongest = float(np.max(np.hypot(u, v), initial=0.0, where=np.isfinite(u * v)))
        if strongest > fastest_m_s:
            faults.append(
                f"at {label} speeds reach {strongest:.3g} m/s, above {fastest_m_s:g}: another "
                "unit, or damaged"
            )
        limit_m_s = _SPIKE_SHARE * fastest_m_s
        if spike := max(largest_spike(u, limit_m_s), largest_spike(v, limit_m_s)):
            faults.append(
                f"at {label} a cell stands out from its neighbours by {spike:.3g} m/s: damaged"
            )
        if faults:
            return faults, u[None], v[None]
        for field, shares in enumerate(weights):
            if step in shares:
                u_fields[field] += shares[step] * u
                v_fields[field] += shares[step] * v
    # In fields that change, a gap at one time becomes a gap at all times, as it does in a mean.
    gap = np.logical_not(np.isfinite(u_fields).all(axis=0))
    u_fields[:, gap] = v_fields[:, gap] = np.nan
    return [], u_fields, v_fields


def largest_spike(values: FloatArray, limit_m_s: float) -> float:
    """Return how far any cell stands out from all its neighbours, m/s; 0 within the limits."""
    from scipy.ndimage import convolve, maximum_filter

    neighbours = np.ones((3, 3), dtype=int)
    neighbours[1, 1] = 0
    known = np.isfinite(values)
    counts = convolve(known.astype(int), neighbours, mode="constant")
    is_judged = known & (counts >= _MIN_NEIGHBOURS)

    def highest_neighbour(values: FloatArray) -> FloatArray:
        filled = np.where(known, values, -np.inf)
        highest = maximum_filter(filled, footprint=neighbours, mode="constant", cval=-np.inf)
        return np.asarray(highest, dtype=float)

    highest, negated_lowest = highest_neighbour(values), highest_neighbour(-values)
    spike = np.maximum(values - highest, -values - negated_lowest)
    allowed = np.maximum(_SPIKE_M_S, _SPIKE_RATIO * (highest + negated_lowest))
    is_spike = is_judged & (spike > np.minimum(allowed, limit_m_s))
    return float(np.max(spike, initial=0.0, where=is_spike))


def _variable_faults(variable: DataArray, direction: str) -> Iterator[str]:
    """Say if a component has a wrong unit or standard name."""
    units = variable.attrs.get("units", "")
    if units.strip() not in _UNITS:
        yield f"{variable.name} is in {units!r}, not m/s"
    standard = variable.attrs.get("standard_name", "")
    if standard and not any(part in standard for part in _STANDARD_NAMES[direction]):
        yield f"{variable.name} is {standard!r}, not the {direction} velocity"


def _step_faults(name: str, axis: FloatArray, cell_deg: float) -> Iterator[str]:
    """Find steps of an axis that are not of a cell's size."""
    steps = np.abs(np.diff(axis))
    if np.abs(steps - cell_deg).max() > _STEP_TOLERANCE * cell_deg:
        yield f"{name} steps by {steps.min():.5g} to {steps.max():.5g} degrees, not {cell_deg:.5g}"


def _time_faults(dataset: Dataset, asked: SubsetRequest) -> list[str]:
    """Find whether the file lacks time steps, or has others than requested."""
    time, values = dataset["time"], coordinate_values(dataset, "time").reshape(-1)
    stamps = decoded_times(time, values, time.attrs.get("units", ""))
    form, wanted = download.label_format(asked.spec), asked.steps.labels
    labels = tuple(stamp.strftime(form) for stamp in stamps)
    if labels == wanted:
        return []
    lacking = [label for label in wanted if label not in labels]
    first = f"; {lacking[0]} is missing{around_missing(labels, lacking[0])}" if lacking else ""
    return [f"its times are {_shortened(labels)}, not {_shortened(wanted)}{first}"]


def _shortened(labels: tuple[str, ...]) -> str:
    """List labels, but only the first and the last where there are many."""
    if len(labels) <= 3:
        return str(list(labels))
    return f"[{labels[0]!r} … {labels[-1]!r}] ({len(labels)})"


def _depth_faults(dataset: Dataset) -> list[str]:
    """Find levels other than one at the surface."""
    for name in {"depth", "elevation"} & dataset.variables.keys():
        levels = np.abs(coordinate_values(dataset, name).reshape(-1))
        if levels.size != 1 or not levels[0] < SURFACE_DEPTH_M:
            return [f"its levels are {levels[:4].tolist()} m, not the surface alone"]
    return []


def _gap_faults(field: Field, mask: LandMask) -> list[str]:
    """Find gaps in open water, and data far inland."""
    messages = (
        "in open water have no data: a part was not delivered",
        "far inland have data: the field is shifted",
    )
    return [
        f"{wrong} of {cells} cells {message}"
        for (wrong, cells), message in zip(count_misplaced(field, mask), messages, strict=True)
        if wrong > _MAX_MISPLACED_SHARE * max(cells, 1)
    ]


def _missing_chunk_faults(
    field: Field, asked: SubsetRequest, boxes: Sequence[projection.Bounds], mask: LandMask
) -> list[str]:
    """Find water in chunks that the service does not have.

    The service stores no chunk that is all gaps, and answers in the same way where it fails to
    deliver one. Cells beside land may be land to a coarse model; there the gap is filled from the
    water beside it anyway.
    """
    if not boxes:
        return []
    cell = asked.spec.cell_deg
    missing = np.zeros(field.u.shape, dtype=bool)
    for west, south, east, north in boxes:
        # Eastward from the box's west edge: the field may lie whole turns away from the box.
        column = (field.lon - west + cell / 2) % 360 <= east - west + cell
        row = (field.lat >= south - cell / 2) & (field.lat <= north + cell / 2)
        missing |= row[:, None] & column[None, :]
    # Beyond one cell around the region the field is not used, and the land is not known.
    west, south, east, north = projection.widened(asked.region.bounds, cell, cell)
    column = (field.lon > west) & (field.lon < east)
    row = (field.lat > south) & (field.lat < north)
    wet = missing & row[:, None] & column[None, :]
    wet &= ~dilated(mask.on_grid(field.lon, field.lat), 1, edge_counts=False)
    if not wet.any():
        return []
    return [
        f"the service had no data for {int(wet.sum())} cells of water: a part was not delivered"
    ]
