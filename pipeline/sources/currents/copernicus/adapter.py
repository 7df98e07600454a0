"""Currents of the Copernicus Marine Service through its official client, unattended.

The client hangs, returns None, leaves partial files behind, fills what it does not get with gaps
and reads naive times as local ones (each seen). So a download is a child process with a deadline,
the whole call is tried again, the request is strict and in UTC, and a file is taken only after
`acceptance` has looked at it.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from pipeline.errors import StageError
from pipeline.model import Credit, CurrentGrid
from pipeline.sources.currents.copernicus.account import PASSWORD, USERNAME, has_account
from pipeline.sources.currents.copernicus.cache import Kept
from pipeline.sources.currents.copernicus.download import download
from pipeline.sources.currents.copernicus.steps import Steps, selection
from pipeline.sources.quality import acceptance

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from shapely.geometry import Polygon

    from pipeline.model import Land
    from pipeline.scenario.catalogue import CopernicusSpec
    from pipeline.scenario.model import Season
    from pipeline.sources.currents.copernicus.steps import Selection
    from pipeline.sources.quality.field import Field

# Grid cells fetched beyond the region, so that its edge is interpolated and not held constant.
_BEYOND_CELLS = 2.5


@dataclass(frozen=True, slots=True)
class _Order:
    """What is asked of the service for a season: the client's arguments, and the time steps."""

    request: dict[str, Any]
    version: str
    chosen: Selection

    @property
    def facts(self) -> dict[str, Any]:
        """How the sidecar has it."""
        times = list(self.chosen.labels)
        return {**self.request, "version": self.version, "times": times}

    @property
    def fingerprint(self) -> str:
        """A short name for it."""
        return hashlib.sha256(json.dumps(self.facts).encode()).hexdigest()[:12]


