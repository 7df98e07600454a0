"""Currents of the Copernicus Marine Service through its official client, unattended.

The client hangs, returns None, leaves partial files behind and reads naive times as local ones
(each seen). So a download is a child process with a deadline, the whole call is tried again, the
request is strict and in UTC, and a file is taken only after `acceptance` has looked at it.
"""

from __future__ import annotations

import base64
import binascii
import calendar
import hashlib
import json
import os
import shutil
import sys
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.errors import StageError
from pipeline.model import Credit, CurrentGrid
from pipeline.sources import acceptance
from pipeline.sources.child import run_with_deadline
from pipeline.sources.copernicus_child import NO_ANSWER

if TYPE_CHECKING:
    from shapely.geometry import Polygon

    from pipeline.catalogue import CopernicusSpec
    from pipeline.model import Land
    from pipeline.scenario import Season

USERNAME = "COPERNICUSMARINE_SERVICE_USERNAME"
PASSWORD = "COPERNICUSMARINE_SERVICE_PASSWORD"  # noqa: S105 - the variable's name
# The client's own file, under COPERNICUSMARINE_CREDENTIALS_DIRECTORY or the home directory.
_FOLDER, _FILE = ".copernicusmarine", ".copernicusmarine-credentials"
# Pause before the second and third attempt; the client itself retries for minutes inside one.
_PAUSES_S = (20.0, 60.0)
# Asking again can't help where the account or the request is wrong.
_FINAL = (
    "InvalidUsernameOrPassword",
    "CredentialsCannotBeNone",
    "CoordinatesOutOfDatasetBounds",
    "DatasetNotFound",
    "DatasetVersionNotFound",
    "VariableDoesNotExistInTheDataset",
)
# Grid cells fetched beyond the region, so that its edge is interpolated and not held constant.
_BEYOND_CELLS = 2.5
# The grid's own limits: 80 S to 90 N.
_SOUTH, _NORTH = -80.0, 90.0
_LONGEST_REASON = 300


