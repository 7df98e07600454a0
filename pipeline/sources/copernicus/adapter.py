"""Currents of the Copernicus Marine Service through its official client, unattended.

The client may hang, return None, leave partial files behind, put gaps in place of data that do not
arrive, and read naive times as local ones (all of this was seen). So a download is a subprocess
with a deadline, the whole call is repeated on failure, the request is strict and in UTC, and a file
is used only after the `acceptance` check.
"""

import contextlib
import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from shapely.geometry import Polygon

from pipeline._types import FloatArray
from pipeline.errors import StageError
from pipeline.geo.lonlat import MARGIN_CELLS, Bounds, common_bounds, widened
from pipeline.model import Credit, CurrentGrid, Land, Note
from pipeline.model.inputs import CurrentSource, Issue
from pipeline.scenario.catalogue import CopernicusSpec
from pipeline.scenario.season import Season
from pipeline.sources.copernicus.acceptance import AcceptedFields, Expected, accept
from pipeline.sources.copernicus.client import LOGIN, has_account
from pipeline.sources.copernicus.download import (
    CachedDownload,
    SelectedSteps,
    TimeResolution,
    download,
    last_step,
    select_all_steps,
    select_steps,
)


@dataclass(frozen=True, slots=True)
class _Request:
    """The data of a season: the client's arguments, the dataset's version, and the time steps."""

    arguments: dict[str, Any]
    version: str
    steps: SelectedSteps

    @property
    def record(self) -> dict[str, Any]:
        """The request as the sidecar has it."""
        return {**self.arguments, "version": self.version, "times": list(self.steps.labels)}