@dataclass(frozen=True)
class Copernicus:
    """One dataset of the service."""

    spec: CopernicusSpec

    def asks_network(self, region: Polygon, season: Season, folder: Path) -> bool:
        """Unless the season's file is kept."""
        order = self._order(region, season)
        return self._still_good(order, self._kept(order, season, folder)) is None

    def identity(self, season: Season) -> tuple[str, ...]:
        """Dataset, version and time; and the day, as long as the figures may still change."""
        now = datetime.now(UTC)
        try:
            is_settled = self._is_settled(self._selection(season), now)
        except ValueError:
            is_settled = True  # there are no figures, as `uncovered` says
        today = "" if is_settled else now.date().isoformat()
        return (self.spec.name, self.spec.model_dump_json(), season.valid, season.how, today)

    def unavailable(self) -> str:
        """Without an account's name and password it can't be asked."""
        if has_account():
            return ""
        return (
            f"{self.spec.name} needs a free Copernicus Marine account: set {USERNAME} and "
            f"{PASSWORD}, or run `copernicusmarine login` once"
        )

    def uncovered(self, region: Polygon, season: Season) -> str:
        """Say what of the region or of the time lies outside the dataset."""
        spec = self.spec
        remedy = "name another source in 'currents'"
        (west, south, east, north), (lowest, highest) = region.bounds, spec.latitudes
        if south < lowest or north > highest:
            return (
                f"{spec.name} reaches from {lowest:g} to {highest:g} degrees north, the region "
                f"from {south:g} to {north:g}; shrink the region or {remedy}"
            )
        beyond = self._beyond
        if not spec.across_180 and (west - beyond + 180) // 360 != (east + beyond + 180) // 360:
            return (
                f"{spec.name} can't be asked across 180 degrees, and the region reaches from "
                f"{west:g} to {east:g}; move the region or {remedy}"
            )
        try:
            chosen = self._selection(season)
        except ValueError as error:
            return f"{spec.name}, asked for {season.valid}, {error}; {remedy}"
        if not self._may_cover(chosen):
            return f"{spec.name} covers {spec.covers}, not {season.valid}; {remedy}"
        return ""

    def current(self, region: Polygon, season: Season, land: Land, folder: Path) -> CurrentGrid:
        """Take the file that was kept, or download it, look at it and keep it with its sidecar."""
        order = self._order(region, season)
        kept = self._kept(order, season, folder)

        def look(file: Path, facts: dict[str, Any]) -> Field:
            return acceptance.accept(file, self._expected(region, order, facts), land)

        field, facts = None, self._still_good(order, kept)
        if facts is not None:
            # A file that no longer passes, as the checks have grown, is fetched again.
            with contextlib.suppress(StageError):
                field = look(kept.file, facts)
        if field is None or facts is None:
            field, facts = self._fetched(order, kept, look)
        return CurrentGrid(
            season=season.name,
            lon=field.lon,
            lat=field.lat,
            u=field.u,
            v=field.v,
            valid=self._valid(season, order.chosen),
            credit=Credit(
                name=f"{self.spec.product}, {self.spec.dataset} {facts['version']}",
                kind="current",
                text=self.spec.credit,
                licence=self.spec.licence,
                url=self.spec.url,
                retrieved=facts["retrieved_utc"],
            ),
            notes=field.doubts,
            files=((kept.file.name, facts["sha256"]),),
        )

    def request(self, region: Polygon) -> dict[str, Any]:
        """Arguments of `copernicusmarine.subset`, without version, times and the file's place."""
        west, south, east, north = region.bounds
        lowest, highest = self.spec.latitudes
        request: dict[str, Any] = {
            "dataset_id": self.spec.dataset,
            "variables": [self.spec.eastward, self.spec.northward],
            "minimum_longitude": west - self._beyond,
            "maximum_longitude": east + self._beyond,
            "minimum_latitude": max(south - self._beyond, lowest),
            "maximum_latitude": min(north + self._beyond, highest),
            "coordinates_selection_method": "strict-inside",
            "disable_progress_bar": True,
            "raise_if_updating": True,
        }
        if self.spec.depth_m is not None:
            # Equal limits are one point, for which the client takes the nearest level.
            request |= {"minimum_depth": self.spec.depth_m, "maximum_depth": self.spec.depth_m}
        return request

    @property
    def _beyond(self) -> float:
        """Degrees asked for beyond the region."""
        return _BEYOND_CELLS * self.spec.cell_deg

    @property
    def _steps(self) -> Steps:
        """How the dataset steps through time."""
        return Steps(self.spec.step, self.spec.kind)

    def _selection(self, season: Season) -> Selection:
        """The steps that make up the season's field; ValueError where there can be none."""
        return selection(season.period, self._steps, season.how)

    def _may_cover(self, chosen: Selection) -> bool:
        """Whether the steps may lie in the dataset; in doubt the service is asked."""
        if self.spec.kind == "climatology":
            return True
        today = datetime.now(UTC).replace(hour=0, minute=0, second=0, microsecond=0)
        last = today + timedelta(days=self.spec.days_ahead + 1)
        first = datetime.fromisoformat(self.spec.first_day).replace(tzinfo=UTC)
        return first <= chosen.begins[0] and chosen.end <= last

    def _is_settled(self, chosen: Selection, moment: datetime) -> bool:
        """Whether the figures of some steps no longer changed at a moment."""
        settled = chosen.end + timedelta(days=self.spec.settles_after_days)
        return self.spec.kind == "climatology" or moment >= settled

    def _order(self, region: Polygon, season: Season) -> _Order:
        """What is asked of the service."""
        return _Order(self.request(region), self.spec.version, self._selection(season))

    def _kept(self, order: _Order, season: Season, folder: Path) -> Kept:
        """Where the season's file is kept."""
        valid = season.valid.replace(":", "")
        return Kept(folder / f"{self.spec.dataset}_{valid}_{order.fingerprint}.nc")

    def _still_good(self, order: _Order, kept: Kept) -> dict[str, Any] | None:
        """The sidecar of a kept file that is whole, of this order, and not stale; else None."""
        facts = kept.facts(order.facts)
        if facts is None:
            return None
        retrieved = datetime.fromisoformat(facts["retrieved_utc"])
        is_of_today = retrieved.date() == datetime.now(UTC).date()
        return facts if is_of_today or self._is_settled(order.chosen, retrieved) else None

    def _fetched(
        self, order: _Order, kept: Kept, look: Callable[[Path, dict[str, Any]], Field]
    ) -> tuple[Field, dict[str, Any]]:
        """Download the file, and keep it once it has passed; its field and its sidecar."""
        with kept.workshop() as workshop:
            fresh = workshop / kept.file.name

            def judge(answer: dict[str, Any]) -> tuple[Field, dict[str, Any]]:
                facts = self._facts(order, answer)
                return look(fresh, facts), facts

            form, labels = self._steps.form, order.chosen.labels
            field, facts = download(self.spec, order.request, form, labels, fresh, judge)
            return field, kept.keep(fresh, facts)

    def _facts(self, order: _Order, answer: dict[str, Any]) -> dict[str, Any]:
        """What a file is and where it came from; no credentials."""
        return {
            "source": self.spec.name,
            "product": self.spec.product,
            "dataset": self.spec.dataset,
            "version": answer["version"],
            "part": answer["part"],
            "doi": self.spec.doi,
            "credit": self.spec.credit,
            "client": f"copernicusmarine {version('copernicusmarine')}",
            "request": order.facts,
            "stamps_utc": answer["stamps"],
            "missing_boxes": answer["missing"],
        }

    def _expected(
        self, region: Polygon, order: _Order, facts: dict[str, Any]
    ) -> acceptance.Expected:
        """What the file must hold."""
        return acceptance.Expected(
            labels=order.chosen.labels,
            weights=order.chosen.weights,
            form=self._steps.form,
            region=region.bounds,
            cell_deg=self.spec.cell_deg,
            eastward=self.spec.eastward,
            northward=self.spec.northward,
            speed_limit_m_s=self.spec.speed_limit_m_s,
            missing=tuple(tuple(box) for box in facts["missing_boxes"]),
            gaps_vary=self.spec.gaps_vary,
        )

    def _valid(self, season: Season, chosen: Selection) -> str:
        """The time that the field stands for, which may be near the one asked for."""
        if self.spec.kind == "climatology":
            return f"month {chosen.labels[0]} of the mean year"
        return season.valid if len(chosen.labels) > 1 else chosen.labels[0]
