"""Currents in files of the user's: NetCDF or Zarr by the CF conventions.

The region's part of the wanted steps is read lazily, and looked at in a wider window than the
planner is given: what is wrong with a file is plainer there.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from pipeline import store as artefact
from pipeline.errors import RequestError
from pipeline.model import Credit, CurrentGrid
from pipeline.sources.currents.cf import contents as cf_contents
from pipeline.sources.currents.cf import grid as cf_grid
from pipeline.sources.currents.cf import time as cf_time
from pipeline.sources.currents.cf.contents import called
from pipeline.sources.quality import plausibility as plausible
from pipeline.sources.quality.field import Field, Shore

if TYPE_CHECKING:
    from pathlib import Path

    from shapely.geometry import Polygon

    from pipeline.model import Land
    from pipeline.scenario.model import Season
    from pipeline.sources.currents.cf.contents import Contents
    from pipeline.sources.currents.cf.time import Chosen

# No sea moves faster; tides in the narrowest sounds come near it.
_SPEED_LIMIT_M_S = 10.0
# Grid cells handed on beyond the region, so that its edge is interpolated and not held constant.
_BEYOND_CELLS = 2.5
# A file is looked at so many cells and degrees around the region's middle, away from the poles.
_LOOK_CELLS, _LOOK_DEG, _LOOK_NORTH = 240, 75.0, 80.0
# Shares of open water without figures that a reader is told of, and that are too much; the rest is
# filled from the water around. Of figures far inland, and of zeros on land, that say the same.
_GAPS_TOLD, _GAPS_REFUSED, _FILLED_LAND = 0.05, 0.2, 0.5
_ZERO_LAND, _ZERO_WATER = 0.9, 0.01
_DOI = re.compile(r"\b10\.\d{4,9}/[^\s,;\"'<>]+[\w/]")
_LONGEST_NAME = 100
_METADATA = {"zarr.json", ".zgroup", ".zarray", ".zattrs", ".zmetadata"}


@dataclass(frozen=True)
class CfFiles:
    """Files that belong together, by paths and patterns."""

    paths: tuple[str, ...]

    def asks_network(self, region: Polygon, season: Season, folder: Path) -> bool:
        """Never."""
        del region, season, folder
        return False

    def identity(self, season: Season) -> tuple[str, ...]:
        """What those of the files hold that the season's steps are in; that there are none."""
        try:
            contents, chosen = self._chosen(season)
        except (RequestError, ValueError):
            return ("nothing", *self.paths)
        hashes = (hashed for _, hashed in _hashes(contents, chosen))
        return ("cf", *hashes, season.valid, season.how, chosen.valid)

    def unavailable(self) -> str:
        """Nothing more than `uncovered` says stands in its way."""
        return ""

    def uncovered(self, region: Polygon, season: Season) -> str:
        """Say why the files can't give the season's current; empty when they can."""
        try:
            contents = _contents(cf_contents.found(self.paths))
        except RequestError as error:
            return "; ".join(error.faults)
        faults = cf_grid.uncovered(contents, region.bounds)
        try:
            cf_time.choose(contents.steps, season.period, season.how)
        except ValueError as error:
            faults.append(str(error))
        return f"{called(contents.files)}: {'; '.join(faults)}" if faults else ""

    def current(self, region: Polygon, season: Season, land: Land, folder: Path) -> CurrentGrid:
        """Read the region's part; the land is the world's, as files are looked at more widely."""
        del land, folder
        contents, chosen = self._chosen(season)
        name = called(contents.files)
        near = _around(contents, region.bounds)
        wide = cf_grid.field(
            contents, chosen.weights, cf_grid.window(contents, _looked_at(contents, near))
        )
        shore = Shore.world()
        wide, notes = _without_zeros(wide, shore)
        verdict = plausible.judged(wide, shore, _SPEED_LIMIT_M_S)
        verdict += _gap_verdict(wide, shore, region.bounds)
        own = _cropped(wide, near)
        if own.gap.all():
            verdict += plausible.Verdict(("it has no figures in the region",))
        if verdict.faults:
            why = "; ".join(verdict.faults)
            raise RequestError([f"{name} is refused: {why}; mend it, or give another"])
        credit = _credit(contents)
        if chosen.is_climatology:
            # Named by its credit it counts as a stand-in: the season asked for a time of its own.
            notes += (f"planned on {credit.name}: {chosen.valid} stands for {season.valid}",)
        return CurrentGrid(
            season=season.name,
            lon=own.lon,
            lat=own.lat,
            u=own.u,
            v=own.v,
            valid=chosen.valid,
            credit=credit,
            notes=(
                *contents.notes,
                *chosen.notes,
                *notes,
                *(f"look at {name}: {doubt}" for doubt in verdict.doubts),
            ),
            files=_hashes(contents, chosen),
        )

    def _chosen(self, season: Season) -> tuple[Contents, Chosen]:
        """What the files hold, and the steps of it that the season takes."""
        contents = _contents(cf_contents.found(self.paths))
        return contents, cf_time.choose(contents.steps, season.period, season.how)


def _hashes(contents: Contents, chosen: Chosen) -> tuple[tuple[str, str], ...]:
    """Name and hash of each file that the chosen steps are in."""
    parts = [contents.u[contents.u_places[step][0]] for step in chosen.weights]
    parts += [contents.v[contents.v_places[step][0]] for step in chosen.weights]
    used = sorted({part.file for part in parts})
    return tuple((file.name, _hash(file, _stamp(file))) for file in used)


