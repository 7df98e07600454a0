"""Currents of the Copernicus Marine Service through its official client, unattended.

The client may hang, return None, leave partial files behind, put gaps in place of data that do not
arrive, and read naive times as local ones (all of this was seen). So a download is a subprocess
with a deadline, the whole call is repeated on failure, the request is strict and in UTC, and a file
is used only after the `acceptance` check.
"""

import contextlib
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from shapely.geometry import Polygon

from pipeline.errors import StageError
from pipeline.geo.lonlat import MARGIN_CELLS, Bounds, common_bounds
from pipeline.model import Credit, CurrentGrid, Land, Note
from pipeline.model.inputs import CurrentSource, Issue
from pipeline.scenario.catalogue import CopernicusSpec
from pipeline.scenario.season import Season
from pipeline.sources.cf.axes import TimeSteps
from pipeline.sources.cf.fields import SelectedSteps
from pipeline.sources.copernicus.acceptance import Accepted, accept
from pipeline.sources.copernicus.client import LOGIN, has_account
from pipeline.sources.copernicus.download import (
    CachedDownload,
    Request,
    download,
    last_step,
    select,
    step_ends,
)


@dataclass(frozen=True)
class Copernicus(CurrentSource):
    """One dataset of the service."""

    spec: CopernicusSpec

    def needs_network(self, region: Polygon, season: Season, folder: Path) -> bool:
        """Whether the season's file is not in the cache."""
        asked = self.asked(region, season)
        return self._fresh_metadata(asked, self.cached_download(asked, season, folder)) is None

    def identity(self, season: Season) -> tuple[str, ...]:
        """Return dataset, version and time; and today's date while the data may still change."""
        now = datetime.now(UTC)
        try:
            is_settled = self._is_settled(self._select(season)[0], now)
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
        margin = MARGIN_CELLS * spec.cell_deg
        if not spec.across_180 and (west - margin + 180) // 360 != (east + margin + 180) // 360:
            return (
                f"{spec.name} can't be requested across 180 degrees, and the region reaches from "
                f"{west:g} to {east:g}; move the region or {remedy}"
            )
        try:
            steps, _ = self._select(season)
        except ValueError as error:
            return f"{spec.name}, asked for {_asked_time(season)}, {error}; {remedy}"
        if not self._may_cover(steps, changes=season.is_changing):
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
        asked = self.asked(region, season)
        cached = self.cached_download(asked, season, folder)

        def check(file: Path, metadata: Mapping[str, Any]) -> Accepted:
            return accept(file, _obtained(asked, metadata), metadata["missing_boxes"], land)

        accepted, metadata = None, self._fresh_metadata(asked, cached)
        if metadata is not None:
            # A file from the cache may fail checks that were added since: it is downloaded again.
            with contextlib.suppress(StageError):
                accepted = check(cached.file, metadata)
        if accepted is None or metadata is None:
            with cached.staging_folder() as staging:
                staged = staging / cached.file.name

                def check_answer(answer: dict[str, Any]) -> tuple[Accepted, dict[str, Any]]:
                    metadata = self._metadata(asked, answer)
                    return check(staged, metadata), metadata

                accepted, metadata = download(asked, staged, check_answer)
                metadata = cached.save(staged, metadata)
        field, notes = accepted
        obtained = _obtained(asked, metadata)
        if obtained.changes and self.spec.kind == "mean" and self.spec.step in {"day", "month"}:
            # Steps so long can't show the tide.
            notes = (Note.of("steps-are-means", step=self.spec.step), *notes)
        return CurrentGrid(
            season=season.name,
            lon=field.lon,
            lat=field.lat,
            u=field.u,
            v=field.v,
            times_s=np.array(obtained.selected.times_s),
            valid=self._valid(season, obtained),
            credit=Credit(
                name=f"{self.spec.product}, {self.spec.dataset} {metadata['version']}",
                kind="current",
                text=self.spec.credit,
                licence=self.spec.licence,
                url=self.spec.url,
                retrieved=metadata["retrieved_utc"],
            ),
            notes=notes,
            files=((cached.file.name, metadata["sha256"]),),
        )

    def asked(self, region: Polygon, season: Season) -> Request:
        """Return the request for a season; ValueError where the dataset can't have its steps."""
        return Request(self.spec, region, *self._select(season))

    def cached_download(self, asked: Request, season: Season, folder: Path) -> CachedDownload:
        """Return the place of the season's file in the cache."""
        labels = asked.steps.labels
        valid = season.valid.replace(":", "") or f"{labels[0]}_{labels[-1]}"
        fingerprint = hashlib.sha256(json.dumps(asked.record).encode()).hexdigest()[:12]
        return CachedDownload(folder / f"{self.spec.dataset}_{valid}_{fingerprint}.nc")

    def _select(self, season: Season) -> tuple[TimeSteps, SelectedSteps]:
        """Select the time steps of the season's fields; ValueError where there can be none."""
        method = "changing" if season.is_changing else season.resolved_time_method
        return select(self.spec, season.period, method)

    def _may_cover(self, steps: TimeSteps, *, changes: bool) -> bool:
        """Whether the dataset may have the steps; if in doubt, the service is asked."""
        if self.spec.kind == "climatology":
            return True
        today = datetime.now(UTC).replace(hour=0, minute=0, second=0, microsecond=0)
        last = today + timedelta(days=self.spec.days_ahead + 1)
        first = datetime.fromisoformat(self.spec.first_day).replace(tzinfo=UTC)
        begin, _ = step_ends(self.spec, steps.moments[0])
        # Where the current changes, the steps around the departure will do for a short voyage.
        end = step_ends(self.spec, steps.moments[0 if changes else -1])[1]
        return first <= begin and end <= last

    def _is_settled(self, steps: TimeSteps, moment: datetime) -> bool:
        """Whether the data of some steps were final at a moment."""
        if self.spec.kind == "climatology":
            return True
        _, end = step_ends(self.spec, steps.moments[-1])
        return moment >= end + timedelta(days=self.spec.settles_after_days)

    def _fresh_metadata(self, asked: Request, cached: CachedDownload) -> dict[str, Any] | None:
        """Return the sidecar of a cached file that is valid and not out of date; else None."""
        metadata = cached.metadata(asked.record)
        if metadata is None:
            return None
        retrieved = datetime.fromisoformat(metadata["retrieved_utc"])
        is_of_today = retrieved.date() == datetime.now(UTC).date()
        return metadata if is_of_today or self._is_settled(asked.steps, retrieved) else None

    def _metadata(self, asked: Request, answer: dict[str, Any]) -> dict[str, Any]:
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
            "request": asked.record,
            "stamps_utc": answer["stamps"],
            "missing_boxes": answer["missing_boxes"],
        }

    def _valid(self, season: Season, obtained: Request) -> str:
        """Return the time that the fields are valid for, which may be near the one asked for."""
        labels, moments = obtained.steps.labels, obtained.steps.moments
        if obtained.changes:
            return f"{moments[0]:%Y-%m-%dT%H:%MZ}/{moments[-1]:%Y-%m-%dT%H:%MZ}"
        if self.spec.kind == "climatology":
            return f"month {labels[0]} of the mean year"
        return season.valid if len(labels) > 1 else labels[0]


def _obtained(asked: Request, metadata: Mapping[str, Any]) -> Request:
    """Return what a file has of what was asked for, by its sidecar."""
    return asked.until(datetime.fromisoformat(metadata["stamps_utc"][-1]))


def _asked_time(season: Season) -> str:
    """Spell the time that a season asks for: of its one field, or from its departure on."""
    if not season.is_changing:
        return season.valid
    ends = (f"{end:%Y-%m-%dT%H:%MZ}" for end in (season.period.begin, season.period.end))
    return "/".join(dict.fromkeys(ends))