@dataclass(frozen=True)
class Copernicus:
    """A dataset of monthly means."""

    spec: CopernicusSpec

    @property
    def uses_network(self) -> bool:
        """Always."""
        return True

    def identity(self, season: Season) -> tuple[str, ...]:
        """Dataset, version and month."""
        return (self.spec.name, self.spec.model_dump_json(), season.valid)

    def unavailable(self) -> str:
        """Without an account's name and password it can't be asked."""
        if (os.environ.get(USERNAME) and os.environ.get(PASSWORD)) or credentials_file().is_file():
            return ""
        return (
            f"{self.spec.name} needs a free Copernicus Marine account: set {USERNAME} and "
            f"{PASSWORD}, or run `copernicusmarine login` once"
        )

    def uncovered(self, region: Polygon, season: Season) -> str:
        """The whole ocean from 80 S; any month, as the service itself knows which it has."""
        del season
        south = region.bounds[1]
        if south >= _SOUTH:
            return ""
        return f"{self.spec.name} ends at {_SOUTH:g} degrees; the region reaches {south:g}"

    def current(self, region: Polygon, season: Season, land: Land, folder: Path) -> CurrentGrid:
        """Download the month, look at it, keep it with its sidecar."""
        kept = folder / f"{self.spec.dataset}_{season.valid}_{self._fingerprint(region, season)}.nc"
        workshop = folder / f"{kept.stem}.partial"
        # Whatever an earlier run left when it was killed, the client's own leftovers included.
        shutil.rmtree(workshop, ignore_errors=True)
        workshop.mkdir(parents=True)
        try:
            request = self.request(region, season, workshop, kept.name)
            self._download(request)
            fresh = workshop / kept.name
            expected = acceptance.Expected(
                month=season.valid,
                region=region.bounds,
                cell_deg=self.spec.cell_deg,
                eastward=self.spec.eastward,
                northward=self.spec.northward,
                speed_limit_m_s=self.spec.speed_limit_m_s,
            )
            field = acceptance.accept(fresh, expected, land)
            retrieved = datetime.now(UTC).isoformat(timespec="seconds")
            sidecar = workshop / f"{kept.stem}.json"
            facts = self._sidecar(request, fresh, retrieved)
            sidecar.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
            fresh.replace(kept)
            sidecar.replace(folder / sidecar.name)
        finally:
            shutil.rmtree(workshop, ignore_errors=True)
        return CurrentGrid(
            season=season.name,
            lon=field.lon,
            lat=field.lat,
            u=field.u,
            v=field.v,
            valid=season.valid,
            credit=Credit(
                name=f"{self.spec.product}, {self.spec.dataset}",
                kind="current",
                text=self.spec.credit,
                licence=self.spec.licence,
                url=self.spec.url,
                retrieved=retrieved,
            ),
        )

    def request(
        self, region: Polygon, season: Season, folder: Path, name: str
    ) -> dict[str, object]:
        """Arguments of `copernicusmarine.subset`; times are UTC strings."""
        west, south, east, north = region.bounds
        beyond = _BEYOND_CELLS * self.spec.cell_deg
        year, month = (int(part) for part in season.valid.split("-"))
        last = calendar.monthrange(year, month)[1]
        request: dict[str, object] = {
            "dataset_id": self.spec.dataset,
            "dataset_version": self.spec.version,
            "variables": [self.spec.eastward, self.spec.northward],
            "minimum_longitude": west - beyond,
            "maximum_longitude": east + beyond,
            "minimum_latitude": max(south - beyond, _SOUTH),
            "maximum_latitude": min(north + beyond, _NORTH),
            "start_datetime": f"{season.valid}-01T00:00:00Z",
            "end_datetime": f"{season.valid}-{last:02d}T23:59:59Z",
            "coordinates_selection_method": "strict-inside",
            "output_directory": str(folder),
            "output_filename": name,
            "disable_progress_bar": True,
            "raise_if_updating": True,
        }
        if self.spec.depth_m is not None:
            # Equal limits are one point, for which the client takes the nearest level.
            request |= {"minimum_depth": self.spec.depth_m, "maximum_depth": self.spec.depth_m}
        return request

    def _download(self, request: dict[str, object]) -> None:
        """Try the whole call up to so many times, each with its own deadline."""
        reason = ""
        for attempt in range(self.spec.attempts):
            if attempt:
                time.sleep(_PAUSES_S[min(attempt, len(_PAUSES_S)) - 1])
            reason, is_final = self._attempt(request)
            if not reason:
                return
            if is_final:
                break
        raise StageError(f"{self.spec.name}: {reason}")

    def _attempt(self, request: dict[str, object]) -> tuple[str, bool]:
        """Say why one call failed, and whether another may help; an empty reason is success."""
        command = [sys.executable, "-m", "pipeline.sources.copernicus_child"]
        ended = run_with_deadline(command, json.dumps(request), self.spec.deadline_s)
        if ended.code is None:
            return f"no answer within {self.spec.deadline_s:g} s; the download was stopped", False
        if ended.code == NO_ANSWER:
            silent = "the client gave up without a reason, as it does where it finds no credentials"
            return f"{silent}; set {USERNAME} and {PASSWORD}", True
        if ended.code != 0:
            said = without_secrets(_last_line(ended.errors)) or f"exit {ended.code}"
            return f"the client failed: {said}", said.startswith(_FINAL)
        return "", True

    def _fingerprint(self, region: Polygon, season: Season) -> str:
        """Short name for what is asked for."""
        bounds = [round(bound, 9) for bound in region.bounds]
        text = json.dumps([*self.identity(season), *bounds])
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def _sidecar(self, request: dict[str, object], file: Path, retrieved: str) -> dict[str, object]:
        """What the file is, where it came from and how to know it again; no credentials."""
        asked = {key: value for key, value in request.items() if key != "output_directory"}
        return {
            "source": self.spec.name,
            "product": self.spec.product,
            "dataset": self.spec.dataset,
            "version": self.spec.version,
            "doi": self.spec.doi,
            "credit": self.spec.credit,
            "client": f"copernicusmarine {version('copernicusmarine')}",
            "request": asked,
            "retrieved_utc": retrieved,
            "bytes": file.stat().st_size,
            "sha256": hashlib.sha256(file.read_bytes()).hexdigest(),
        }


def credentials_file() -> Path:
    """Where the client keeps the credentials of `copernicusmarine login`."""
    folder = os.environ.get("COPERNICUSMARINE_CREDENTIALS_DIRECTORY")
    return (Path(folder) if folder else Path.home()) / _FOLDER / _FILE


def without_secrets(text: str) -> str:
    """Blank every credential that is known here out of a text."""
    for secret in sorted(_secrets(), key=len, reverse=True):
        text = text.replace(secret, "***")
    return text


def _secrets() -> set[str]:
    """User names and passwords of the environment and of the client's own file."""
    found = {os.environ.get(USERNAME, ""), os.environ.get(PASSWORD, "")}
    try:
        stored = base64.standard_b64decode(credentials_file().read_bytes()).decode("utf-8")
    except (OSError, binascii.Error, UnicodeDecodeError):
        stored = ""
    found |= {line.partition("=")[2].strip() for line in stored.splitlines()}
    return found - {""}


def _last_line(text: str) -> str:
    """Last line that says something, cut where it is long."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1][:_LONGEST_REASON] if lines else ""