def _contents(files: tuple[Path, ...]) -> Contents:
    """Look into files, once for as long as they stay as they are."""
    return _contents_of(files, tuple(_stamp(file) for file in files))


@lru_cache(maxsize=4)
def _contents_of(files: tuple[Path, ...], stamps: tuple[str, ...]) -> Contents:
    """Look into files of these stamps."""
    del stamps
    return cf_contents.contents(files)


def _stamp(file: Path) -> str:
    """Size and time of change; of a Zarr store the listing of all of its files."""
    parts = sorted(part for part in file.rglob("*") if part.is_file()) if file.is_dir() else [file]
    return "\n".join(
        f"{part.relative_to(file)} {part.stat().st_size} {part.stat().st_mtime_ns}"
        for part in parts
    )


@lru_cache(maxsize=512)
def _hash(file: Path, stamp: str) -> str:
    """SHA-256 of a file; of a Zarr store that of its listing and of its metadata.

    Its chunks count by name, size and time of change: to read terabytes for one route is too much.
    """
    if not file.is_dir():
        return artefact.file_hash(file)
    digest = hashlib.sha256(stamp.encode())
    for part in sorted(file.rglob("*")):
        if part.name in _METADATA:
            digest.update(part.read_bytes())
    return digest.hexdigest()


def _around(contents: Contents, bounds: cf_grid.Bounds) -> cf_grid.Bounds:
    """A region with a few cells more on each side."""
    across, up = (_BEYOND_CELLS * float(np.abs(np.diff(a)).max()) for a in _axes(contents))
    west, south, east, north = bounds
    return west - across, south - up, east + across, north + up


def _looked_at(contents: Contents, near: cf_grid.Bounds) -> cf_grid.Bounds:
    """The window that a file is looked at in; what is handed on is part of it."""
    west, south, east, north = near
    across, up = (min(_LOOK_DEG, _LOOK_CELLS * _usual(axis)) for axis in _axes(contents))
    middle_lon, middle_lat = (west + east) / 2, (south + north) / 2
    return (
        min(west, middle_lon - across),
        min(south, max(middle_lat - up, -_LOOK_NORTH)),
        max(east, middle_lon + across),
        max(north, min(middle_lat + up, _LOOK_NORTH)),
    )


def _axes(contents: Contents) -> tuple[cf_grid.FloatArray, cf_grid.FloatArray]:
    """Longitudes and latitudes."""
    return contents.lon, contents.lat


def _usual(axis: cf_grid.FloatArray) -> float:
    """Usual step of an axis."""
    return float(np.median(np.abs(np.diff(axis))))


def _cropped(field: Field, bounds: cf_grid.Bounds) -> Field:
    """Part of a field inside bounds."""
    west, south, east, north = bounds
    x = (field.lon >= west) & (field.lon <= east)
    y = (field.lat >= south) & (field.lat <= north)
    return Field(field.lon[x], field.lat[y], field.u[np.ix_(y, x)], field.v[np.ix_(y, x)])


def _without_zeros(field: Field, shore: Shore) -> tuple[Field, tuple[str, ...]]:
    """Take zeros for gaps where land has nothing else: they would slow the water beside it."""
    zero = (field.u == 0) & (field.v == 0)
    if not zero.any():
        return field, ()
    is_land = shore.cells(field.lon, field.lat)
    water = ~plausible.grown(is_land, plausible.FAR_CELLS)
    if not is_land.any() or zero[is_land].mean() < _ZERO_LAND or not water.any():
        return field, ()
    if zero[water].mean() > _ZERO_WATER:
        return field, ()
    u, v = (np.where(zero, np.nan, part) for part in (field.u, field.v))
    return replace(field, u=u, v=v), ("zeros of the file are taken for land",)


def _gap_verdict(field: Field, shore: Shore, region: cf_grid.Bounds) -> plausible.Verdict:
    """Whether figures lie where the region's water is, and its water has figures."""
    (gaps, water), (inland, dry) = plausible.misplaced(field, shore, region)
    doubts: tuple[str, ...] = ()
    if inland > _FILLED_LAND * max(dry, 1):
        doubts = ("it has figures on land: whether it lies where it should can't be told",)
    share = gaps / max(water, 1)
    if share <= _GAPS_TOLD:
        return plausible.Verdict((), doubts)
    said = f"{share:.0%} of the region's open water has no figures"
    if share > _GAPS_REFUSED:
        return plausible.Verdict((f"{said}, which is too much to fill",), doubts)
    return plausible.Verdict((), (f"{said}: it is filled from the water around", *doubts))


def _credit(contents: Contents) -> Credit:
    """Who made the files, as they say themselves."""
    said = {key.lower(): " ".join(value.split()) for key, value in contents.attributes.items()}
    name = said.get("title") or f"{called(contents.files)}, a file of the user's"
    text = [said[key] for key in ("title", "institution", "credit", "source") if said.get(key)]
    found = _DOI.search(" ".join(said.get(k, "") for k in ("doi", "id", "references", "license")))
    address = next((a for a in (said.get("references", ""),) if a.startswith("http")), "")
    return Credit(
        name=name[:_LONGEST_NAME],
        kind="current",
        text="; ".join(dict.fromkeys(text)) or name,
        licence=said.get("license") or said.get("licence") or "",
        url=f"https://doi.org/{found[0]}" if found else address,
    )
