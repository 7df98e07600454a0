"""Currents made of several: the mean of a forecast's members, and tidal streams plus a residual.

Members are in the user's own files: files, folders, or along a dimension. Tidal streams come from
harmonic constants, the residual current from the user's other files.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path
from typing import Self

import numpy as np
from shapely.geometry import Polygon

from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.geo.lonlat import Bounds, common_bounds
from pipeline.model import Credit, CurrentGrid, Land, MemberGrid, Note
from pipeline.model.inputs import CurrentSource, Issue
from pipeline.scenario.season import CYCLES, FILES, STILL, MembersSpec, Season, StreamConstants
from pipeline.sources.cf.adapter import CfFiles
from pipeline.sources.cf.contents import find_files, name_of
from pipeline.sources.cf.dataset import fatal_files, open_dataset
from pipeline.sources.interpolation import bilinear
from renew.vary.members import FEWEST, QUANTILES

# Least number of members that have a mean.
_LEAST = 2
# Largest number of members that are read.
_MOST = 200


@dataclass(frozen=True)
class CfMembers(CurrentSource):
    """Files whose fields are members; the season's current is their mean."""

    paths: tuple[str, ...]
    spec: MembersSpec

    def identity(self, season: Season) -> tuple[str, ...]:
        """Return what each member depends on, and the weights."""
        try:
            members = self._members()
        except RequestError:
            return ("nothing", *self.paths)
        each = [part for _, source in members for part in source.identity(season)]
        return ("members", self.spec.along, str(self.spec.weights), *each)

    def uncovered_reason(self, region: Polygon, season: Season) -> str:
        """Say why the first member can't be used, or why there are no members."""
        try:
            return self._members()[0][1].uncovered_reason(region, season)
        except RequestError as error:
            return "; ".join(error.faults)

    def covered_bounds(self, region: Polygon, season: Season) -> Bounds | None:
        """Return the part that the first member covers."""
        try:
            return self._members()[0][1].covered_bounds(region, season)
        except RequestError:
            return None

    def issue(self, season: Season) -> Issue:
        """Return the first member's issue, with the hashes of all."""
        issues = [source.issue(season) for _, source in self._members()]
        return replace(issues[0], digest="".join(issue.digest for issue in issues))

    def current(self, region: Polygon, season: Season, land: Land, folder: Path) -> CurrentGrid:
        """Read each member, checked like any current, and take their mean.

        A member that is refused, or on other nodes or at other times than the first one that can be
        used, is left out by name. Of forecasts, the newest must be usable, and is enough.
        """
        used: list[tuple[str, CurrentGrid, float]] = []
        reasons: list[str] = []
        members = self._members()
        for (name, source), weight in zip(members, self._weights(len(members)), strict=True):
            try:
                grid = source.current(region, season, land, folder)
            except RequestError as error:
                if self._are_cycles and not used:
                    raise
                reasons.append(f"{name}: {'; '.join(str(error).splitlines())}")
                continue
            if used and (differs := _difference(grid, used[0][1])):
                reasons.append(f"{name} has {differs} than {used[0][0]}")
                continue
            used.append((name, grid, weight))
        left_out = [Note.of("member-left-out", reason=reason) for reason in reasons]
        choose = self.spec.choose
        needed, whose = (1 if self._are_cycles else _LEAST), "an ensemble has"
        if choose in QUANTILES:
            needed, whose = FEWEST, f"members.choose = {choose!r} needs"
        if len(used) < needed:
            few = f"{len(used)} of {len(members)} members can be used, and {whose} {needed}"
            remedy = "or choose by the mean" if choose in QUANTILES else "or leave 'members' out"
            raise RequestError("; ".join([*reasons, f"{few}; give more, {remedy}"]))
        if len(used) == 1:
            return replace(used[0][1], notes=(*used[0][1].notes, *left_out))
        weights = np.array([weight for *_, weight in used])
        if (weights > 0).sum() < _LEAST:
            raise RequestError("members.weights leave less than two members; raise them")
        weights /= weights.sum()
        first = used[0][1]
        notes = dict.fromkeys(note for _, grid, _ in used for note in grid.notes)
        return replace(
            first,
            u=_mean([grid.u for _, grid, _ in used], weights),
            v=_mean([grid.v for _, grid, _ in used], weights),
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
            names = [file.stem for file in files]
            if len(set(names)) < len(names):
                names = [file.name for file in files]
            members = [
                (name, CfFiles((str(file),))) for name, file in zip(names, files, strict=True)
            ]
            what = f"{len(members)} file{'s' * (len(members) != 1)}"
        elif self._are_cycles:
            folders = sorted({file.parent for file in files}, key=lambda folder: folder.name)[::-1]
            if len({folder.name for folder in folders}) < len(folders):
                raise RequestError(
                    "members.along = 'cycles' needs folders of different names, one a forecast: "
                    f"{', '.join(folder.name for folder in folders)}"
                )
            members = [
                (folder.name, CfFiles(tuple(str(file) for file in files if file.parent == folder)))
                for folder in folders
            ]
            what = f"{len(members)} folder{'s' * (len(members) != 1)}"
        else:
            along = self.spec.along
            size = _size_along(files, along)
            each = [(f"{along} {at}", (along, at)) for at in range(size)]
            members = [(name, CfFiles(self.paths, index=index)) for name, index in each]
            what = f"{size} along {along}"
        least = 1 if self._are_cycles else _LEAST
        if not least <= len(members) <= _MOST:
            raise RequestError(f"members: {what}; there must be {least} to {_MOST}")
        return members

    @property
    def _are_cycles(self) -> bool:
        """Whether the members are forecasts in folders, the newest first."""
        return self.spec.along == CYCLES

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
    if fatal := fatal_files(files[:1]):
        raise RequestError(f"{files[0].name}: {fatal[files[0]]}")
    try:
        with open_dataset(files[0]) as dataset:
            if along in dataset.sizes:
                return int(dataset.sizes[along])
            there = ", ".join(map(str, dataset.sizes))
    except ValueError as error:
        raise RequestError(f"{files[0].name}: {error}") from None
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


def _mean(parts: Sequence[FloatArray], weights: FloatArray) -> FloatArray:
    """Return the mean (nt, ny, nx) of a component over the members; NaN where any has none."""
    return np.asarray(np.tensordot(weights, np.array(parts), axes=1))


# Steps of a residual closer than these show the tide, which would count twice.
_LEAST_STEP = timedelta(hours=12)


@dataclass(frozen=True)
class TidalStreams(CfFiles):
    """A file of harmonic constants, with the file's mean, another current, or none."""

    residual: CfFiles | None = None

    @classmethod
    def of(cls, named: StreamConstants) -> Self:
        """Return the source that a scenario names."""
        given = named.residual
        files = None if given is None or given == STILL else CfFiles(tuple(given))
        return cls((named.constants,), with_mean=given is None, residual=files)

    def identity(self, season: Season) -> tuple[str, ...]:
        """Return the hashes of the constants, and those of the residual."""
        own = super().identity(season)
        if self.residual is None:
            return own
        steady = self.residual.identity(_at_departure(season))
        return (*own, *self.residual.identity(season), *steady)

    def uncovered_reason(self, region: Polygon, season: Season) -> str:
        """Say why constants and residual can't give the season's current; empty when they can."""
        reasons = [super().uncovered_reason(region, season)]
        try:
            contents = self.contents()
            if not contents.constituents:
                lacking = "it has no harmonic constants (u_re, u_im, v_re, v_im)"
                remedy = "fit them with `renew tide fit`, or name the file itself in 'currents'"
                reasons = [f"{name_of(contents.files)}: {lacking}; {remedy}"]
            if self.residual is not None:
                reasons.append(_residual_fault(self.residual, region, season))
        except RequestError as error:
            reasons += error.faults
        return "; ".join(dict.fromkeys(filter(None, reasons)))

    def covered_bounds(self, region: Polygon, season: Season) -> Bounds | None:
        """Return the part that both the constants and the residual cover."""
        own = super().covered_bounds(region, season)
        if self.residual is None or own is None:
            return own
        other = self.residual.covered_bounds(region, season)
        return None if other is None else common_bounds(own, other)

    def issue(self, season: Season) -> Issue:
        """Return the issue of the residual, which is what changes, with both hashes."""
        own = super().issue(season)
        if self.residual is None:
            return own
        other = self.residual.issue(season)
        return replace(other, digest=f"{own.digest}{other.digest}")

    def current(self, region: Polygon, season: Season, land: Land, folder: Path) -> CurrentGrid:
        """Return the sum of both on the constants' grid, at the times of the streams' fields."""
        streams = super().current(region, season, land, folder)
        if self.residual is None:
            return streams
        if self.residual.uncovered_reason(region, season):
            season = _at_departure(season)
        return _sum(streams, self.residual.current(region, season, land, folder))


def _at_departure(season: Season) -> Season:
    """Return the season with the one field that is nearest to its departure."""
    valid = f"{season.first_departure:%Y-%m-%dT%H:%MZ}"
    return season.model_copy(update={"time_method": None, "valid": valid})


def _residual_fault(residual: CfFiles, region: Polygon, season: Season) -> str:
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
    reason = residual.uncovered_reason(region, season)
    return reason and residual.uncovered_reason(region, _at_departure(season))


def _sum(streams: CurrentGrid, residual: CurrentGrid) -> CurrentGrid:
    """Add a residual to streams, linear in time, until it ends."""
    lonlat = np.stack(np.meshgrid(streams.lon, streams.lat), axis=-1)
    times = streams.times_s
    if residual.changes:
        times = times[: max(2, int(np.searchsorted(times, residual.times_s[-1], side="right")))]
    u, v = streams.u[: times.size].copy(), streams.v[: times.size].copy()
    # One field of the residual after the other: each weighs in the hours around it.
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