@dataclass(frozen=True)
class Copernicus(CurrentSource):
    """One dataset of the service."""

    spec: CopernicusSpec

    def needs_network(self, region: Polygon, season: Season, folder: Path) -> bool:
        """Whether the season's file is not in the cache."""
        request = self._request(region, season)
        cached = self.cached_download(region, season, folder)
        return self._fresh_metadata(request, cached) is None

    def identity(self, season: Season) -> tuple[str, ...]:
        """Return dataset, version and time; and today's date while the data may still change."""
        now = datetime.now(UTC)
        try:
            is_settled = self._is_settled(self.select_steps(season), now)
        except ValueError:
            is_settled = True  # there are no data, as `uncovered_reason` says
        return (
            self.spec.name,
            self.spec.model_dump_json(),
            _asked_time(season),
            season.resolved_time_method,
            "" if is_settled else now.date().isoformat(),
        )

    def unavailable_reason(self) -> str:
        """Say that an account is missing, or return ""."""
        if has_account():
            return ""
        return f"{self.spec.name} needs a free Copernicus Marine account: set {LOGIN} once"

    def uncovered_reason(self, region: Polygon, season: Season) -> str:
        """Say which part of the region or of the time lies outside the dataset."""
        spec = self.spec
        remedy = "name another source in 'currents'"
        (west, south, east, north), (lowest, highest) = region.bounds, spec.latitudes
        if south < lowest or north > highest:
            return (
                f"{spec.name} covers {lowest:g} to {highest:g} degrees north, the region reaches "
                f"from {south:g} to {north:g}; shrink the region or {remedy}"
            )
        margin = self._margin_deg
        if not spec.across_180 and (west - margin + 180) // 360 != (east + margin + 180) // 360:
            return (
                f"{spec.name} can't be requested across 180 degrees, and the region reaches from "
                f"{west:g} to {east:g}; move the region or {remedy}"
            )
        try:
            steps = self.select_steps(season)
        except ValueError as error:
            return f"{spec.name}, asked for {_asked_time(season)}, {error}; {remedy}"
        if not self._may_cover(steps):
            return f"{spec.name} covers {spec.covers}, not {_asked_time(season)}; {remedy}"
        return ""

    def covered_bounds(self, region: Polygon, season: Season) -> Bounds | None:
        """Return the part between the dataset's southern and northern limit."""
        del season
        west, south, east, north = region.bounds
        lowest, highest = self.spec.latitudes
        return common_bounds((west, south, east, north), (west, lowest, east, highest))

    def issue(self, season: Season) -> Issue:
        """Ask for the dataset's last step; a forecast is of use for `days_ahead` before it."""
        del season
        last, version_label = last_step(self.spec)
        first = last - timedelta(days=self.spec.days_ahead)
        digest = hashlib.sha256(f"{self.spec.dataset} {version_label} {last}".encode()).hexdigest()
        return Issue(None, first, last, digest)

    def current(self, region: Polygon, season: Season, land: Land, folder: Path) -> CurrentGrid:
        """Read the file from the cache, or download, check and cache it."""
        request = self._request(region, season)
        cached = self.cached_download(region, season, folder)

        def check(file: Path, metadata: dict[str, Any]) -> AcceptedFields:
            return accept(file, self._expected(region, request, metadata), land)

        fields, metadata = None, self._fresh_metadata(request, cached)
        if metadata is not None:
            # A file from the cache may fail checks that were added since: it is downloaded again.
            with contextlib.suppress(StageError):
                fields = check(cached.file, metadata)
        if fields is None or metadata is None:
            fields, metadata = self._downloaded(request, cached, check)
        steps = _obtained(request, metadata)
        return CurrentGrid(
            season=season.name,
            lon=fields.lon,
            lat=fields.lat,
            u=fields.u,
            v=fields.v,
            times_s=self._times_s(season, steps),
            valid=self._valid(season, steps),
            credit=Credit(
                name=f"{self.spec.product}, {self.spec.dataset} {metadata['version']}",
                kind="current",
                text=self.spec.credit,
                licence=self.spec.licence,
                url=self.spec.url,
                retrieved=metadata["retrieved_utc"],
            ),
            notes=(*self._step_notes(steps), *fields.notes),
            files=((cached.file.name, metadata["sha256"]),),
        )

    def subset_arguments(self, region: Polygon) -> dict[str, Any]:
        """Return arguments of `copernicusmarine.subset` except version, times and output file."""
        lowest, highest = self.spec.latitudes
        margin = self._margin_deg
        west, south, east, north = widened(region.bounds, margin, margin)
        arguments: dict[str, Any] = {
            "dataset_id": self.spec.dataset,
            "variables": [self.spec.eastward, self.spec.northward],
            "minimum_longitude": west,
            "maximum_longitude": east,
            "minimum_latitude": max(south, lowest),
            "maximum_latitude": min(north, highest),
            "coordinates_selection_method": "strict-inside",
            "disable_progress_bar": True,
            "raise_if_updating": True,
        }
        if self.spec.depth_m is not None:
            # For equal limits the client takes the nearest level.
            arguments |= {"minimum_depth": self.spec.depth_m, "maximum_depth": self.spec.depth_m}
        return arguments

    def cached_download(self, region: Polygon, season: Season, folder: Path) -> CachedDownload:
        """Return the place of the season's file in the cache."""
        request = self._request(region, season)
        labels = request.steps.labels
        valid = season.valid.replace(":", "") or f"{labels[0]}_{labels[-1]}"
        fingerprint = hashlib.sha256(json.dumps(request.record).encode()).hexdigest()[:12]
        return CachedDownload(folder / f"{self.spec.dataset}_{valid}_{fingerprint}.nc")

    def select_steps(self, season: Season) -> SelectedSteps:
        """Select the time steps of the season's fields; ValueError where there can be none."""
        if season.is_changing:
            return select_all_steps(season.period, self._resolution)
        return select_steps(season.period, self._resolution, season.resolved_time_method)

    @property
    def _margin_deg(self) -> float:
        """Width of the margin that is requested around the region, degrees."""
        return MARGIN_CELLS * self.spec.cell_deg

    @property
    def _resolution(self) -> TimeResolution:
        """Length and kind of the dataset's time steps."""
        return TimeResolution(self.spec.step, self.spec.kind)

    def _may_cover(self, steps: SelectedSteps) -> bool:
        """Whether the dataset may have the steps; if in doubt, the service is asked."""
        if self.spec.kind == "climatology":
            return True
        today = datetime.now(UTC).replace(hour=0, minute=0, second=0, microsecond=0)
        last = today + timedelta(days=self.spec.days_ahead + 1)
        first = datetime.fromisoformat(self.spec.first_day).replace(tzinfo=UTC)
        # Where the current changes, the steps around the departure will do for a short voyage.
        end = steps.starts[1] if steps.are_fields else steps.end
        return first <= steps.starts[0] and end <= last

    def _is_settled(self, steps: SelectedSteps, moment: datetime) -> bool:
        """Whether the data of some steps were final at a moment."""
        settled = steps.end + timedelta(days=self.spec.settles_after_days)
        return self.spec.kind == "climatology" or moment >= settled

    def _request(self, region: Polygon, season: Season) -> _Request:
        """Return the request for a season."""
        steps = self.select_steps(season)
        return _Request(self.subset_arguments(region), self.spec.version, steps)

    def _fresh_metadata(self, request: _Request, cached: CachedDownload) -> dict[str, Any] | None:
        """Return the sidecar of a cached file that is valid and not out of date; else None."""
        metadata = cached.metadata(request.record)
        if metadata is None:
            return None
        retrieved = datetime.fromisoformat(metadata["retrieved_utc"])
        is_of_today = retrieved.date() == datetime.now(UTC).date()
        return metadata if is_of_today or self._is_settled(request.steps, retrieved) else None

    def _downloaded(
        self,
        request: _Request,
        cached: CachedDownload,
        check: Callable[[Path, dict[str, Any]], AcceptedFields],
    ) -> tuple[AcceptedFields, dict[str, Any]]:
        """Download a file, and cache it once it has passed; its fields and its sidecar."""
        with cached.staging_folder() as staging:
            staged = staging / cached.file.name

            def check_answer(answer: dict[str, Any]) -> tuple[AcceptedFields, dict[str, Any]]:
                metadata = self._metadata(request, answer)
                return check(staged, metadata), metadata

            label_format = self._resolution.label_format
            fields, metadata = download(
                self.spec, request.arguments, label_format, request.steps, staged, check_answer
            )
            return fields, cached.save(staged, metadata)

    def _metadata(self, request: _Request, answer: dict[str, Any]) -> dict[str, Any]:
        """Return the content and origin of a file; no credentials."""
        return {
            "source": self.spec.name,
            "product": self.spec.product,
            "dataset": self.spec.dataset,
            "version": answer["version"],
            "part": answer["part"],
            "doi": self.spec.doi,
            "credit": self.spec.credit,
            "client": f"copernicusmarine {version('copernicusmarine')}",
            "request": request.record,
            "stamps_utc": answer["stamps"],
            "missing_boxes": answer["missing_boxes"],
        }

    def _expected(self, region: Polygon, request: _Request, metadata: dict[str, Any]) -> Expected:
        """Return the content that a file must have."""
        steps = _obtained(request, metadata)
        boxes = tuple(tuple(box) for box in metadata["missing_boxes"])
        label_format = self._resolution.label_format
        return Expected(self.spec, steps.labels, steps.weights, label_format, region, boxes)

    def _valid(self, season: Season, steps: SelectedSteps) -> str:
        """Return the time that the fields are valid for, which may be near the one asked for."""
        if steps.are_fields:
            ends = (self._resolution.valid_time(steps.starts[i]) for i in (0, -1))
            return "/".join(f"{end:%Y-%m-%dT%H:%MZ}" for end in ends)
        if self.spec.kind == "climatology":
            return f"month {steps.labels[0]} of the mean year"
        return season.valid if len(steps.labels) > 1 else steps.labels[0]

    def _times_s(self, season: Season, steps: SelectedSteps) -> FloatArray:
        """Return times (nt,) of the fields, seconds since departure; 0 for a single one."""
        if not steps.are_fields:
            return np.zeros(1)
        moments = [self._resolution.valid_time(start) for start in steps.starts]
        return np.array([(moment - season.period.begin).total_seconds() for moment in moments])

    def _step_notes(self, steps: SelectedSteps) -> tuple[Note, ...]:
        """Say what steps of a current that changes can't show."""
        if steps.are_fields and self.spec.kind == "mean" and self.spec.step in {"day", "month"}:
            return (Note.of("steps-are-means", step=self.spec.step),)
        return ()


def _obtained(request: _Request, metadata: Mapping[str, Any]) -> SelectedSteps:
    """Return the requested steps that a file has, by its sidecar."""
    return request.steps.until(datetime.fromisoformat(metadata["stamps_utc"][-1]))


def _asked_time(season: Season) -> str:
    """Spell the time that a season asks for: of its one field, or from its departure on."""
    if not season.is_changing:
        return season.valid
    ends = (f"{end:%Y-%m-%dT%H:%MZ}" for end in (season.period.begin, season.period.end))
    return "/".join(dict.fromkeys(ends))
